// The physics world with plain values as input and output: no clock, no DDS, no I/O. Scheme: docs/coupling-objects.md.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "messages/messages.hpp"
#include "messages/plain_bytes.hpp"
#include "world/follow.hpp"
#include "world/physics_engine.hpp"
#include "world/soft_copy.hpp"
#include "world/solid.hpp"
#include "world/world_options.hpp"

namespace softhand {

struct WorldInput {
  /// The newest ObjectCoupling of each known hand, in any order. Old ones stay in the list and become stale.
  std::span<const ObjectCoupling> couplings;
  /// States of flexible objects that have come since the last step. The order does not matter.
  std::span<const SoftObjectState> soft_objects = {};
};

struct WorldOutput {
  /// All objects that have not been removed, including static ones (their pose is published only here). The caller
  /// fills in epoch, clock and publish time.
  WorldObjects objects;
  /// The first `soft_count` are the copies of flexible objects to be published now (soft_object_copy). The caller fills
  /// in the rest of the stamps.
  std::vector<SoftObjectState> soft_objects;
  std::size_t soft_count = 0;
};

struct WorldCounters {
  /// Twins with values that are not finite or absurd (farther than 10 km). Each sample counts once a step.
  std::uint64_t refused_nonfinite = 0;
  std::uint64_t refused_future = 0;  ///< twins in a sample from the future, once a step
  /// States of flexible objects: from the future, of an unknown object, with another number of nodes, or with values
  /// that are not finite or absurd.
  std::uint64_t refused_soft = 0;
  std::uint64_t refused_mode = 0;  ///< couplings of the other mode
  std::uint64_t stalls = 0;        ///< times an owner's data became stale while it owned an object
  std::uint64_t vanished = 0;      ///< times an owner vanished
  std::uint64_t repaired = 0;      ///< objects that became non-finite in the engine and were restored
};

class WorldLoop {
 public:
  /// Throws std::invalid_argument with all messages of check_world and check_soft_objects, or for more than
  /// kMaxSoftObjects.
  WorldLoop(const WorldOptions& options, const std::vector<ObjectOptions>& objects, double hand_step = 1.0 / 90,
            const std::vector<JointOptions>& joints = {}, const std::vector<SoftObject>& soft_objects = {});
  ~WorldLoop();

  /// Advances the world by its own period T, from `now` - T to `now`, independent of the time since the last call. A
  /// stall is not caught up. The state has the stamp `now`. The result is valid until the next call.
  const WorldOutput& step(Nanoseconds now, const WorldInput& input);

  // A saved state (docs/flight-recorder.md; world_memory.cpp). A loop of the same options and objects that loads it
  // continues with the same bits as the loop that saved it. That one must call `forget` at the same time.
  void save(ByteWriter& out) const;
  /// Throws std::runtime_error if the bytes do not fit.
  void load(ByteReader& in);
  /// The engine keeps only the poses and velocities of the objects. Its contacts start without impulses. Call between
  /// steps. Allocates nothing.
  void forget();
  /// Calls visit(name, value) for all parts of the state after a step.
  template <typename Visit>
  void for_each_part(Visit&& visit) const {
    visit("objects", output_->objects);
    visit("flexible objects", copies_);
    visit("counters", counters_);
    visit("version", descriptions_version_);
  }

  /// State after the last step.
  const WorldObjects& objects() const { return output_->objects; }
  /// One description per object of the scene. Removed objects have a flag. Publish those again whose `stamp.sequence`
  /// is larger than an earlier `descriptions_version`: they have changed since.
  const std::vector<ObjectDescription>& descriptions() const { return descriptions_; }
  /// One description per joint of the scene, with numbers from the same sequence. Publish the objects first.
  const std::vector<ObjectJointDescription>& joint_descriptions() const { return joint_descriptions_; }
  std::uint64_t descriptions_version() const { return descriptions_version_; }

  /// The hand's process says that it has a flexible object, or that it does not have it any more. Call between steps.
  void describe_soft_object(const SoftObjectDescription& description);

  /// Returns all objects to their start. Call between steps. Couplings that hands published up to `time` are ignored.
  /// So are claims during the first 0.2 s. A hand may receive the reset later, and an object is put where it is.
  void reset(Nanoseconds time);

  /// Answers messages. Call between steps. The hand that holds the object releases it. Other keys, and messages to
  /// another module than `module`, are ignored. Keys:
  /// - `object.reset` NAME or *: back to the place in the scene, at rest. A removed object returns. Objects that joints
  ///   connect to it are reset too. NAME may be that of a flexible object.
  ///
  /// - `object.remove` NAME removes its joints, too. The object can return by a reset.
  ///
  /// - `object.teleport` NAME X Y Z gives the place of the shape's frame in m. The object is at rest there, and its
  ///   orientation is unchanged. Objects that joints connect to it move along. An object that is jointed to a static
  ///   one is refused.
  MessageReply answer(const Message& message, std::string_view module = "world");

