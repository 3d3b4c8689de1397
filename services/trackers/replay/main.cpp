// softhand-tracker-replay: plays a recorded or generated hand like a tracker.
#include "service/tracker_service.hpp"
#include "trackers/replay/replay_tracker.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  const auto make_source = [](const Scene& scene, const bus::Participant&) {
    return std::make_unique<ReplayTracker>(make_scene_motion(scene, load_scene_hand(scene)), scene.options.tracker,
                                           hand_key(scene));
  };
  return run_tracker(argc, argv,
                     {.name = "replay",
                      .about = "Tracker that plays a recorded or generated hand",
                      .pacing = Pacing::simulated,
                      .make_source = make_source});
}
