// Options of the physics world: section [world] and the tables [[objects]] of a scene.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "model/object_model.hpp"
#include "model/soft_object.hpp"
#include "runtime/options.hpp"

namespace softhand {

struct WorldOptions {
  double rate_hz = 250;
  std::string engine = "bullet";
  std::array<double, 3> gravity{0, -9.81, 0};
  std::string mode = "owner";
  std::string soft = "hand";
  double follow_stiffness = 0.25;
  double staleness = 1;
  double stiffness = 500;
  double angular_stiffness = 0.1;
  double damping_ratio = 1;
};

struct VertexOptions {
  std::array<double, 3> at{0, 0, 0};
};

struct ObjectOptions {
  std::string name = "object";
  std::string shape = "box";
  double radius = 0.02;
  double half_length = 0.02;
  std::array<double, 3> half_extents{0.02, 0.02, 0.02};
  std::vector<VertexOptions> vertices;
  double mass = 0;
  double friction = 0.8;
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 4> orientation{0, 0, 0, 1};
  bool floating = false;
  std::string file;
  bool fixed = false;
  // Set by `add_file_objects`, not by a configuration file: the link of a loaded object file.
  std::shared_ptr<const ObjectModel> model;
  std::string sha256;
  std::size_t link = 0;
};

struct DetentOptions {
  double at = 0;
  double depth = 0;
  double width = 0.001;
  double period = 0;
};

/// A joint between two objects. Its coordinate is 0 where the scene places the objects.
struct JointOptions {
  std::string name = "joint";
  std::string kind = "hinge";
  std::string parent;
  std::string child;
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 3> axis{0, 1, 0};
  double pitch = 0;
  std::array<double, 2> limits{0, 0};
  double friction = 0;
  double load_friction = 0;
  double damping = 0;
  double stiffness = 0;
  double rest = 0;
  std::vector<DetentOptions> detents;
  // Set by `add_file_objects`, not by a configuration file: a joint of a loaded object file.
  std::shared_ptr<const ObjectModel> model;
  std::size_t number = 0;
};

inline void describe(OptionVisitor& v, VertexOptions& o) {
  v.numbers("at", o.at.data(), 3, "m", {-10, 10}, "A vertex in the shape's frame.");
}

inline void describe(OptionVisitor& v, WorldOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {30, 2000},
           "Rate of the world. Its step T is the reciprocal. 250 Hz gives a step of whole nanoseconds. It keeps the "
           "lag of a followed object (about 4 T^2 a) under a millimetre for motions of a hand. It costs about 3 % of "
           "a core for a table with ten objects.");
  v.choice("engine", o.engine, {"bullet"}, "The physics engine.");
  v.numbers("gravity", o.gravity.data(), 3, "m/s^2", {-100, 100},
            "Gravitational acceleration of every object that does not float.");
  v.choice("mode", o.mode, {"owner", "symmetric"},
           "owner: the hand simulation owns a touched object, and the world's copy follows it. symmetric: a spring "
           "on both sides (ES2725128A1, U'_crb).");
  v.choice(
      "soft", o.soft, {"hand", "world"},
      "Who simulates flexible objects. hand: the hand simulation, all the time. The world's copy follows. world: the "
      "world, while no hand owns them (docs/soft-objects.md).");
  v.number(
      "follow_stiffness", o.follow_stiffness, "1", {1e-3, 1e3},
      "Mode owner: stiffness between the world's copy and the twin, divided by m/T^2. Values above 1 are refused.");
  v.number("staleness", o.staleness, "periods", {0, 2},
           "Largest normal age of a copy in periods. It bounds the extrapolation of the twin.");
  v.number("stiffness", o.stiffness, "N/m", {1e-3, 1e7},
           "Mode symmetric: stiffness of the spring to the twin's position.");
  v.number("angular_stiffness", o.angular_stiffness, "N m/rad", {1e-9, 1e5},
           "Mode symmetric: stiffness of the spring to the twin's orientation.");
  v.number("damping_ratio", o.damping_ratio, "1", {0, 10},
           "Mode symmetric: damping towards the twin's velocity, divided by critical damping. ES2725128A1 has 0.");
}

inline void describe(OptionVisitor& v, ObjectOptions& o) {
  v.string("name", o.name, "Name of the object. Unique in the scene, at most 63 characters.");
  v.choice(
      "shape", o.shape, {"sphere", "box", "capsule", "cylinder", "plane", "convex_hull", "file"},
      "Shape. A plane is the half-space below y = 0 of its frame and must be static. file: all links and joints of "
      "an object file. Its links become the objects NAME.LINK, or NAME if there is one link. A flexible object "
      "becomes a part of the hand simulation.");
  v.string("file", o.file, "Object file: a path, or a name in config/objects. Only for the shape file.");
  v.flag("fixed", o.fixed, "The first link of the object file is static. Only for the shape file.");
  v.number("radius", o.radius, "m", {1e-4, 10}, "Radius of a sphere, capsule or cylinder.");
  v.number("half_length", o.half_length, "m", {1e-4, 10},
           "Half length along y of a cylinder, or of a capsule without its caps.");
  v.numbers("half_extents", o.half_extents.data(), 3, "m", {1e-4, 10}, "Half lengths of the edges of a box.");
  describe_list(v, "vertices", "Vertices of a convex hull: vertices = [{at = [x, y, z]}, ...], 4 to 256.", o.vertices);
  v.number("mass", o.mass, "kg", {0, 1e4},
           "Mass, distributed uniformly over the volume. 0 = static. The shape file has its own.");
  v.number("friction", o.friction, "1", {0, 1000},
           "Coulomb friction coefficient. A pair of objects uses the geometric mean. The shape file has its own.");
  v.numbers("position", o.position.data(), 3, "m", {-1000, 1000}, "Position of the shape's frame in the world.");
  v.numbers("orientation", o.orientation.data(), 4, "1", {-1, 1},
            "Orientation of the shape's frame in the world, a unit quaternion xyzw.");
  v.flag("floating", o.floating, "Gravity acts only after a hand has touched the object for the first time.");
}