  /// Adds the age of the newest coupling, the energy of the objects and the counters.
  void fill_status(LoopStatus& status, Nanoseconds now) const;

  const WorldCounters& counters() const { return counters_; }
  double step_period() const { return step_; }
  /// Kinetic and potential energy of the movable objects and of their joints, J.
  double energy() const;
  /// Coordinate of the joint in rad or m (model/joint_law.hpp). Throws std::invalid_argument for an unknown name.
  double joint_coordinate(std::string_view name) const;
  /// Distance (m) of the two frames of the joint in the directions that it holds.
  double joint_gap(std::string_view name) const;

 private:
  static constexpr double kMotionStall = 0.100;  // s; older velocities are ignored
  static constexpr double kVanished = 0.500;     // s; an older owner has vanished

  struct Object {
    ObjectOptions options;
    Solid solid;
    Pose start;  ///< of the body frame
    bool dynamic = false;
    bool present = true;
    bool weightless = false;
    bool near_hand = false;
    bool owned = false;
    bool stalled = false;
    bool put = false;        ///< moved by a message that the hand which held it may not have received
    Nanoseconds put_at = 0;  ///< time of the first step after the move; 0: no step yet
    bool restarted = false;  ///< moved by a reset of the world; a hand may receive that reset later
    HandKey owner;
    Nanoseconds handed_at = 0;  ///< when `owner` became the next owner; 0: it knows, and claims the object
    double owner_step = 0;
    Pose pose;
    Twist velocity;
    Twist previous_velocity;
    std::size_t assembly = 0;  ///< slot of the first of the present movable objects that joints connect
    BoundedVector<NeighbourPlane, kMaxNeighbourPlanes> planes;  ///< of the last step, only while near_hand
  };

  struct Joint {
    JointOptions options;
    EngineJoint engine;
    bool present = false;
  };

  struct KnownHand {
    HandKey key;
    Nanoseconds since = 0;  ///< time of the first step with its coupling
  };

  template <typename Self, typename Visit>
  static void visit_own(Self& self, Visit&& visit);
  void make_joints(const std::vector<JointOptions>& joints);
  void find_assemblies(std::optional<std::size_t> returning = {});
  void attach(std::size_t slot);
  void detach(std::size_t slot);
  bool are_jointed(std::size_t one, std::size_t other) const;
  JointPose pose_of(const Joint& joint) const;
  double coordinate_of(const Joint& joint) const;
  const Joint& find_joint(std::string_view name) const;
  void place_objects();
  void set_engine(const std::array<bool, kMaxObjects>& asleep);
  void insert(std::size_t slot);
  void add_to_engine(std::size_t slot);
  void restore(std::size_t first);
  void restore_all();
  void describe(std::size_t slot, bool removed);
  void take_from_hands(Object& object);
  void meet_hands(Nanoseconds now, const WorldInput& input);
  bool is_new(const HandKey& hand, Nanoseconds now) const;
  void follow(std::size_t slot, Nanoseconds now, const WorldInput& input);
  void add_copies(const std::vector<SoftObject>& soft_objects);
  void find_obstacles();
  void move_copies(Nanoseconds now, const WorldInput& input);
  void restart_copy(std::size_t number);
  void publish_copies(Nanoseconds now);
  void publish(Nanoseconds now);
  void find_planes(std::size_t slot);
  void find_plane(std::size_t slot, std::size_t piece, std::size_t other, std::size_t other_piece, double range);
  bool touches_assembly(const ObjectCoupling& hand, std::size_t assembly) const;
  void choose_owner(Object& object, Nanoseconds now, const WorldInput& input, const HandKey* claims, bool owner_touches,
                    const HandKey* guest);
  Wrench without_reaction(const Object& object, const Follower& follower, const Wrench& hand) const;
  void stop_at_planes(const Object& object, const Follower& follower, Wrench& wrench) const;
  Vector3 gravity_of(const Object& object) const;
  Object* find(std::string_view name);

  WorldOptions options_;
  double step_;
  Vector3 gravity_;
  std::unique_ptr<PhysicsEngine> engine_;
  std::vector<Object> objects_;
  std::vector<KnownHand> hands_;
  std::vector<ObjectDescription> descriptions_;
  std::vector<Joint> joints_;
  std::vector<ObjectJointDescription> joint_descriptions_;
  std::vector<SoftCopy> copies_;  // of the flexible objects
  // What shared flexible objects touch: pieces of static objects, with their slots.
  std::vector<std::pair<std::size_t, std::unique_ptr<ShapeGeometry>>> obstacle_shapes_;
  std::vector<Obstacle> obstacles_;
  double hand_step_;
  std::uint64_t descriptions_version_ = 0;
  WorldCounters counters_;
  Nanoseconds newest_input_ = 0;
  Nanoseconds reset_time_ = -1;
  std::unique_ptr<WorldOutput> output_;
};

}  // namespace softhand
