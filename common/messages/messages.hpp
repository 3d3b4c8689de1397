// Plain structs for everything that crosses a process boundary: one struct per topic of `common/bus/topics.hpp`. idl/
// mirrors them. There is no DDS here. All structs are trivially copyable, so they can be copied and compared bit by
// bit.
//
// Conventions (docs/topics.md):
// Units: SI. Times are nanoseconds of CLOCK_MONOTONIC; 0 = unknown.
// World frame: right-handed, +Y up, -Z forward (OpenXR). Quaternions are stored as xyzw.
// Wrenches: about the joint's origin (bones) or the centre of mass (objects), in world axes.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "model/joint_law.hpp"
#include "model/object_model.hpp"
#include "model/skeleton.hpp"

namespace softhand {

using Nanoseconds = std::int64_t;
constexpr double kSecondsPerNanosecond = 1e-9;

/// Vector with in-place storage for `capacity` values: a sequence on the wire, without allocation.
template <typename T, std::size_t capacity>
struct BoundedVector {
  std::array<T, capacity> items{};
  std::uint32_t count = 0;

  static constexpr std::size_t max_size() { return capacity; }
  std::size_t size() const { return count; }
  bool empty() const { return count == 0; }
  bool full() const { return count == capacity; }
  void clear() { count = 0; }
  /// If the vector is full, returns false and changes nothing.
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

/// Identifies a hand. It is the DDS key of every topic about a hand.
struct HandKey {
  std::uint32_t user = 0;
  std::uint32_t side = 1;  ///< 0 left, 1 right
  bool operator==(const HandKey&) const = default;
};

/// Times at each hop that led to this sample. Every hop copies them, so the motion-to-force latency can be measured per
/// hop. 0 = this hop was not passed.
struct Chain {
  Nanoseconds tracker_sample = 0;     ///< when the tracker's device took the sample
  Nanoseconds tracked_published = 0;  ///< softhand/v1/tracked_skeleton
  Nanoseconds intermediate_published = 0;
  Nanoseconds simulated_published = 0;
  Nanoseconds wrench_published = 0;
};

struct Stamp {
  std::uint64_t sequence = 0;   ///< counts from 1 since the start of the writer
  std::uint64_t epoch = 0;      ///< random, new at each start of the writing process
  std::uint32_t clock_id = 0;   ///< identifies the host; monotonic clocks of different hosts cannot be compared
  Nanoseconds sample_time = 0;  ///< time at which the content was true
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
  Vec3 angular_velocity{};  ///< rad/s, axes of the skeleton's `frame`
  double radius = 0;        ///< metres; 0 = unknown
  std::uint32_t flags = 0;
  std::uint32_t velocity_valid = 0;
  double confidence = 1;  ///< 0..1, scales the coupling of the joint's bone to this sample
};

/// tracked_skeleton, intermediate_skeleton, simulated_skeleton. `frame` says whether the joints are relative to a
/// device.
struct Skeleton {
  HandKey hand;
  Stamp stamp;
  std::uint32_t source = 0;  ///< id of the tracker daemon's source
  std::uint32_t frame = 0;   ///< 0 world, 1 device on a headset, 2 device on a desk; `tracking` applies the mount
  double confidence = 0;     ///< 0..1
  std::array<JointSample, kJointCount> joints;
};

/// head_pose: pose of the headset in the world, for trackers that are mounted on it.
struct HeadPose {
  std::uint32_t user = 0;
  Stamp stamp;
  Vec3 position{};
  Vec4 orientation{0, 0, 0, 1};
  std::uint32_t valid = 0;
};

inline constexpr std::size_t kMaxSurfaceNodes = 8192;
/// tissue_surface: all tissue nodes as float32, relative to the position of the simulated wrist joint, world axes.
struct TissueSurface {
  HandKey hand;
  Stamp stamp;
  Vec3 wrist_position{};
  BoundedVector<std::array<float, 3>, kMaxSurfaceNodes> nodes;
};

inline constexpr std::uint32_t kContactSticking = 1;
struct Contact {
  std::uint32_t node = 0;    ///< the mesh node with the largest weight in the contact point
  std::uint32_t body = 0;    ///< nearest bone, `Body`
  std::uint32_t finger = 0;  ///< `Finger`
  std::uint32_t object = 0;  ///< object id
  std::uint32_t flags = 0;   ///< kContactSticking
  Vec3 point{};              ///< anchor, world
  Vec3 normal{};             ///< outward of the object, world
  Vec3 force{};              ///< on the hand, N, world
  double penetration = 0;    ///< m, max(0, n . (x_a - x_n))
  double area = 0;           ///< m^2 of skin around the contact point
  double slip_speed = 0;     ///< speed of the anchor on the object, m/s
  Vec3 velocity{};           ///< of the object's surface at `point`, m/s, world
};

inline constexpr std::size_t kMaxContacts = 512;
struct FingerContact {
  Vec3 force{};              ///< sum on the hand, N, world
  Vec3 centre{};             ///< centre of pressure, world; 0 without contact
  Vec3 normal{};             ///< force-weighted mean outward normal
  double area = 0;           ///< m^2
  double slip_speed = 0;     ///< force-weighted mean, m/s
  std::uint32_t object = 0;  ///< the object with the largest force; 0 without contact
  std::uint32_t contact_count = 0;
};
/// Where a bone that touches nothing would touch: its skin is near an object.
struct NearContact {
  std::uint32_t body = 0;    ///< `Body`
  std::uint32_t object = 0;  ///< object id
  Vec3 point{};              ///< on the object's surface, world
  Vec3 normal{};             ///< unit, outward of the object, world
  double gap = 0;            ///< m from the skin to the surface, > 0
  Vec3 velocity{};           ///< of the object's surface at `point`, m/s, world
};
struct Contacts {
  HandKey hand;
  Stamp stamp;
  std::array<FingerContact, 6> fingers;  ///< thumb..little, then palm
  std::uint32_t dropped = 0;             ///< number of contacts beyond kMaxContacts
  BoundedVector<Contact, kMaxContacts> contacts;
  BoundedVector<NearContact, kBodyCount> near;  ///< at most one per bone
};

inline constexpr std::size_t kMaxSkinRegions = 512;
/// The skin around a contact point of the hand. All vectors have the axes of the bone's joint. The force of the
/// contacts on it is area * (shear - pressure * normal).
struct SkinRegion {
  std::uint32_t region = 0;              ///< number of the contact point in the hand file
  std::uint32_t body = 0;                ///< nearest bone, `Body`
  std::uint32_t object = 0;              ///< id of the object with the largest force; 0: none, or the skin of a hand
  std::array<float, 3> place{};          ///< at rest, m, from the origin of the bone's joint; never changes
  std::array<float, 3> normal{};         ///< unit, outward of the skin where it touches now; zero if `area` is zero
  float pressure = 0;                    ///< on the touching skin, Pa
  std::array<float, 3> shear{};          ///< on the touching skin, across the normal, Pa
  std::array<float, 3> slip_velocity{};  ///< of the skin over the object, across the normal, m/s, mean by pressure
  float area = 0;                        ///< m^2 of skin that touches
  float area_rate = 0;                   ///< m^2/s, low-passed; positive: the contact grows
};
/// skin_traction: only the regions that touch, and those whose contact just ended.
struct SkinTraction {
  HandKey hand;
  Stamp stamp;
  BoundedVector<SkinRegion, kMaxSkinRegions> regions;  ///< by rising `region`
};

enum class ShapeKind : std::uint32_t {
  sphere = 0,
  box = 1,
  capsule = 2,
  cylinder = 3,
  plane = 4,
  convex_hull = 5,
  file = 6
};
inline constexpr std::size_t kMaxHullVertices = 256;
/// A link of an object file (docs/object-file.md). Receivers load the file by name and SHA-256.
struct ShapeFile {
  std::array<char, 64> name{};    ///< of the object, zero-terminated
  std::array<char, 65> sha256{};  ///< of the file's bytes, 64 lower-case hexadecimal digits
  std::uint32_t link = 0;         ///< index in the file
  Vec3 position{};                ///< the link's frame in the object's body frame, m
  Vec4 orientation{0, 0, 0, 1};
};
/// Shape in its own frame. The origin of the object's body frame is the centre of mass.
struct Shape {
  std::uint32_t kind = 0;  ///< ShapeKind
  /// sphere: radius; box: half extents xyz; capsule, cylinder: radius, half length along y (capsule: without caps);
  /// plane: normal +y at y = 0.
  Vec3 size{};
  BoundedVector<Vec3, kMaxHullVertices> vertices;  ///< convex_hull only
  BoundedVector<ShapeFile, 1> file;                ///< one entry if the kind is file, else none
};

/// The key `world` of a rig's own world. Other worlds in the domain belong to other programs.
inline constexpr std::uint32_t kRigWorld = 0;

/// object_description (transient local); key: world and object id.
struct ObjectDescription {
  std::uint32_t world = kRigWorld;  ///< as in WorldObjects
  std::uint32_t object = 0;
  /// States with an earlier sample_time than `stamp.sample_time` belong to the previous description of this object. 0:
  /// all states belong to this description.
  Stamp stamp;
  std::array<char, 64> name{};  ///< zero-terminated
  std::uint32_t is_static = 0;
  double mass = 0;            ///< kg; 0 when static
  Vec3 inertia{};             ///< principal, kg m^2, body axes
  double friction = 0;        ///< Coulomb
  std::uint32_t removed = 0;  ///< 1: the object was removed
  Shape shape;
};

/// A well in the potential of a joint's coordinate (`Detent` in model/joint_law.hpp).
struct JointDetent {
  double at = 0;      ///< m or rad
  double depth = 0;   ///< J; negative: a hump
  double width = 1;   ///< m or rad, > 0
  double period = 0;  ///< m or rad; 0: one well
};
/// object_joint (transient local): a joint between two objects; key: world and joint id. model/joint_law.hpp explains
/// the law.
struct ObjectJointDescription {
  std::uint32_t world = kRigWorld;  ///< as in WorldObjects
  std::uint32_t joint = 0;
  Stamp stamp;
  std::array<char, 64> name{};  ///< zero-terminated
  std::uint32_t removed = 0;    ///< 1: the joint was removed
  std::uint32_t kind = 0;       ///< ObjectJointKind
  std::uint32_t parent = 0;     ///< object id; may be static
  std::uint32_t child = 0;      ///< object id; can move
  Vec3 parent_position{};       ///< the joint's frame in the parent's body frame
  Vec4 parent_orientation{0, 0, 0, 1};
  Vec3 child_position{};  ///< the joint's frame in the child's body frame
  Vec4 child_orientation{0, 0, 0, 1};
  double pitch = 0;           ///< m per turn, screw only
  std::uint32_t limited = 0;  ///< 1: q stays between the limits
  double lower_limit = 0;
  double upper_limit = 0;
  double friction = 0;
  double load_friction = 0;
  double damping = 0;
  double stiffness = 0;
  double rest = 0;
  BoundedVector<JointDetent, kMaxDetents> detents;
};
inline constexpr std::size_t kMaxObjectJoints = 128;

inline constexpr std::uint32_t kNeighbourStatic = 0;
inline constexpr std::uint32_t kNeighbourCompliant = 1;
inline constexpr std::uint32_t kNeighbourDynamic = 2;
/// A neighbour that limits the object's motion in the world: one half-space per neighbour.
struct NeighbourPlane {
  std::uint32_t neighbour = 0;  ///< object id
  std::uint32_t kind = 0;       ///< kNeighbour*
  Vec3 point{};                 ///< on the plane, world, at the sample time of the snapshot
  Vec3 normal{};                ///< unit, towards the object
  Vec3 velocity{};              ///< of the neighbour at `point`, m/s
  double gap = 0;               ///< m, negative when overlapping
  double friction = 0;          ///< Coulomb coefficient combined with the object's
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
  Vec3 gravity{};  ///< m/s^2, acts on the object now; zero while it floats until its first touch
  BoundedVector<NeighbourPlane, kMaxNeighbourPlanes> planes;  ///< only while the object is near a hand
};
/// objects: a consistent snapshot of the world, one per world step. It holds every object that was not removed, static
/// objects included.
struct WorldObjects {
  std::uint32_t world = kRigWorld;  ///< key
  Stamp stamp;
  double step_period = 0;  ///< s, step period T of the world
  BoundedVector<ObjectState, kMaxObjects> objects;
};

/// object_coupling: the hand's twin of each mirrored object.
struct ObjectTwin {
  std::uint32_t object = 0;
  std::uint32_t owned = 0;  ///< 1: the twin has mass, inertia and gravity (mode owner)
  Vec3 position{};
  Vec4 orientation{0, 0, 0, 1};
  Vec3 linear_velocity{};
  Vec3 angular_velocity{};
  Vec3 contact_force{};   ///< f_h, from the hand on the object, N
  Vec3 contact_torque{};  ///< about the centre of mass, N m
  /// From U'_crb on the twin (mode symmetric), or from its joints with other objects and from other hands (mode
  /// owner), N.
  Vec3 coupling_force{};
  Vec3 coupling_torque{};
};
inline constexpr std::size_t kMaxMirrored = 16;
/// The contact of one bone with one object, for another hand that touches this object too. At `stamp.sample_time` and
/// the twin's pose it has this force. Then the contact moves (energies/other_hands.hpp).
struct ContactPatch {
  std::uint32_t object = 0;
  std::uint32_t body = 0;   ///< 0..20
  Vec3 point{};             ///< centre of pressure, m, world
  Vec3 normal{0, 1, 0};     ///< unit, from the hand into the object
  Vec3 force{};             ///< from the hand on the object, N
  Vec3 torque{};            ///< the same about `point`, N m
  Vec3 linear_velocity{};   ///< with which the contact moves, m/s
  Vec3 angular_velocity{};  ///< rad/s
  double stiffness = 0;     ///< N/m along the normal; across: times min(friction, 1)
  double radius = 0;        ///< m, root mean square distance of the contact points from `point`
  double friction = 0;
};
inline constexpr std::size_t kMaxPatches = 32;
struct ObjectCoupling {
  HandKey hand;
  Stamp stamp;
  std::uint32_t mode = 0;  ///< 0 owner, 1 symmetric
  double step_period = 0;  ///< s, of the hand simulation
  BoundedVector<ObjectTwin, kMaxMirrored> twins;
  BoundedVector<ContactPatch, kMaxPatches> patches;  ///< only of objects that another hand has too
};

/// bone_wrench: input of a haptic driver (claim 14), about each bone's joint frame.
struct BoneSample {
  Vec3 tracked_position{};
  Vec4 tracked_orientation{0, 0, 0, 1};
  Vec3 intermediate_position{};
  Vec4 intermediate_orientation{0, 0, 0, 1};
  Vec3 simulated_position{};
  Vec4 simulated_orientation{0, 0, 0, 1};
  Vec3 coupling_force{};   ///< from the simulated hand on the user's bone through the coupling, N
  Vec3 coupling_torque{};  ///< N m, about the joint's origin
  Vec3 contact_force{};    ///< sum of contact-point forces on this bone's tissue, N
  /// Local model: what the bone feels of its contacts until the next message. `coupling_force` is valid at the tracked
  /// pose and at `stamp.sample_time`. If the user's bone moves by d from there, with velocity v, the part of the force
  /// along the normal n changes by -(contact_stiffness n . (d - w t) + contact_damping n . (v - w)). The surface moves
  /// with velocity w, and t is the time since the sample time. The force never pulls.
  Vec3 contact_point{};          ///< world, centre of pressure of the bone's contacts
  Vec3 contact_normal{};         ///< unit, world, from the objects to the bone; 0 = no local model
  double contact_stiffness = 0;  ///< N/m, 0 to kMaxContactStiffness
  double contact_damping = 0;    ///< N s/m, 0 to kMaxContactDamping
  /// 0: the bone touches. Otherwise the bone is near an object: the plane does not push before the bone has moved this
  /// far against the normal, m. Negative: the user is already beyond it. Amount at most kMaxContactGap.
  double contact_gap = 0;
  Vec3 contact_velocity{};  ///< w, world, of the objects' surface at the contact point, m/s. At most kMaxContactSpeed
};
inline constexpr double kMaxContactStiffness = 1e5;
inline constexpr double kMaxContactDamping = 1e3;
inline constexpr double kMaxContactGap = 0.05;
inline constexpr double kMaxContactSpeed = 5;
struct BoneWrench {
  HandKey hand;
  Stamp stamp;
  std::uint32_t simulated_valid = 0;  ///< 0: no fresh simulated skeleton, forces are zero
  Vec3 wrist_velocity{};              ///< of the simulated wrist, m/s, world: for devices that the hand carries
  Vec3 wrist_angular_velocity{};      ///< the same, rad/s
  std::array<BoneSample, kBodyCount> bones;
};

inline constexpr std::size_t kMaxActuators = 32;
/// device_state: commands of a haptic or tactile daemon; key: device id.
struct DeviceState {
  std::uint32_t device = 0;
  HandKey hand;
  Stamp stamp;
  std::uint32_t kind = 0;     ///< 0 haptic, 1 tactile
  std::uint32_t live = 0;     ///< 1: input fresh, commands follow it; 0: commands are zero
  std::uint32_t clamped = 0;  ///< number of steps since start in which the force clamp limited a command
  std::uint32_t slewed = 0;   ///< number of steps since start in which the slew rate limited a command
  std::uint32_t stale = 0;    ///< number of times since start that the input became stale
  BoundedVector<double, kMaxActuators> commands;  ///< in the unit of the device: N for haptic, N or 0..1 for tactile
};

using ShortText = std::array<char, 64>;
/// message: a command from any user to every loaded module.
struct Message {
  Stamp stamp;
  std::uint64_t id = 0;
  ShortText module{};  ///< name of the addressed module, "*" = all; every module receives the message and answers
  ShortText key{};
  ShortText value{};
};
inline constexpr std::uint32_t kReplyIgnored = 0;  ///< not for this module, or unknown key
inline constexpr std::uint32_t kReplyApplied = 1;
inline constexpr std::uint32_t kReplyRefused = 2;  ///< for this module, bad value; text says what is expected
struct MessageReply {
  Stamp stamp;
  std::uint64_t id = 0;
  ShortText module{};
  std::uint32_t result = 0;
  std::array<char, 128> text{};
};

struct NamedValue {
  std::array<char, 32> name{};
  double value = 0;
};
// struct LoopStatus and its fields: the build writes them from idl/status.idl (docs/topics.md, "Add a field to the
// status").
#include "messages/loop_status.inc"

inline constexpr std::size_t kMaxChoices = 128;
struct RigChoice {
  ShortText what{};           ///< key of the message that chooses it: "scene", or the name of a process
  ShortText choice{};         ///< value of that message
  std::uint32_t running = 0;  ///< 1: it runs now
};
/// rig_choices: what a message to a rig can choose. `softhand up` writes it at its start and after each change. Key:
/// module name.
struct RigChoices {
  ShortText module{};  ///< addressee of the message
  Stamp stamp;
  BoundedVector<RigChoice, kMaxChoices> choices;
};

inline constexpr std::uint32_t kFirstSoftObject = 65536;  ///< ids of flexible objects begin here
inline constexpr std::size_t kMaxSoftObjects = 8;
/// soft_object_description: a flexible object (docs/soft-objects.md). The hand's process that simulates it writes it.
/// Key: object id.
struct SoftObjectDescription {
  std::uint32_t object = 0;
  Stamp stamp;
  HandKey owner;     ///< the hand whose process simulates the object
  ShortText name{};  ///< in the scene
  ShapeFile file;    ///< its nodes, tetrahedra and material; link 0; the pose is that at the start, world
  std::uint32_t node_count = 0;
  double mass = 0;
  std::uint32_t removed = 0;  ///< 1: the object was removed
};
/// soft_object_state: the nodes of a flexible object, of the hand's process. soft_object_copy: the same of the world,
/// if `world.soft` is "world". Key: object id. About 96 kB.
struct SoftObjectState {
  std::uint32_t object = 0;
  Stamp stamp;
  HandKey owner;
  std::uint32_t owned = 0;          ///< 1: the hand's process moves the object; 0: the world does
  Vec3 centre{};                    ///< centre of mass, m, world
  Vec3 linear_velocity{};           ///< of the centre of mass, m/s
  Vec3 hand_force{};                ///< from the hand on the object, N, world
  std::uint32_t contact_count = 0;  ///< number of contact points between the hand and the object
  std::uint32_t inverted_elements = 0;
  BoundedVector<std::array<float, 3>, kMaxSoftNodes> nodes;       ///< m, relative to `centre`, order of the file
  BoundedVector<std::array<float, 3>, kMaxSoftNodes> velocities;  ///< m/s, relative to `linear_velocity`
};

inline constexpr std::size_t kMaxHosts = 16;
/// Another host, as the writer's host sees it.
struct HostClock {
  std::uint32_t clock_id = 0;  ///< of the other host
  Nanoseconds sent = 0;        ///< publish time of its newest beacon, on its clock
  Nanoseconds received = 0;    ///< arrival of that beacon, on the writer's clock
  Nanoseconds offset = 0;      ///< time of the writer's clock = time of the other clock + offset
  double uncertainty = -1;     ///< s, the true offset is within +- this; negative: the offset is not known
  double drift = 0;            ///< s/s, growth of the offset
};
/// clock_beacon: stamps for the offsets of clocks. Only processes that communicate with other hosts write it.
struct ClockBeacon {
  Stamp stamp;
  Nanoseconds wall_offset = 0;   ///< CLOCK_REALTIME minus CLOCK_MONOTONIC
  double wall_uncertainty = -1;  ///< s, of the wall clock; negative: PTP or NTP does not keep it
  BoundedVector<HostClock, kMaxHosts> hosts;
};

/// hand_description (transient local): data that a display needs once. About 1 MB, so allocate it on the heap.
struct HandDescription {
  HandKey hand;
  Stamp stamp;
  std::uint32_t node_count = 0;
  /// The four nodes that move each skin vertex.
  BoundedVector<std::array<std::uint32_t, 4>, kMaxSkinVertices> vertex_nodes;
  BoundedVector<std::array<float, 4>, kMaxSkinVertices> vertex_weights;
  BoundedVector<std::array<std::uint32_t, 3>, kMaxSkinTriangles> triangles;  ///< skin vertices; outward orientation
};

static_assert(std::is_trivially_copyable_v<Skeleton> && std::is_trivially_copyable_v<WorldObjects> &&
              std::is_trivially_copyable_v<Contacts> && std::is_trivially_copyable_v<LoopStatus> &&
              std::is_trivially_copyable_v<HandDescription>);

}  // namespace softhand
