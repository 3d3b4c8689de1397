// Motions without an object: a fist that opens and closes, a thumb that slides along the index finger, and a wandering
// hand with every joint in motion.
#pragma once

#include <memory>

#include "trackers/replay/generator.hpp"

namespace softhand {

/// Makes the motion "fist" or "rub". For any other name in the options it makes "free_motion".
std::unique_ptr<Motion> make_free_motion(const HandModel& hand, const GeneratorOptions& options);

}  // namespace softhand