inline void describe(OptionVisitor& v, DetentOptions& o) {
  v.number("at", o.at, "m or rad", {-1000, 1000}, "Coordinate of the bottom of the well.");
  v.number("depth", o.depth, "J", {-100, 100},
           "Depth of the well. Negative: a hump, for example the dome of a button.");
  v.number("width", o.width, "m or rad", {1e-6, 1000},
           "Half the width of the well. The largest force is 1.717 depth/width.");
  v.number("period", o.period, "m or rad", {0, 1000},
           "The well repeats at this distance, at least twice the width. 0 = one well.");
}

inline void describe(OptionVisitor& v, JointOptions& o) {
  v.string("name", o.name, "Name of the joint. Unique in the scene, at most 63 characters.");
  v.choice("kind", o.kind, {"fixed", "hinge", "slider", "ball", "screw"},
           "Kind of the joint. Its coordinate is an angle about the axis (hinge, screw) or a distance along the axis "
           "(slider). It is 0 where the scene places the objects.");
  v.string("parent", o.parent, "Name of one object. It may be static.");
  v.string("child", o.child, "Name of the other object. It must have a mass.");
  v.numbers("position", o.position.data(), 3, "m", {-10, 10}, "Place of the joint in the frame of the parent's shape.");
  v.numbers("axis", o.axis.data(), 3, "1", {-1, 1},
            "Direction of the joint's axis in the frame of the parent's shape. Any length but 0.");
  v.number("pitch", o.pitch, "m", {-1, 1},
           "Screw: travel of the child along the axis per turn. Negative: left-handed.");
  v.numbers("limits", o.limits.data(), 2, "m or rad", {-1000, 1000},
            "Lowest and highest coordinate. Ball: [0, largest angle between the axes]. [0, 0] = no limits.");
  v.number("friction", o.friction, "N or N m", {0, 1e4}, "Largest force or torque of dry friction.");
  v.number("load_friction", o.load_friction, "1 or m", {0, 10},
           "Dry friction per newton of the joint's reaction force. Slider: Coulomb's coefficient. Other kinds: "
           "coefficient times effective radius of the bearing. It adds to `friction`.");
  v.number("damping", o.damping, "N s/m or N m s/rad", {0, 1e4}, "Force or torque per speed.");
  v.number("stiffness", o.stiffness, "N/m or N m/rad", {0, 1e6}, "Stiffness of a spring about `rest`.");
  v.number("rest", o.rest, "m or rad", {-1000, 1000}, "Coordinate at which the spring has no force.");
  describe_list(v, "detents",
                "Wells that hold the coordinate: detents = [{at = 0, depth = 0.001, width = 0.002}], up to 8.",
                o.detents);
}

/// Replaces an entry of the shape file by its links, and appends its joints. The scene gives the pose of the first
/// link. Throws std::invalid_argument if the entry has a mass.
void add_file_objects(const ObjectOptions& entry, std::shared_ptr<const ObjectModel> model, const std::string& sha256,
                      std::vector<ObjectOptions>& objects, std::vector<JointOptions>& joints);

/// The law of a joint. Throws std::invalid_argument for an unknown kind or more than 8 detents.
JointLaw joint_law(const JointOptions& joint);

/// Returns every reason why a world cannot run, one sentence each with the value, the reason and the nearest value that
/// works. Empty if the world can run. `hand_step` (s) is the period of the coupled hand simulation.
std::vector<std::string> check_world(const WorldOptions& world, const std::vector<ObjectOptions>& objects,
                                     double hand_step = 1.0 / 90, const std::vector<JointOptions>& joints = {});

/// The same for the flexible objects. In mode symmetric the springs between the nodes of a shared one must not let
/// small deviations grow.
std::vector<std::string> check_soft_objects(const WorldOptions& world, const std::vector<SoftObject>& objects,
                                            double hand_step = 1.0 / 90);

/// A hand takes all objects that joints connect, or none. Returns a sentence for each such set that finds no room in a
/// hand. It has so many slots for movable objects, and so many places for joints.
std::vector<std::string> check_assemblies(const std::vector<ObjectOptions>& objects,
                                          const std::vector<JointOptions>& joints, std::int64_t slots,
                                          std::int64_t places);

/// Growth factor of the symmetric coupling of ES2725128A1, per period of the slower side. Two equal bodies are joined
/// by an implicit spring on both sides, with copies that are two periods old. Unstable above 1. `stiffness_per_mass` is
/// in 1/s^2. `damping_ratio` is relative to critical damping.
double symmetric_growth(double stiffness_per_mass, double damping_ratio, double world_step, double hand_step);

}  // namespace softhand
