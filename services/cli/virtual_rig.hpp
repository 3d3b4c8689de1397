// All loops of a rig in one process on a virtual clock. Each loop has its own rate, phase and delay, so copies are as
// stale as between real processes. Every run gives the same bits.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "cli/outcome.hpp"
#include "cli/wrench_work.hpp"
#include "device/device_loop.hpp"
#include "hand/hand_loop.hpp"
#include "model/hand_model.hpp"
#include "runtime/sha256.hpp"
#include "scene_file.hpp"
#include "trackers/replay/motion.hpp"
#include "tracking/tracking_loop.hpp"
#include "world/world_loop.hpp"

namespace softhand {

/// A channel with a delay that delivers only the newest message that has arrived. A message that would arrive after a
/// newer one is dropped. If more than 256 messages are under way, the oldest is dropped.
template <typename T>
class Delayed {
 public:
  void send(Nanoseconds arrives, const T& message) {
    while (received_ < sent_ && at(sent_ - 1).arrives > arrives) --sent_;
    if (sent_ - received_ == ring_.size() && ring_.size() < kMostUnderWay) {
      std::rotate(ring_.begin(), ring_.begin() + static_cast<std::ptrdiff_t>(received_ % ring_.size()), ring_.end());
      sent_ -= received_;
      received_ = 0;
      ring_.resize(2 * ring_.size());
    }
    Entry& entry = at(sent_++);
    entry.arrives = arrives;
    entry.message = message;
    if (sent_ - received_ > ring_.size()) ++received_;
  }
  /// Returns the newest message that has arrived by `now` and was not received before, or null. The pointer is valid
  /// until the next call.
  const T* receive(Nanoseconds now) {
    const T* newest = nullptr;
    while (received_ < sent_ && at(received_).arrives <= now) newest = &at(received_++).message;
    return newest;
  }

 private:
  static constexpr std::size_t kMostUnderWay = 256;
  struct Entry {
    Nanoseconds arrives = 0;
    T message;
  };
  Entry& at(std::size_t i) { return ring_[i % ring_.size()]; }
  std::vector<Entry> ring_ = std::vector<Entry>(32);
  std::size_t sent_ = 0;
  std::size_t received_ = 0;
};

enum class RigLoop { tracker, tracking, hand, world, haptic };

/// Receives every message that the loops publish, and may disturb the loops (for fault tests).
class RigWitness {
 public:
  virtual ~RigWitness() = default;
  virtual void published(RigLoop /*from*/, const Skeleton&) {}
  virtual void published(RigLoop /*from*/, const BoneWrench&) {}
  virtual void published(RigLoop /*from*/, const WorldObjects&) {}
  virtual void published(RigLoop /*from*/, const DeviceState&) {}
  /// All outputs of one step of the hand.
  virtual void published(RigLoop /*from*/, const HandOutput&) {}
  /// Returns false to skip the step that is due. A skipped step is not repeated later.
  virtual bool runs(RigLoop /*loop*/, Nanoseconds /*now*/) { return true; }
  /// Additional delay (ns) of messages that the loop sends now. Negative: the message is lost.
  virtual Nanoseconds delay(RigLoop /*from*/, Nanoseconds /*now*/) { return 0; }
};

/// The result of one step of the hand, for the signals in a CSV file and for pictures.
struct HandStepView {
  Nanoseconds time = 0;
  std::size_t hand = 0;  ///< its place in the rig
  const HandOutput* output = nullptr;
  const ObjectCoupling* coupling = nullptr;  ///< of the hand's process
  const HandSimulation* simulation = nullptr;
  int in_simulation = 0;  ///< number of the hand in it
  const WorldObjects* objects = nullptr;
  const Skeleton* tracked = nullptr;
};

class VirtualRig {
 public:
  /// Start of the virtual clock: one second, so that no stamp is 0.
  static constexpr Nanoseconds kStart = 1'000'000'000;

  /// `witness` may be null. Otherwise it must outlive the rig.
  VirtualRig(const Scene& scene, const HandModel& hand, std::unique_ptr<TrackerSource> tracker,
             RigWitness* witness = nullptr);
  ~VirtualRig();

