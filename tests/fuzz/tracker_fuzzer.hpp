// Helpers for the fuzzers of trackers.
#pragma once

#include <cmath>

#include "device/arrival_queue.hpp"
#include "device/tracker_source.hpp"
#include "fuzz/fuzzer.hpp"
#include "messages/convert.hpp"
#include "model/hand_model.hpp"

namespace softhand::fuzz {

inline constexpr Nanoseconds kArrival = 1'000'000'000'000;

/// The hand with which decoders compute joints.
inline const HandModel& shipped_hand() {
  static const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  return hand;
}

/// Everything that becomes a sample is a hand or a head.
class CheckedSink final : public TrackerSink {
 public:
  void hand(const Skeleton& sample) override {
    ++count;
    expect(sample.hand.side <= 1, "a hand has a side");
    expect(sample.confidence >= 0 && sample.confidence <= 1, "a confidence is between 0 and 1");
    // Samples that arrive together get ascending times, a nanosecond apart.
    expect(sample.stamp.sample_time <= kArrival + 1'000'000, "no sample is later than its arrival");
    for (const JointSample& joint : sample.joints)
      if (joint.flags != 0) check(joint.position, joint.orientation);
  }
  void head(const HeadPose& sample) override {
    ++count;
    if (sample.valid != 0) check(sample.position, sample.orientation);
  }
  int count = 0;

 private:
  static void check(const Vec3& position, const Vec4& orientation) {
    expect(all_finite(position) && all_finite(orientation), "poses are finite");
    expect(std::abs(to_quaternion(orientation).norm() - 1) < 1e-6, "orientations have unit length");
  }
};

/// Calls f(const Arrival&) for each packet of a stream.
template <typename F>
void for_each_packet(std::string_view bytes, char end_of_packet, F&& f) {
  while (!bytes.empty()) {
    const std::size_t end = bytes.find(end_of_packet);
    f(Arrival{bytes.substr(0, end), kArrival, 1, false});
    bytes.remove_prefix(end == std::string_view::npos ? bytes.size() : end + 1);
  }
}

template <typename F>
void for_each_line(std::string_view bytes, F&& f) {
  for_each_packet(bytes, '\n', std::forward<F>(f));
}

}  // namespace softhand::fuzz
