// The physics world behind plain values: no clock, no DDS, no I/O. docs/coupling-objects.md tells the scheme.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/messages.hpp"
#include "world/follow.hpp"
#include "world/physics_engine.hpp"
#include "world/solid.hpp"
#include "world/world_options.hpp"

namespace softhand {

struct WorldInput {
  /// The newest ObjectCoupling of each hand that was ever heard, in any order; old ones stay in the list and age.
  std::span<const ObjectCoupling> couplings;
};

struct WorldOutput {
  /// Every object that has not been removed, the static ones too (their pose is nowhere else). The caller fills epoch,
  /// clock and publish time.
  WorldObjects objects;
};

struct WorldCounters {
  std::uint64_t refused_nonfinite =
      0;  ///< twins that were not finite or absurd (farther than 10 km), each sample once a step
  std::uint64_t refused_mode = 0;  ///< couplings of the other mode
  std::uint64_t stalls = 0;        ///< times an owner's data went stale while it owned an object
  std::uint64_t vanished = 0;      ///< times an owner was given up
  std::uint64_t repaired = 0;      ///< objects that the engine lost (not finite) and that were put back
};

class WorldLoop {
 public:
  /// Throws std::invalid_argument with all that check_world says.
  WorldLoop(const WorldOptions& options, const std::vector<ObjectOptions>& objects, double hand_step = 1.0 / 90);
  ~WorldLoop();

  /// Advances the world by its own period T, from `now` - T to `now`, whatever time went by since the last call: a
  /// stall is not caught up. The state is stamped `now`. The result holds until the next call.
  const WorldOutput& step(Nanoseconds now, const WorldInput& input);

  /// As the last step left them.
  const WorldObjects& objects() const { return output_->objects; }
  /// One a scene object, removed ones flagged. Those whose `stamp.sequence` is beyond an earlier `descriptions_version`
  /// have changed since: publish them again.
  const std::vector<ObjectDescription>& descriptions() const { return descriptions_; }
  std::uint64_t descriptions_version() const { return descriptions_version_; }

  /// Between steps: all objects to their start. What hands published until `time` holds nothing any more.
  void reset(Nanoseconds time);

  /// Between steps. Keys: `object.reset` NAME or * (back to its place of the scene, at rest; a removed one returns),
  /// `object.remove` NAME, `object.teleport` NAME X Y Z (m, of the shape's frame, at rest, orientation kept). Whoever
  /// holds the object lets go of it. Any other key is ignored, and so is what is addressed to another module than
  /// `module`.
  MessageReply answer(const Message& message, std::string_view module = "world");

  /// Age of the newest coupling, energy of the objects, counters.
  void fill_status(LoopStatus& status, Nanoseconds now) const;

  const WorldCounters& counters() const { return counters_; }
  double step_period() const { return step_; }
  /// Kinetic and potential energy of the objects that move, J.
  double energy() const;

 private:
  struct Object {
    ObjectOptions options;
    Solid solid;
    Pose start;  ///< body frame
    bool dynamic = false;
    bool present = true;
    bool weightless = false;
    bool near_hand = false;
    bool owned = false;
    bool stalled = false;
    bool put = false;        ///< somewhere else by a message, of which a hand that held it has not heard yet
    Nanoseconds put_at = 0;  ///< the first step since; 0: there was none
    HandKey owner;
    double owner_step = 0;
    Pose pose;
    Twist velocity;
    Twist previous_velocity;
    BoundedVector<NeighbourPlane, kMaxNeighbourPlanes> planes;  ///< after the last step, while near_hand
  };

  void insert(std::size_t slot);
  void restore(std::size_t slot);
  void describe(std::size_t slot, bool removed);
  void take_from_hands(Object& object);
  void follow(std::size_t slot, Nanoseconds now, const WorldInput& input);
  void publish(Nanoseconds now);
  void find_planes(std::size_t slot);
  Wrench without_reaction(const Object& object, const Follower& follower, const Wrench& hand) const;
  void stop_at_planes(const Object& object, const Follower& follower, Wrench& wrench) const;
  Vector3 gravity_of(const Object& object) const;
  Object* find(std::string_view name);

  WorldOptions options_;
  double step_;
  Vector3 gravity_;
  std::unique_ptr<PhysicsEngine> engine_;
  std::vector<Object> objects_;
  std::vector<ObjectDescription> descriptions_;
  std::uint64_t descriptions_version_ = 0;
  WorldCounters counters_;
  Nanoseconds newest_input_ = 0;
  Nanoseconds reset_time_ = -1;
  std::unique_ptr<WorldOutput> output_;
};

}  // namespace softhand
