// Keeps the newest samples of a decoder of a tracker.
#pragma once

#include <array>

#include "device/tracker_source.hpp"

namespace softhand::testing {

struct TrackerSamples final : TrackerSink {
  void hand(const Skeleton& sample) override { hands[sample.hand.side] = sample, ++count; }
  void head(const HeadPose& sample) override { newest_head = sample, ++heads; }
  std::array<Skeleton, 2> hands{};  ///< left, right
  HeadPose newest_head;
  int count = 0, heads = 0;  ///< of samples of hands and of heads
};

}  // namespace softhand::testing
