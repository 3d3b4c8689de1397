// softhand-tracker-landmarks: hands from the 21 landmarks of any model that a user runs on a camera.
#include <cstdio>

#include "device/refusals.hpp"
#include "service/tracker_service.hpp"
#include "trackers/landmarks/landmarks.hpp"
#include "trackers/sockets/inbox.hpp"

namespace {
using namespace softhand;

constexpr std::size_t kLargest = 8192;  // bytes; 21 landmarks with 17 digits each need 1,400

// The hands of one user, from one sender at a time. A new connection has a new clock.
class LandmarkTracker final : public TrackerSource {
 public:
  LandmarkTracker(const HandModel& hand, const LandmarksOptions& options)
      : options_(options),
        lifters_{LandmarkLifter(hand, Side::left), LandmarkLifter(hand, Side::right)},
        inbox_(options.listening, Transport::websocket_and_udp, kLargest, translate_landmarks) {
    std::printf("listening at %s and on UDP port %u\n", inbox_.url().c_str(), inbox_.port());
    std::fflush(stdout);
  }
  void poll(Nanoseconds, TrackerSink& out) override {
    inbox_.take([&](const Arrival& arrival) {
      if (refusals_.accepted(take(arrival))) out.hand(sample_);
    });
  }
  SourceState state() const override { return {true, refusals_.total() + inbox_.counters().refused_size}; }
  void fill_status(LoopStatus& status) const override {
    inbox_.fill_status(status);
    refusals_.fill_status(status, inbox_.counters().refused_size);
  }

 private:
  LandmarksRefusal take(const Arrival& arrival) {
    const auto [refusal, message] = value_in<DecodedLandmarks>(arrival);
    if (refusal != LandmarksRefusal::none) return refusal;
    const auto side = static_cast<std::size_t>(message.side);
    sample_ = Skeleton{};
    sample_.hand.side = static_cast<std::uint32_t>(side);
    if (message.score >= options_.least_score) {
      sample_.confidence = message.score;
      const auto placed = place_landmarks(message, options_, lifters_[side].palm_size());
      if (!placed || !lifters_[side].lift(*placed, sample_)) return LandmarksRefusal::shape;
    }
    const auto time = clock_.stamp(message, arrival.connection, arrival.time);
    if (!time) return LandmarksRefusal::order;
    sample_.stamp.sample_time = *time;
    sample_.stamp.sequence = ++sequence_[side];
    return LandmarksRefusal::none;
  }

  const LandmarksOptions& options_;
  std::array<LandmarkLifter, 2> lifters_;  // left, right
  Inbox inbox_;
  LandmarksClock clock_;
  std::array<std::uint64_t, 2> sequence_{};
  Skeleton sample_;
  Refusals<LandmarksRefusal, kLandmarksRefusalNames.size()> refusals_{kLandmarksRefusalNames};
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "landmarks",
                      .about = "Tracker that receives 21 landmarks per hand over WebSocket or UDP",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<LandmarkTracker>(load_scene_hand(scene),
                                                                 driver_options<LandmarksOptions>(scene.options));
                      }});
}
