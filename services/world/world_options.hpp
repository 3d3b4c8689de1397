// Options of the physics world: section [world] and the tables [[objects]] of a scene.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "runtime/options.hpp"

namespace softhand {

struct WorldOptions {
  double rate_hz = 250;
  std::string engine = "bullet";
  std::array<double, 3> gravity{0, -9.81, 0};
  std::string mode = "owner";
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
};

inline void describe(OptionVisitor& v, VertexOptions& o) {
  v.numbers("at", o.at.data(), 3, "m", {-10, 10}, "A vertex, in the shape's frame.");
}

inline void describe(OptionVisitor& v, WorldOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {30, 2000},
           "Rate of the world; its step T is the reciprocal. 250 Hz has a step of whole nanoseconds, keeps a followed "
           "object's lag (about 4 T^2 a) "
           "under a millimetre for what hands do, and costs about 3 % of a core for a table with ten objects.");
  v.choice("engine", o.engine, {"bullet"}, "The physics engine.");
  v.numbers("gravity", o.gravity.data(), 3, "m/s^2", {-100, 100}, "Acceleration on every object that does not float.");
  v.choice("mode", o.mode, {"owner", "symmetric"},
           "owner: a touched object belongs to the hand's simulation and the world's follows it. symmetric: a spring "
           "on both sides (ES2725128A1, U'_crb).");
  v.number("follow_stiffness", o.follow_stiffness, "1", {1e-3, 1e3},
           "Mode owner: stiffness of the world's copy to the twin over m/T^2; above 1 is refused.");
  v.number("staleness", o.staleness, "periods", {0, 2},
           "How many periods old a copy may be in normal running; bounds the extrapolation of the twin.");
  v.number("stiffness", o.stiffness, "N/m", {1e-3, 1e7},
           "Mode symmetric: stiffness of the spring to the twin's position.");
  v.number("angular_stiffness", o.angular_stiffness, "N m/rad", {1e-9, 1e5},
           "Mode symmetric: stiffness of the spring to the twin's orientation.");
  v.number("damping_ratio", o.damping_ratio, "1", {0, 10},
           "Mode symmetric: damping to the twin's velocity over the critical one; the text has 0.");
}

inline void describe(OptionVisitor& v, ObjectOptions& o) {
  v.string("name", o.name, "Name of the object, unique in the scene, at most 63 characters.");
  v.choice("shape", o.shape, {"sphere", "box", "capsule", "cylinder", "plane", "convex_hull"},
           "Its shape. A plane is the half-space below y = 0 of its frame, and static.");
  v.number("radius", o.radius, "m", {1e-4, 10}, "Of a sphere, capsule or cylinder.");
  v.number("half_length", o.half_length, "m", {1e-4, 10}, "Of a capsule (without its caps) or cylinder, along y.");
  v.numbers("half_extents", o.half_extents.data(), 3, "m", {1e-4, 10}, "Of a box.");
  describe_list(v, "vertices", "Of a convex hull: vertices = [{at = [x, y, z]}, ...], 4 to 256.", o.vertices);
  v.number("mass", o.mass, "kg", {0, 1e4}, "Mass, spread evenly over the volume; 0 = static.");
  v.number("friction", o.friction, "1", {0, 1000}, "Coulomb; between two objects the geometric mean holds.");
  v.numbers("position", o.position.data(), 3, "m", {-1000, 1000}, "Of the shape's frame, world.");
  v.numbers("orientation", o.orientation.data(), 4, "1", {-1, 1}, "Of the shape's frame, world; unit quaternion xyzw.");
  v.flag("floating", o.floating, "Gravity does not act before a hand first touches the object.");
}

/// Everything that is wrong with a world, one sentence each with the value, the reason and the nearest value that
/// works; empty when it can be run. `hand_step` (s) is the period of the hand simulation that it will be coupled to.
std::vector<std::string> check_world(const WorldOptions& world, const std::vector<ObjectOptions>& objects,
                                     double hand_step = 1.0 / 90);

/// Growth factor, per period of the slower side, of two equal bodies joined by an implicit spring on both sides whose
/// copies are two periods old: the text's symmetric coupling. Above 1 it is unstable. `stiffness_per_mass` in 1/s^2,
/// `damping_ratio` over critical.
double symmetric_growth(double stiffness_per_mass, double damping_ratio, double world_step, double hand_step);

}  // namespace softhand
