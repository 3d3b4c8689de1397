// softhand-tracker-sample: the pose of a right wrist. Packets: UDP, seven little-endian floats x y z (m) and qx qy qz
// qw.
#include "device/intake.hpp"
#include "messages/convert.hpp"
#include "sample_options.hpp"
#include "service/tracker_service.hpp"

using namespace softhand;

class SampleTracker final : public TrackerSource {
 public:
  explicit SampleTracker(const SampleOptions& options) {
    std::printf("listening on UDP port %u\n", intake_.listen_udp(options.address, options.port));
    std::fflush(stdout);
    intake_.start();
  }
  void poll(Nanoseconds, TrackerSink& out) override {
    intake_.take([&](const Arrival& packet) {
      std::array<float, 7> values{};
      if (packet.bytes.size() == sizeof values) std::memcpy(values.data(), packet.bytes.data(), sizeof values);
      JointSample& wrist = hand_.joints[static_cast<std::size_t>(index_of(Joint::wrist))];
      std::copy_n(values.begin(), 3, wrist.position.begin());
      std::copy_n(values.begin() + 3, 4, wrist.orientation.begin());
      // NaN, another length of the packet, and anything but a unit quaternion are refused.
      if (!(std::abs(to_quaternion(wrist.orientation).norm() - 1) < 0.01) || !all_finite(wrist.position)) {
        ++refused_;
        return;
      }
      wrist.flags = kJointValid | kJointTracked;  // the other joints are not seen
      hand_.confidence = 1;
      hand_.stamp.sample_time = packet.time;
      ++hand_.stamp.sequence;
      out.hand(hand_);
    });
  }
  SourceState state() const override { return {intake_.connected(), refused_ + intake_.counters().refused_size}; }
  void fill_status(LoopStatus& status) const override {
    add_counter(status, "refused", static_cast<double>(state().refused));
  }

 private:
  Intake intake_{64};
  Skeleton hand_;
  std::uint64_t refused_ = 0;
};

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "sample",
                      .about = "Tracker of one wrist: a sample for authors of drivers",
                      .make_source = [](const Scene& scene, const bus::Participant&) {
                        return std::make_unique<SampleTracker>(driver_options<SampleOptions>(scene.options));
                      }});
}