  /// Adds another hand with its own tracker, intermediate layer and glove, before `run`. `scene`: as its process reads
  /// it (`SceneOptions::plays`). The objects are those of the first hand's scene. Hand 0 is that of the constructor.
  /// With `one_process`, the first hand's process simulates both.
  void add_hand(const Scene& scene, const HandModel& hand, std::unique_ptr<TrackerSource> tracker);
  /// Adds all further hands of the first hand's scene, with its `--set` assignments. Each plays its motion.
  void add_other_hands(const Scene& first, const std::vector<std::string>& overrides);
  std::size_t hand_count() const { return hands_.size(); }

  /// The motion of the user's hand without the noise of the tracker. Time 0 of the rig is `start_time` of the motion;
  /// with `repeat` it begins again at its end. The encoders of the glove measure this motion. Without a user they
  /// measure the tracked hand.
  void set_user(std::shared_ptr<const Motion> motion, double start_time, bool repeat, std::size_t hand = 0);

  /// Runs for `seconds`. Calls `after_hand_step` after each step of a hand.
  void run(double seconds, const std::function<void(const HandStepView&)>& after_hand_step);

  /// Sends a message to every module. Call it between steps only: `after_hand_step` may call it, and nothing else of
  /// the rig.
  void send(const Message& message);
  /// Sends the hand a new description of an object, as a third-party world could do.
  void describe_object(const ObjectDescription& description);

  const Outcome& outcome(std::size_t hand = 0) const;
  /// SHA-256 of the tracked and intermediate joints, the hand's nodes and bodies, and the objects' poses and velocities
  /// at every step.
  std::string state_hash() { return hasher_.hex(); }
  /// The loop of a hand's process, and the hand's number in it.
  const HandLoop& hand(std::size_t hand = 0) const;
  int number_in_loop(std::size_t hand) const;
  const TrackingLoop* tracking(std::size_t hand = 0) const;
  const WorldLoop& world() const { return *world_; }
  const DeviceLoop<BoneWrench>& haptic(std::size_t hand = 0) const;
  /// Work of the forces and torques of all bones, J, if they acted in full on the bones of the tracked hand. That hand
  /// has the noise of the tracker; the user's hand, of `work_on_user`, has none.
  double work_on_tracked(std::size_t hand = 0) const;
  double work_on_user(std::size_t hand = 0) const;
  std::uint64_t steps_of_hand(std::size_t hand = 0) const;
  /// Computing time (s) of each step of the hand, and its parts.
  const std::vector<StepTiming>& hand_timings(std::size_t hand = 0) const;

 private:
  struct Hand;
  class Glove;
  struct Loop {
    Nanoseconds period = 0;
    Nanoseconds next = 0;
    RigLoop name = RigLoop::tracker;
    std::function<void(Nanoseconds)> step;
  };
  void make_hand_loop(Hand& first, const Scene& scene);
  void publish(Hand& hand, Nanoseconds done, const ObjectCoupling& coupling);
  void add_loop(RigLoop name, double rate_hz, double phase, std::function<void(Nanoseconds)> step);
  void deliver(Hand& hand, Nanoseconds now, const Skeleton& sample);
  void step_tracking(Hand& hand, Nanoseconds now);
  void step_hand(Hand& first, Nanoseconds now);
  void step_world(Nanoseconds now);
  void step_haptic(Hand& hand, Nanoseconds now);

  template <typename T>
  void send(Delayed<T>& channel, RigLoop from, Nanoseconds leaves, const T& message) {
    const Nanoseconds late = witness_ == nullptr ? 0 : witness_->delay(from, leaves);
    if (late >= 0) channel.send(leaves + transport_ + late, message);
  }
  template <typename T>
  void tell(RigLoop from, const T& message) {
    if (witness_ != nullptr) witness_->published(from, message);
  }

  SceneOptions options_;  // of the first hand
  RigWitness* witness_;
  Nanoseconds transport_;
  std::unique_ptr<WorldLoop> world_;
  std::vector<std::shared_ptr<const ShapeGeometry>> file_shapes_;  // of the scene's objects; null without a file
  std::vector<std::unique_ptr<Hand>> hands_;
  std::vector<Loop> loops_;
  std::vector<ObjectCoupling> couplings_;     // the newest one of each hand that the world has received
  std::vector<SoftObjectState> soft_states_;  // that a loop has received since its last step
  std::uint64_t descriptions_heard_ = 0;      // version of the descriptions that the hands have received
  Sha256 hasher_;
  std::function<void(const HandStepView&)> after_hand_step_;
};

}  // namespace softhand
