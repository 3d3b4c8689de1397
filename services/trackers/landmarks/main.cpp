// softhand-tracker-landmarks: hands from the 21 landmarks of any model that a user runs on a camera.
#include <cstdio>

#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"
#include "trackers/landmarks/landmarks.hpp"
#include "trackers/sockets/inbox.hpp"

namespace {
using namespace softhand;

constexpr double kPollRate = 1000;      // Hz, polling of messages
constexpr std::size_t kLargest = 8192;  // bytes; 21 landmarks with 17 digits each need 1,400

// The hands of one user, from one sender at a time. A new connection has a new clock.
class LandmarkTracker {
 public:
  LandmarkTracker(const HandModel& hand, const LandmarksOptions& options)
      : options_(options),
        lifters_{LandmarkLifter(of_side(hand, Side::left)), LandmarkLifter(of_side(hand, Side::right))},
        radii_(hand.joint_radii) {}

  LandmarksRefusal take(const Arrival& arrival, Skeleton& out) {
    LandmarksMessage message;
    if (const auto refusal = decode_landmarks(arrival.bytes, message); refusal != LandmarksRefusal::none)
      return refusal;
    const auto side = static_cast<std::size_t>(message.side);
    Skeleton skeleton;
    skeleton.hand.side = static_cast<std::uint32_t>(side);
    skeleton.confidence = message.score;
    if (message.score >= options_.least_score) {
      const auto placed = lifters_[side].place(message, options_);
      const auto joints = placed ? lifters_[side].lift(*placed) : std::nullopt;
      if (!joints) return LandmarksRefusal::shape;
      for (std::size_t j = 0; j < kJointCount; ++j) {
        skeleton.joints[j].position = to_wire((*joints)[j].position);
        skeleton.joints[j].orientation = to_wire((*joints)[j].orientation);
        skeleton.joints[j].radius = radii_[j];
        skeleton.joints[j].flags = kJointValid | (is_inferred(static_cast<Joint>(j)) ? kJointInferred : kJointTracked);
      }
    }
    const auto time = clock_.stamp(message, arrival.connection, arrival.time);
    if (!time) return LandmarksRefusal::order;
    skeleton.stamp.sample_time = skeleton.stamp.chain.tracker_sample = *time;
    skeleton.stamp.sequence = ++sequence_[side];
    out = skeleton;
    return LandmarksRefusal::none;
  }

 private:
  static HandModel of_side(const HandModel& hand, Side side) { return hand.side == side ? hand : mirrored(hand); }
  // Joints without a landmark.
  static bool is_inferred(Joint joint) {
    return joint == Joint::palm || (is_metacarpal(body_of(joint)) && joint != Joint::thumb_metacarpal);
  }

  const LandmarksOptions& options_;
  std::array<LandmarkLifter, 2> lifters_;  // left, right
  std::array<double, kJointCount> radii_;
  LandmarksClock clock_;
  std::array<std::uint64_t, 2> sequence_{};
};

void run(int argc, char** argv) {
  const TrackerArguments arguments =
      parse_tracker_arguments(argc, argv, "Tracker that receives 21 landmarks per hand over WebSocket or UDP");
  const Scene scene = read_scene(arguments.config, arguments.overrides);
  const LandmarksOptions& options = scene.options.tracker_landmarks;
  const HandKey user = hand_key(scene);

  Service service(arguments, kPollRate, Pacing::real);
  bus::Writer writer(service.participant(), bus::topics::tracked_skeleton, arguments.strength);
  LandmarkTracker tracker(load_scene_hand(scene), options);
  Inbox inbox(options.listening, Transport::websocket_and_udp, kLargest);
  std::printf("listening at %s and on UDP port %u\n", inbox.url().c_str(), inbox.port());
  std::fflush(stdout);

  std::vector<Arrival> arrivals;
  std::array<std::uint64_t, kLandmarksRefusalNames.size()> refused{};
  std::uint64_t published = 0;
  Nanoseconds newest = 0;
  Skeleton sample;
  const auto step = [&](Nanoseconds) {
    inbox.take(arrivals);
    for (const Arrival& arrival : arrivals) {
      const LandmarksRefusal refusal = tracker.take(arrival, sample);
      if (refusal != LandmarksRefusal::none) {
        ++refused[static_cast<std::size_t>(refusal)];
        continue;
      }
      newest = sample.stamp.sample_time;
      sample.stamp.sample_time = service.clock().at(newest);
      sample.hand.user = user.user;
      sample.source = arguments.source;
      service.stamp(sample.stamp);
      sample.stamp.chain.tracked_published = sample.stamp.publish_time;
      writer.write(sample);
      ++published;
    }
  };
  const auto fill_status = [&](LoopStatus& status, Nanoseconds now) {
    status.input_age_ms = age_ms_of(newest, now);
    const Inbox::Counters counters = inbox.counters();
    add_counter(status, "published", static_cast<double>(published));
    add_counter(status, "connections", static_cast<double>(counters.connections));
    add_counter(status, "refused_origin", static_cast<double>(counters.refused_origin));
    add_counter(status, "refused_size", static_cast<double>(counters.refused_size));
    add_counter(status, "passed_over", static_cast<double>(counters.passed_over));
    for (std::size_t i = 1; i < refused.size(); ++i)
      add_counter(status, "refused_" + std::string(kLandmarksRefusalNames[i]), static_cast<double>(refused[i]));
  };
  service.run({.step = step, .fill_status = fill_status});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-tracker-landmarks", [&] { run(argc, argv); });
}
