// Section [tracker_fusion] of a scene.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct FusionOptions {
  std::string wrist = "1 2";
  std::string fingers = "2 1";
  std::string head = "1 2";
  double least_confidence = 0.3;
  double stale_after = 0.08;
  double patience = 0.3;
  double blend_time = 0.2;
  double delay = 0;
};
inline void describe(OptionVisitor& v, FusionOptions& o) {
  v.string("wrist", o.wrist,
           "Sources of the wrist, best first, separated by spaces. A source is the number that its tracker got as "
           "--user.");
  v.string("fingers", o.fingers, "The same for the fingers.");
  v.string("head", o.head, "The same for the head.");
  v.number("least_confidence", o.least_confidence, "1", {0, 1},
           "A sample with a lower confidence is poor. While a source sends poor samples, the next good one takes over. "
           "Without another source the part is held, and follows the poor samples after `patience`.");
  v.number("stale_after", o.stale_after, "s", {0.01, 1},
           "If a source sends no sample of a part for this time, the next source takes the part over.");
  v.number("patience", o.patience, "s", {0, 10},
           "A better source takes its part back after it has been good for this time. A source without substitute is "
           "followed after it has been poor for this time.");
  v.number("blend_time", o.blend_time, "s", {0, 2},
           "After a change of the source, its difference to the former one fades out in this time.");
  v.number(
      "delay", o.delay, "s", {0, 0.05},
      "The hand is composed at the time of its newest sample minus this delay. So late fingers are predicted less, "
      "and the wrist gets older.");
}

}  // namespace softhand
