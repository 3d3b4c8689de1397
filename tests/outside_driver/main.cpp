// softhand-tracker-outside: a right wrist at rest.
#include <cstdio>

#include "outside_options.hpp"
#include "service/tracker_service.hpp"

using namespace softhand;

// The library was built for every x86-64 processor, this driver for one with AVX.
static_assert(alignof(Pose) == 16, "Eigen aligns a pose of the driver otherwise than one of the library");

class OutsideTracker final : public TrackerSource {
 public:
  explicit OutsideTracker(const OutsideOptions& options) {
    std::printf("height %g\n", options.height);
    std::fflush(stdout);
    wrist().position = {0, options.height, 0};
    wrist().flags = kJointValid | kJointTracked;
    hand_.confidence = 1;
  }
  void poll(Nanoseconds now, TrackerSink& out) override {
    if (now < hand_.stamp.sample_time + 11'111'111) return;
    hand_.stamp.sample_time = now;
    ++hand_.stamp.sequence;
    out.hand(hand_);
  }

 private:
  JointSample& wrist() { return hand_.joints[static_cast<std::size_t>(index_of(Joint::wrist))]; }
  Skeleton hand_;
};

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "outside",
                      .about = "Tracker of a test outside the repository",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<OutsideTracker>(driver_options<OutsideOptions>(scene.options));
                      }});
}
