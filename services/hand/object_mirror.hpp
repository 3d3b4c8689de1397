// The world's objects as the hand sees them. Near objects get slots in the hand's simulation. This file decides which
// objects get slots, and whether the hand or the world moves them (docs/coupling-objects.md).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "hand/hand_options.hpp"
#include "messages/messages.hpp"
#include "messages/plain_bytes.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {

struct ObjectMirrorCounters {
  std::uint64_t refused_nonfinite = 0;  ///< states of objects, and contacts of other hands, with an absurd number
  /// (object, step) pairs near the hand without a slot: all slots were taken, or too few were free for all objects that
  /// joints connect.
  std::uint64_t without_slot = 0;
};

class ObjectMirror {
 public:
  /// `hand`: the key under which the simulation's hands own objects. `symmetric`: objects use mode symmetric. The
  /// arguments must outlive this object.
  ObjectMirror(HandSimulation& simulation, const HandOptions& options, HandKey hand, bool symmetric);

  /// As `HandLoop::describe_object`, `describe_joint` and `use_file_shapes`.
  void describe_object(const ObjectDescription& description, std::shared_ptr<const ShapeGeometry> file_shape);
  void describe_joint(const ObjectJointDescription& description);
  using LoadShape = std::function<std::shared_ptr<const ShapeGeometry>(const ShapeFile&)>;
  void use_file_shapes(LoadShape load) { load_shape_ = std::move(load); }

  void take_world(const WorldObjects& world);
  /// Whether the newest sample of the world has come with the descriptions and states of all of its objects.
  bool knows_world() const { return knows_world_; }
  /// Releases all objects. They are unknown until a new sample of the world comes.
  void release_all();
  /// Prepares the slots for the step that ends at `now`. `settles`: the hand was just repositioned, so its fingers move
  /// fast. They must not hit objects away: no object becomes free before it is touched. `other_hands`: the newest
  /// coupling of each other hand.
  void begin_step(Nanoseconds now, bool settles, std::span<const ObjectCoupling> other_hands);
  void write_twins(ObjectCoupling& out) const;
  const ObjectMirrorCounters& counters() const { return counters_; }

  /// Copies the state of a mirror with the same objects. The simulations' states are copied apart from this.
  void take_state(const ObjectMirror& other);
  void save(ByteWriter& out) const;
  /// Call it for a mirror without objects. Puts objects into slots and joints into places as they were. Throws
  /// std::runtime_error if the bytes do not fit.
  void load(ByteReader& in);

 private:
  struct KnownObject {
    std::uint32_t id = 0;
    ObjectDescription description;
    std::shared_ptr<const ShapeGeometry> shape;  // shared with a mirror that copied this mirror's state
    MirroredObject mirrored;
    double bounding_radius = 0;
    ObjectState state;    // newest state from the world
    bool seen = false;    // `state` is valid
    bool listed = false;  // is in the newest world sample
    double distance = 0;  // m, to the hand; infinity if it is certainly out of reach
    double near = 0;      // m; the object is mirrored at or below this distance
    int slot = -1;
    std::uint32_t assembly = 0;  // id of one of the movable objects that joints connect; its own without joints
    bool jointed = false;        // the assembly has more than one object or a joint
    bool owned = false;
    bool is_free = false;  // it is a free body in this step: the hand owns it, or may touch it in this step
    Nanoseconds last_touch = 0;
  };

  struct KnownJoint {
    std::uint32_t id = 0;
    std::uint32_t parent = 0, child = 0;  // object ids
    JointLaw law;
    Pose parent_from_joint, child_from_joint;
    int place = -1;  // in the simulation; -1: does not act
  };

  /// Times (s) by which a sample of an object is extrapolated: to the start of the step that ends at `now`.
  /// `moving_part` is the part of the step in which the extrapolation limit allows motion.
  struct SampleStep {
    double to_start = 0;
    double moving_part = 1;
  };

  // Which objects get slots (object_slots.cpp).
  void measure_distances();
  void measure_distances_of(int hand);
  void measure_soft_distance(KnownObject& object) const;
  void give_slots(Nanoseconds now);
  void give_slot(std::size_t object, int slot, Nanoseconds now);
  bool get_slots_for_assembly(KnownObject& object, Nanoseconds now);
  void clear_slot(KnownObject& object);

  KnownObject* find_object(std::uint32_t id);
  void release(std::uint32_t assembly);
  void find_assemblies();
  void follow_or_own(KnownObject& object, Nanoseconds now, bool settles);
  bool is_guest(const KnownObject& object, Nanoseconds now) const;
  void take_patches(const KnownObject& object, Nanoseconds now);
  void follow(const KnownObject& object, Nanoseconds now, Nanoseconds sample_time, const Pose& pose,
              const Twist& velocity);
  void follow_world(const KnownObject& object, Nanoseconds now);
  void follow_owner(const KnownObject& object, Nanoseconds now);
  const ObjectCoupling* owner_of(const KnownObject& object, Nanoseconds now) const;
  void set_body(KnownObject& object, Nanoseconds now);
  void move_joints();
  void set_joint(const KnownJoint& joint, const KnownObject& parent, const KnownObject& child);
  /// Time (s) by which a sample is extrapolated to `time`. Negative if the sample is newer.
  double extrapolation(Nanoseconds sample_time, Nanoseconds time) const;
  SampleStep sample_step(Nanoseconds sample_time, Nanoseconds now) const;
  template <typename Object, typename Visit>
  static void visit_state(Object& object, Visit&& visit);

  HandSimulation& simulation_;
  const HandOptions& options_;
  HandKey hand_;
  bool symmetric_;
  double time_step_;
  LoadShape load_shape_;
  std::vector<KnownObject> objects_;
  std::vector<KnownJoint> joints_;
  std::vector<int> slot_object_;                 // index into objects_, -1 = free
  std::vector<int> waiting_;                     // indices into objects_ of near objects without a slot, nearest first
  std::span<const ObjectCoupling> other_hands_;  // valid in `begin_step` and until the next one
  Nanoseconds world_time_ = 0;
  bool knows_world_ = false;
  ObjectMirrorCounters counters_;
};

}  // namespace softhand
