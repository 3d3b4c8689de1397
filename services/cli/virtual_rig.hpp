// All loops of a rig in one process on a virtual clock: each at its own rate, phase and delay, so that every copy is as stale as between real
// processes, and the same bits come out on every run.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "cli/outcome.hpp"
#include "device/device_loop.hpp"
#include "hand/hand_loop.hpp"
#include "model/hand_model.hpp"
#include "runtime/sha256.hpp"
#include "scene_file.hpp"
#include "tracking/tracking_loop.hpp"
#include "world/world_loop.hpp"

namespace softhand {

/// The newest message that has had time to arrive. Room for what is under way; nothing is lost but what a newer one overtakes.
template <typename T>
class Delayed {
 public:
  void send(Nanoseconds arrives, const T& message) {
    Entry& entry = ring_[sent_++ % ring_.size()];
    entry.arrives = arrives;
    entry.message = message;
  }
  /// The newest message that has arrived by `now` and was not received before; null when there is none.
  const T* receive(Nanoseconds now) {
    const T* newest = nullptr;
    const std::size_t oldest = sent_ > ring_.size() ? sent_ - ring_.size() : 0;
    for (std::size_t i = std::max(received_, oldest); i < sent_; ++i) {
      const Entry& entry = ring_[i % ring_.size()];
      if (entry.arrives > now) break;
      newest = &entry.message;
      received_ = i + 1;
    }
    return newest;
  }

 private:
  struct Entry {
    Nanoseconds arrives = 0;
    T message;
  };
  std::vector<Entry> ring_ = std::vector<Entry>(32);
  std::size_t sent_ = 0;
  std::size_t received_ = 0;
};

/// What one step of the hand looked like, for signals in a CSV and for pictures.
struct HandStepView {
  Nanoseconds time = 0;
  const HandOutput* output = nullptr;
  const HandSimulation* simulation = nullptr;
  const WorldObjects* objects = nullptr;
  const Skeleton* tracked = nullptr;
};

class VirtualRig {
 public:
  /// Time 0 of the virtual clock is one second, so that no stamp is 0.
  static constexpr Nanoseconds kStart = 1'000'000'000;

  VirtualRig(const Scene& scene, const HandModel& hand, std::unique_ptr<TrackerSource> tracker);
  ~VirtualRig();

  /// Runs for `seconds`; calls `after_hand_step` after each step of the hand.
  void run(double seconds, const std::function<void(const HandStepView&)>& after_hand_step);

  const Outcome& outcome() const { return outcome_; }
  /// SHA-256 over every dynamic state at every step of every loop.
  std::string state_hash() { return hasher_.hex(); }
  const HandLoop& hand() const { return *hand_; }
  const TrackingLoop* tracking() const { return tracking_.get(); }
  const WorldLoop& world() const { return *world_; }
  const DeviceLoop<BoneWrench>& haptic() const { return *haptic_; }
  std::uint64_t steps_of_hand() const { return hand_steps_; }
  /// Seconds of computing that the hand's steps took, one each, and how they split.
  const std::vector<StepTiming>& hand_timings() const { return hand_timings_; }

 private:
  struct Loop {
    Nanoseconds period = 0;
    Nanoseconds next = 0;
    void (VirtualRig::*step)(Nanoseconds) = nullptr;
  };
  void step_tracker(Nanoseconds now);
  void step_tracking(Nanoseconds now);
  void step_hand(Nanoseconds now);
  void step_world(Nanoseconds now);
  void step_haptic(Nanoseconds now);

  SceneOptions options_;
  std::unique_ptr<TrackerSource> tracker_;
  std::unique_ptr<TrackingLoop> tracking_;
  std::unique_ptr<HandLoop> hand_;
  std::unique_ptr<WorldLoop> world_;
  std::unique_ptr<DeviceLoop<BoneWrench>> haptic_;
  Nanoseconds transport_;
  Nanoseconds hand_compute_;
  std::vector<Loop> loops_;

  Delayed<Skeleton> tracked_to_tracking_;
  Delayed<Skeleton> skeleton_to_hand_;
  Delayed<Skeleton> simulated_to_tracking_;
  Delayed<Contacts> contacts_to_tracking_;
  Delayed<WorldObjects> objects_to_hand_;
  Delayed<ObjectCoupling> coupling_to_world_;
  Delayed<BoneWrench> wrench_to_haptic_;
  Skeleton tracked_;         // newest
  ObjectCoupling coupling_;  // newest at the world
  bool coupling_heard_ = false;
  Outcome outcome_;
  Sha256 hasher_;
  std::uint64_t hand_steps_ = 0;
  std::vector<StepTiming> hand_timings_;
  std::function<void(const HandStepView&)> after_hand_step_;
};

}  // namespace softhand
