// Motions of one of two hands that meet each other: a clap, and fingers that interlace. The other hand plays the same
// motion. A right hand comes from +X, a left hand from -X, and the middle is `object_position`.
#pragma once

#include <memory>

#include "trackers/replay/generator.hpp"

namespace softhand {

/// Makes the motion "clap" or "interlace".
std::unique_ptr<Motion> make_hand_to_hand(const HandModel& hand, const GeneratorOptions& options);

}  // namespace softhand
