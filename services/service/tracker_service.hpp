// main() of a tracker.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "device/health.hpp"
#include "device/tracker_source.hpp"
#include "scene_file.hpp"
#include "service/service.hpp"

namespace softhand {

struct TrackerProgram {
  std::string name;   ///< "streamer" for softhand-tracker-streamer
  std::string about;  ///< one line for --help
  /// `real` for a device that follows a person. `simulated` for a source that plays a motion: it slows down with the
  /// simulation, and a message `restart` or a reset of the simulation restarts it.
  Pacing pacing = Pacing::real;
  /// Opens the device. Throws if this can never succeed, for example if a port is in use. A device that may appear
  /// later is no reason to throw. The source must not outlive the scene. A source that subscribes to topics uses the
  /// participant.
  std::function<std::unique_ptr<TrackerSource>(const Scene&, const bus::Participant&)> make_source;
};

/// The side of a device that tracks: publishes the samples of a source as tracked_skeleton and head_pose, and its
/// health. Of several trackers of a hand, the strongest healthy one owns it.
class TrackerFace final : private TrackerSink {
 public:
  /// `user`: of the scene; `arguments` may name another one.
  TrackerFace(const Service& service, Pacing pacing, const TrackerArguments& arguments, std::uint32_t user);

  ~TrackerFace();

  void poll(TrackerSource& source, Nanoseconds now);
  /// Answers the message `strength`. Returns nothing for other messages.
  std::optional<MessageReply> answer(const Message& message, const std::string& module);
  /// Starts a played motion over, as if it had begun at the simulated time `begin`.
  void restart(TrackerSource& source, Nanoseconds begin);
  void fill_status(const TrackerSource& source, LoopStatus& status, Nanoseconds now) const;

 private:
  void hand(const Skeleton& sample) override;
  void head(const HeadPose& sample) override;
  void arrived(Nanoseconds sample_time, double confidence);
  void stamp(Stamp& stamp) const;

  const Service& service_;
  const Pacing pacing_;
  const std::uint32_t user_;
  const std::uint32_t source_;
  bus::Writer<Skeleton> hands_;
  bus::Writer<HeadPose> heads_;
  HealthMonitor health_;
  Health health_now_ = Health::opening;
  Skeleton hand_;
  HeadPose head_;
  Nanoseconds now_ = 0;
  Nanoseconds newest_ = 0;  // sample time
  double confidence_ = 0;   // of the newest hand
  int strength_;            // without the share of the health
  // DDS allocates when a strength changes. So a thread beside the loop does it.
  std::atomic<int> wanted_strength_;
  std::atomic<bool> stop_{false};
  std::thread announcer_;
  std::uint64_t published_ = 0;
  std::uint64_t restarts_ = 0;
  bool started_ = false;
};

/// Publishes the samples of the source as tracked_skeleton and head_pose, and its health and counters in loop_status,
/// until SIGTERM or SIGINT. Returns the exit code.
int run_tracker(int argc, char** argv, const TrackerProgram& program);

}  // namespace softhand
