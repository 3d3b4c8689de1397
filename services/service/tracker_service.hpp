// main() of a tracker.
#pragma once

#include <functional>
#include <memory>
#include <string>

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

/// Publishes the samples of the source as tracked_skeleton and head_pose, and its health and counters in loop_status,
/// until SIGTERM or SIGINT. Returns the exit code.
int run_tracker(int argc, char** argv, const TrackerProgram& program);

}  // namespace softhand
