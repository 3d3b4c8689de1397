// Plain values of everything that crosses a process boundary: one struct a topic of `common/bus/topics.hpp`, mirrored
// by idl/. No DDS here. All are trivially copyable, so that they are copied and compared bit for bit.
//
// Conventions (docs/topics.md): SI units; world frame right-handed, +Y up, -Z forward (OpenXR); quaternions xyzw;
// wrenches about the joint's origin (bones) or the centre of mass (objects), in world axes; times in nanoseconds of
// CLOCK_MONOTONIC; 0 = unknown.
#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "model/skeleton.hpp"

namespace softhand {

using Nanoseconds = std::int64_t;

/// A vector with room for `capacity` values in place: sequences on the wire, without allocation.
template <typename T, std::size_t capacity>
struct BoundedVector {
  std::array<T, capacity> items{};
  std::uint32_t count = 0;

  static constexpr std::size_t max_size() { return capacity; }
  std::size_t size() const { return count; }
  bool empty() const { return count == 0; }
  bool full() const { return count == capacity; }
  void clear() { count = 0; }
  /// False, and nothing changes, when full.
  bool push_back(const T& item) {
    if (full()) return false;
    items[count++] = item;
    return true;
  }
  T& operator[](std::size_t i) { return items[i]; }
  const T& operator[](std::size_t i) const { return items[i]; }
  T* begin() { return items.data(); }
  T* end() { return items.data() + count; }
  const T* begin() const { return items.data(); }
  const T* end() const { return items.data() + count; }
};

using Vec3 = std::array<double, 3>;  ///< wire form of a vector
using Vec4 = std::array<double, 4>;  ///< wire form of a quaternion, xyzw

/// Which hand; the DDS key of every topic about a hand.
struct HandKey {
  std::uint32_t user = 0;
  std::uint32_t side = 1;  ///< 0 left, 1 right
  bool operator==(const HandKey&) const = default;
};

/// Publish times of the samples that led to this one, carried along the chain so that motion-to-force can be measured
/// by hop.
struct Chain {
  Nanoseconds tracker_sample = 0;     ///< when the tracker's device took the sample
  Nanoseconds tracked_published = 0;  ///< softhand/v1/tracked_skeleton
  Nanoseconds intermediate_published = 0;
  Nanoseconds simulated_published = 0;
  Nanoseconds wrench_published = 0;
};

struct Stamp {
  std::uint64_t sequence = 0;   ///< counts up from 1 in each writer's life
  std::uint64_t epoch = 0;      ///< random, new with each start of the writing process
  std::uint32_t clock_id = 0;   ///< tells hosts apart: monotonic clocks of different hosts do not compare
  Nanoseconds sample_time = 0;  ///< when the content was true
  Nanoseconds publish_time = 0;
  Chain chain;
};

inline constexpr std::uint32_t kJointValid = 1;     ///< pose may be used
inline constexpr std::uint32_t kJointTracked = 2;   ///< measured, not guessed
inline constexpr std::uint32_t kJointInferred = 4;  ///< computed from other joints (a palm that the source lacks)

struct JointSample {
  Vec3 position{};
  Vec4 orientation{0, 0, 0, 1};
  Vec3 linear_velocity{};   ///< m/s of the joint's origin
  Vec3 angular_velocity{};  ///< rad/s, world axes
  double radius = 0;        ///< metres; 0 = unknown
  std::uint32_t flags = 0;
  std::uint32_t velocity_valid = 0;
};

/// tracked_skeleton, intermediate_skeleton, simulated_skeleton. Where joints are relative to a device, `frame` says so.
struct Skeleton {
  HandKey hand;
  Stamp stamp;
  std::uint32_t source = 0;  ///< id of the tracker daemon's source
  std::uint32_t frame = 0;   ///< 0 world, 1 device on a headset, 2 device on a desk: `tracking` composes the mount
  double confidence = 0;     ///< 0..1
  std::array<JointSample, kJointCount> joints;
};

/// head_pose: the headset in the world, for trackers that are mounted on it.
struct HeadPose {
  std::uint32_t user = 0;
  Stamp stamp;
  Vec3 position{};
  Vec4 orientation{0, 0, 0, 1};
  std::uint32_t valid = 0;
};

inline constexpr std::size_t kMaxSurfaceNodes = 8192;
/// tissue_surface: all tissue nodes, float32, relative to the simulated wrist joint's position, world axes.
struct TissueSurface {
  HandKey hand;
  Stamp stamp;
  Vec3 wrist_position{};
  BoundedVector<std::array<float, 3>, kMaxSurfaceNodes> nodes;
};

inline constexpr std::uint32_t kContactSticking = 1;
struct Contact {
  std::uint32_t node = 0;
  std::uint32_t body = 0;    ///< nearest bone, `Body`
  std::uint32_t finger = 0;  ///< `Finger`
  std::uint32_t object = 0;  ///< object id
  std::uint32_t flags = 0;   ///< kContactSticking
  Vec3 point{};              ///< anchor, world
  Vec3 normal{};             ///< outward of the object, world
  Vec3 force{};              ///< on the hand, N, world
  double penetration = 0;    ///< m, max(0, n . (x_a - x_n))
  double area = 0;           ///< m^2 that the node stands for
  double slip_speed = 0;     ///< m/s of the anchor on the object
};

inline constexpr std::size_t kMaxContacts = 512;
struct FingerContact {
  Vec3 force{};              ///< sum on the hand, N, world
  Vec3 centre{};             ///< centre of pressure, world; 0 without contact
  Vec3 normal{};             ///< force-weighted mean outward normal
  double area = 0;           ///< m^2
  double slip_speed = 0;     ///< force-weighted mean, m/s
  std::uint32_t object = 0;  ///< the one that takes most force
  std::uint32_t contact_count = 0;
};
struct Contacts {
  HandKey hand;
  Stamp stamp;
  std::array<FingerContact, 6> fingers;  ///< thumb..little, then palm
  std::uint32_t dropped = 0;             ///< contacts beyond kMaxContacts
  BoundedVector<Contact, kMaxContacts> contacts;
};

enum class ShapeKind : std::uint32_t { sphere = 0, box = 1, capsule = 2, cylinder = 3, plane = 4, convex_hull = 5 };
inline constexpr std::size_t kMaxHullVertices = 256;
/// Shape in its own frame; the object's body frame has its origin at the centre of mass.
struct Shape {
  std::uint32_t kind = 0;  ///< ShapeKind
  /// sphere: radius; box: half extents xyz; capsule, cylinder: radius, half length along y (capsule: without caps);
  /// plane: normal +y at y = 0.
  Vec3 size{};
  BoundedVector<Vec3, kMaxHullVertices> vertices;  ///< convex_hull only
};

/// object_description (transient local), key object id.
struct ObjectDescription {
  std::uint32_t object = 0;
  Stamp stamp;  ///< `sample_time`: states of before tell of the object as it was described before; 0: all tell of this
  std::array<char, 64> name{};  ///< zero-terminated
  std::uint32_t is_static = 0;
  double mass = 0;            ///< kg; 0 when static
  Vec3 inertia{};             ///< principal, kg m^2, body axes
  double friction = 0;        ///< Coulomb
  std::uint32_t removed = 0;  ///< 1: the object is gone
  Shape shape;
};

inline constexpr std::uint32_t kNeighbourStatic = 0;
inline constexpr std::uint32_t kNeighbourCompliant = 1;
inline constexpr std::uint32_t kNeighbourDynamic = 2;
/// What stops the object in the world: one half-space a neighbour.
struct NeighbourPlane {
  std::uint32_t neighbour = 0;  ///< object id
  std::uint32_t kind = 0;       ///< kNeighbour*
  Vec3 point{};                 ///< on the plane, world, at the state's stamp
  Vec3 normal{};                ///< towards the object
  Vec3 velocity{};              ///< of the neighbour at `point`, m/s
  double gap = 0;               ///< m, negative when overlapping
  double friction = 0;          ///< combined with the object's
  double stiffness = 0;         ///< N/m, compliant only
  double mass = 0;              ///< kg, dynamic only
};
inline constexpr std::size_t kMaxNeighbourPlanes = 8;
inline constexpr std::size_t kMaxObjects = 128;
struct ObjectState {
  std::uint32_t object = 0;
  std::uint32_t owner_user = 0;  ///< acknowledged owner, when `owned`
  std::uint32_t owner_side = 0;
  std::uint32_t owned = 0;  ///< 1: the world follows a hand's twin
  Vec3 position{};          ///< centre of mass
  Vec4 orientation{0, 0, 0, 1};
  Vec3 linear_velocity{};
  Vec3 angular_velocity{};
  Vec3 linear_acceleration{};
  Vec3 angular_acceleration{};
  Vec3 gravity{};  ///< m/s^2 that acts on the object now; zero while it floats, waiting for its first touch
  BoundedVector<NeighbourPlane, kMaxNeighbourPlanes> planes;  ///< only while the object is near a hand
};
/// objects: one consistent snapshot of every object that has not been removed, static ones too, a world step.
struct WorldObjects {
  std::uint32_t world = 0;  ///< key
  Stamp stamp;
  double step_period = 0;  ///< s, T of the world
  BoundedVector<ObjectState, kMaxObjects> objects;
};

/// object_coupling: the hand's twin of each mirrored object.
struct ObjectTwin {
  std::uint32_t object = 0;
  std::uint32_t owned = 0;  ///< 1: the twin carries mass, inertia and gravity (mode owner)
  Vec3 position{};
  Vec4 orientation{0, 0, 0, 1};
  Vec3 linear_velocity{};
  Vec3 angular_velocity{};
  Vec3 contact_force{};   ///< f_h, of the hand on the object, N
  Vec3 contact_torque{};  ///< about the centre of mass, N m
  Vec3 coupling_force{};  ///< of U'_crb on the twin (mode symmetric), N
  Vec3 coupling_torque{};
};
inline constexpr std::size_t kMaxMirrored = 16;
struct ObjectCoupling {
  HandKey hand;
  Stamp stamp;
  std::uint32_t mode = 0;  ///< 0 owner, 1 symmetric
  double step_period = 0;  ///< s, of the hand simulation
  BoundedVector<ObjectTwin, kMaxMirrored> twins;
};

/// bone_wrench: what a haptic driver needs (claim 14), about each bone's joint frame.
struct BoneSample {
  Vec3 tracked_position{};
  Vec4 tracked_orientation{0, 0, 0, 1};
  Vec3 intermediate_position{};
  Vec4 intermediate_orientation{0, 0, 0, 1};
  Vec3 simulated_position{};
  Vec4 simulated_orientation{0, 0, 0, 1};
  Vec3 coupling_force{};   ///< that the simulated hand exerts on the user's bone through the coupling, N
  Vec3 coupling_torque{};  ///< N m, about the joint's origin
  Vec3 contact_force{};    ///< sum of contact-point forces on this bone's tissue, N
};
struct BoneWrench {
  HandKey hand;
  Stamp stamp;
  std::uint32_t simulated_valid = 0;  ///< 0: no fresh simulated skeleton, forces are zero
  std::array<BoneSample, kBodyCount> bones;
};

inline constexpr std::size_t kMaxActuators = 32;
/// device_state: what a haptic or tactile daemon commands, key device id.
struct DeviceState {
  std::uint32_t device = 0;
  HandKey hand;
  Stamp stamp;
  std::uint32_t kind = 0;                         ///< 0 haptic, 1 tactile
  std::uint32_t live = 0;                         ///< 1: input fresh, commands follow it; 0: zeroed
  std::uint32_t clamped = 0;                      ///< steps in which the force clamp limited a command, since start
  std::uint32_t slewed = 0;                       ///< steps in which the slew rate limited a command, since start
  std::uint32_t stale = 0;                        ///< times the input went stale since start
  BoundedVector<double, kMaxActuators> commands;  ///< in the device's unit: N for haptic, N or 0..1 for tactile
};

using ShortText = std::array<char, 64>;
/// message: any user to every loaded module.
struct Message {
  Stamp stamp;
  std::uint64_t id = 0;
  ShortText module{};  ///< name of the addressed module, "*" = all; every module receives and answers
  ShortText key{};
  ShortText value{};
};
inline constexpr std::uint32_t kReplyIgnored = 0;  ///< not for this module, or key unknown
inline constexpr std::uint32_t kReplyApplied = 1;
inline constexpr std::uint32_t kReplyRefused = 2;  ///< for this module, bad value; text says what was expected
struct MessageReply {
  Stamp stamp;
  std::uint64_t id = 0;
  ShortText module{};
  std::uint32_t result = 0;
  std::array<char, 128> text{};
};

inline constexpr std::size_t kMaxCounters = 24;
inline constexpr std::size_t kMaxEnergyTerms = 12;
inline constexpr std::size_t kMaxLedgerRows = 12;
struct NamedValue {
  std::array<char, 32> name{};
  double value = 0;
};
/// loop_status: 10 Hz from every loop, key module name.
struct LoopStatus {
  ShortText module{};
  Stamp stamp;
  std::uint32_t process_id = 0;
  double rate_hz = 0;  ///< measured over the last second
  double nominal_rate_hz = 0;
  double step_ms_p50 = 0;  ///< of the last second's steps
  double step_ms_p99 = 0;
  double step_ms_p999 = 0;  ///< the slowest step, in a loop of less than 1000 Hz
  std::uint64_t steps = 0;
  std::uint64_t deadline_misses = 0;
  double input_age_ms =
      0;  ///< of the newest input sample, by its sample time, of devices since its arrival; negative = none yet
  std::uint64_t input_drops = 0;  ///< input samples lost or malformed on the way, as far as DDS knows
  double residual = 0;            ///< N, hand only
  std::uint32_t iterations = 0;
  std::uint32_t solver_status = 0;
  std::uint32_t contact_count = 0;
  std::uint32_t inverted_elements = 0;  ///< tetrahedra turned inside out now, hand only
  double penetration = 0;               ///< m, deepest contact now, hand only
  double coupling_stretch = 0;          ///< m, longest now of the springs between skeletons; hand, tracking
  double passivity_energy =
      0;  ///< J that the user put into the loop less what it gave back, haptic only; negative = it was active
  BoundedVector<NamedValue, kMaxEnergyTerms> energies;  ///< joules, by term
  BoundedVector<NamedValue, kMaxLedgerRows>
      ledger;  ///< joules since the loop began; docs/equations.md; empty = none is kept
  BoundedVector<NamedValue, kMaxCounters> counters;  ///< refused_nonfinite, refused_order, repositioned, ...
};

/// hand_description (transient local): what a display needs once; about 1 MB, so allocate it on the heap.
struct HandDescription {
  HandKey hand;
  Stamp stamp;
  std::uint32_t node_count = 0;
  BoundedVector<std::array<std::uint32_t, 4>, kMaxSkinVertices>
      vertex_nodes;  ///< the four nodes that carry each skin vertex
  BoundedVector<std::array<float, 4>, kMaxSkinVertices> vertex_weights;
  BoundedVector<std::array<std::uint32_t, 3>, kMaxSkinTriangles> triangles;  ///< outward
};

static_assert(std::is_trivially_copyable_v<Skeleton> && std::is_trivially_copyable_v<WorldObjects> &&
              std::is_trivially_copyable_v<Contacts> && std::is_trivially_copyable_v<LoopStatus> &&
              std::is_trivially_copyable_v<HandDescription>);

}  // namespace softhand
