// Contact of a mirrored object with its neighbours in the world: the neighbour planes that the world publishes (mode
// owner, docs/coupling-objects.md). This is not in the source. There, mirrored objects interact with the world only
// through the symmetric spring.
//
//   U = sum over planes and resting points of  1/2 K min(0, u - u*)^2 + CoulombSpring(k min(mu, 1), mu f_n)(|s|)
//
// u is the height of the point above its plane at the step's end. s is its tangential stretch against the plane.
// Stiffness and damping form one square: K = k + b/dt and u* = (b/dt)/K min(u_0, 0). u_0 is the height at the step's
// start. So the damping acts from the surface on and never pulls.
//
// k and b are equal shares of k_A = max(10 kN/m, (m |g| + 5 N)/0.5 mm) and b_A = 2 sqrt(k_A m). If the neighbour is
// compliant, k_A is at most 0.2 of its stiffness, because more would not be stable. A compliant neighbour without
// stiffness pushes nothing: K = 0, and u* counts as 0. A share is 1 divided by the sum of the points' weights. The
// weight of a point falls from 1 at the lowest height to 0 at 1 mm above it. So a plane as a whole has k_A whether a
// corner, an edge or a face rests on it.
//
// As in contact.hpp, a point that is about to reach its plane is held from both sides, until an iteration has moved it
// (`revise`). The friction's bound uses the normal force at the end of the last step. A fresh point has no such force:
// its bound uses the force that stops its share of the object's mass. The stretch s persists from step to step and
// slides by Coulomb's law at the step's end. If the object rolls, the touching point moves over the object, and s is
// kept for the new point.
//
// Degrees of freedom: translation and rotation of the object's body. Units: J, m, N/m, N s/m.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "contact/coulomb.hpp"
#include "energies/clique.hpp"
#include "energies/memory.hpp"
#include "geometry/shape.hpp"
#include "messages/messages.hpp"

namespace softhand {

class PlaneContact final : public EnergyWithMemory<PlaneContact> {
 public:
  /// Objects are the bodies `first_body` ... `first_body + slots - 1`.
  PlaneContact(DofLayout layout, int first_body, int slots);

  /// Puts an object into the slot and ends its old contacts. `geometry` must outlive the object's stay in the slot.
  /// `mass` in kg, > 0. `weight` = m |g| in N.
  void set_object(int slot, const ShapeGeometry* geometry, double mass, double weight);
  /// Changes the weight (N) for the next call of `set_planes`. Contacts stay.
  void set_weight(int slot, double weight) { at(slot).weight = weight; }
  void clear_object(int slot);

  /// All that a step carries to the next one. The shapes are not part of it.
  struct Memory {
    struct Point {
      Vector3 stretch = Vector3::Zero();  // s, world, tangential
      double normal_force = 0;            // N
      bool sliding = false;
    };
    struct Plane {
      std::uint32_t neighbour = 0;
      Vector3 point = Vector3::Zero();  // at the start of the next step
      Vector3 normal = Vector3::UnitY();
      Vector3 velocity = Vector3::Zero();
      double friction = 0;
      double stiffness = 0;  // k_A
      std::size_t points = 0;
    };
    struct Slot {
      bool is_set = false;
      std::size_t plane_count = 0;
      double mass = 0, weight = 0;
      double stored = 0;  // of springs and friction after the last step, J
      Wrench wrench;      // on the object in the last step
      int count = 0;
    };
    std::vector<Slot> slots;
    std::vector<Plane> planes;           // in use, one slot after the other
    std::vector<Point> points;           // of these planes, one after the other
    double dissipated = 0, cleared = 0;  // J
  };
  const Memory& save() const;
  /// The slots must have the same objects as when the memory was saved. Throws std::invalid_argument otherwise.
  void load(const Memory& memory);
  /// The objects were repositioned: all contacts end. Planes stay.
  void reset();
  /// Sets the planes as they are at the start of the next step. Then they move with their velocity until they are set
  /// again. A plane keeps its friction state if its neighbour had a plane before with a normal within 26 degrees.
  void set_planes(int slot, std::span<const NeighbourPlane> planes);

