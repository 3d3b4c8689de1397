// Motions without an object: a fist that opens and closes, and wandering with every joint in motion.
#pragma once

#include <memory>

#include "trackers/replay/generator.hpp"

namespace softhand {

/// "fist" or, for any other name, "free_motion" of the options.
std::unique_ptr<Motion> make_free_motion(const HandModel& hand, const GeneratorOptions& options);

}  // namespace softhand
