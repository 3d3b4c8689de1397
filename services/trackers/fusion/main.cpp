// softhand-tracker-fusion: makes the hands and the head of one user from those of other trackers.
#include "bus/bus.hpp"
#include "messages/convert.hpp"
#include "service/tracker_service.hpp"
#include "trackers/fusion/fusion.hpp"
#include "trackers/fusion/fusion_options.hpp"

namespace {
using namespace softhand;

class FusionTracker final : public TrackerSource {
 public:
  FusionTracker(const bus::Participant& participant, const FusionOptions& options, const TrackedInputOptions& input,
                const FusionSources& sources, const HandModel& hand)
      : hands_{HandFusion(options, input, sources, hand.side == Side::left ? hand : mirrored(hand)),
               HandFusion(options, input, sources, hand.side == Side::right ? hand : mirrored(hand))},
        head_fusion_(options, sources.head),
        skeletons_(participant, bus::topics::tracked_skeleton),
        heads_(participant, bus::topics::head_pose) {}

  void poll(Nanoseconds now, TrackerSink& out) override {
    heads_.take_all([&](const HeadPose& sample) {
      head_ = sample;
      use_real_time(head_.stamp);
      if (!head_fusion_.add(head_, now, fused_head_)) return;
      for (HandFusion& hand : hands_) hand.add_head(fused_head_, now);
      out.head(fused_head_);
    });
    skeletons_.take_all([&](const Skeleton& sample) {
      hand_ = sample;
      use_real_time(hand_.stamp);
      for (HandFusion& hand : hands_) hand.add(hand_, now);
    });
    for (HandFusion& hand : hands_)
      if (hand.compose(now, hand_)) out.hand(hand_);
  }
  void fill_status(LoopStatus& status) const override {
    const auto owner = [](const Ownership& part) { return part.owner() ? static_cast<double>(*part.owner()) : -1; };
    std::uint64_t poor = 0, refused = head_fusion_.refused();
    for (std::size_t side = 0; side < 2; ++side) {
      const HandFusion& hand = hands_[side];
      const char* const* const names = kCounters[side].data();
      add_counter(status, names[0], owner(hand.wrist()));
      add_counter(status, names[1], owner(hand.finger(Finger::index)));
      add_counter(status, names[2], static_cast<double>(hand.wrist().changes() + hand.finger(Finger::index).changes()));
      poor += hand.poor();
      refused += hand.refused();
    }
    add_counter(status, "head_from", owner(head_fusion_.ownership()));
    add_counter(status, "poor", static_cast<double>(poor));
    add_counter(status, "refused", static_cast<double>(refused));
  }

 private:
  static constexpr std::array<std::array<const char*, 3>, 2> kCounters{
      {{"left_wrist_from", "left_fingers_from", "left_changes"},
       {"right_wrist_from", "right_fingers_from", "right_changes"}}};

  // Simulated time may run slower than the time in which devices measure.
  static void use_real_time(Stamp& stamp) {
    if (stamp.chain.tracker_sample != 0) stamp.sample_time = stamp.chain.tracker_sample;
  }

  std::array<HandFusion, 2> hands_;  // left, right
  HeadFusion head_fusion_;
  bus::Reader<Skeleton> skeletons_;
  bus::Reader<HeadPose> heads_;
  Skeleton hand_;
  HeadPose head_, fused_head_;
};
}  // namespace

int main(int argc, char** argv) {
  return run_tracker(argc, argv,
                     {.name = "fusion",
                      .about = "Tracker that makes one hand from several trackers",
                      .make_source = [](const Scene& scene, const bus::Participant& participant) {
                        const auto& options = driver_options<FusionOptions>(scene.options);
                        return std::make_unique<FusionTracker>(participant, options, scene.options.tracking.input,
                                                               parse_sources(options, hand_key(scene).user),
                                                               load_scene_hand(scene));
                      }});
}