  /// Wrench of all planes on the object in the last step, about its centre of mass, world axes.
  const Wrench& wrench(int slot) const { return at(slot).wrench; }
  /// Number of points that press on a plane.
  int count(int slot) const { return at(slot).count; }
  /// Heat of sliding since construction, J.
  double dissipated() const { return dissipated_; }

  std::string_view name() const override { return "plane_contact"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  /// The points that were about to reach their plane are held from one side from now on.
  bool revise(const State& state) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stored: 1/2 k min(0, u)^2 and the friction's springs. The normal force beyond k u counts as damping.
  EnergyFlow flow(double, double, double) const override { return flow_; }

 private:
  struct Point : Memory::Point {
    // Fixed within the step.
    Vector3 stretch_start = Vector3::Zero();   // the stretch in the plane of this step
    bool slides_on = false;                    // slid in the last step and still moves in that direction
    RestingPoint resting;                      // body axes, relative to the centre of mass
    Vector3 material = Vector3::Zero();        // the touching point of the object, body axes
    Vector3 material_start = Vector3::Zero();  // the same point in the world at the step's start
    double stiffness = 0;                      // K
    double target = 0;                         // u*
    bool fresh = false;                        // about to reach the plane, and no iteration has moved the point yet
    CoulombSpring friction;
    double predicted_secant = 0;
    double spring = 0;        // k
    double start_height = 0;  // min(u_0, 0)
  };
  struct Plane : Memory::Plane {
    Vector3 end_point = Vector3::Zero();  // at the end of the step
    std::size_t first_point = 0;          // in points_
  };
  struct Slot {
    const ShapeGeometry* geometry = nullptr;
    double mass = 0;
    double weight = 0;
    std::array<Plane, kMaxNeighbourPlanes> planes;
    std::size_t plane_count = 0;
    Clique<2> blocks;
    Wrench wrench;
    int count = 0;
    Pose start;               // of the body
    double start_energy = 0;  // of springs and friction at the start, with the planes of this step, J
    double stored = 0;        // of springs and friction after the last step, J
  };
  /// Energy and forces of a point at a state.
  struct Response {
    double energy = 0;
    Vector3 normal_force = Vector3::Zero();  // gradient, not force
    Vector3 friction_force = Vector3::Zero();
    Vector3 normal_arm, friction_arm;
    Vector3 stretch;
    double pressure = 0;
    double height = 0;  // u
    bool pushes = false;
  };
  static double stored(const Point& point, const Vector3& stretch, double height);
  Response respond(const Plane& plane, const Point& point, const Pose& body) const;
  std::span<Point> points_of(const Plane& plane) { return {points_.data() + plane.first_point, plane.points}; }
  std::span<const Point> points_of(const Plane& plane) const {
    return {points_.data() + plane.first_point, plane.points};
  }
  std::span<const Plane> planes_of(const Slot& slot) const { return {slot.planes.data(), slot.plane_count}; }
  Slot& at(int slot) { return slots_[static_cast<std::size_t>(slot)]; }
  const Slot& at(int slot) const { return slots_[static_cast<std::size_t>(slot)]; }
  void begin_plane(Slot& slot, Plane& plane, const Pose& body, const Twist& twist);

  int first_body_;
  std::vector<Slot> slots_;
  std::vector<Point> points_;        // most_resting_points for each plane of each slot
  std::vector<Point> saved_points_;  // points of one slot, saved while its planes are set
  std::vector<RestingPoint> resting_;
  double time_step_ = 0;
  double dissipated_ = 0;
  double cleared_ = 0;  // J stored in objects that were removed since the last step
  mutable Memory saved_;
  EnergyFlow flow_;
};

}  // namespace softhand
