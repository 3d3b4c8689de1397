// Bending of slender and of stocky tissue at rest under mesh refinement: the elastica and Cook's membrane.
#include <array>
#include <numeric>

#include "energies/inertia.hpp"
#include "energies/tissue.hpp"
#include "support/box_mesh.hpp"
#include "verification/cases.hpp"
#include "verification/supports.hpp"

namespace softhand::verification {
namespace {

/// The inextensible elastica, with lengths in units of L. It is clamped horizontally at s = 0 and free at s = 1.
///
/// The equation is theta'' = -m(s) cos theta with theta(0) = 0 and theta'(1) = 0.
/// - tip load: m = a, a = P L^2/(E I)
/// - weight: m = b (1 - s), b = q L^3/(E I)
///
/// It is solved by fourth-order Runge-Kutta and bisection on theta'(0).
class Elastica {
 public:
  Elastica(double tip_load, double weight) : tip_load_(tip_load), weight_(weight) {
    double low = 0, high = tip_load + weight;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (shoot(middle) > 0 ? high : low) = middle;
    }
  }
  static constexpr int kSteps = 2000;
  /// x, y (down) and theta at each of kSteps + 1 equal arc lengths.
  const std::array<Vector3, kSteps + 1>& curve() const { return curve_; }
  double tip_deflection() const { return curve_.back().y(); }

 private:
  // Returns theta'(1).
  double shoot(double slope) {
    using Vector4 = Eigen::Vector4d;  // x, y, theta, theta'
    const auto rate = [this](double s, const Vector4& u) {
      return Vector4(std::cos(u[2]), std::sin(u[2]), u[3], -(tip_load_ + weight_ * (1 - s)) * std::cos(u[2]));
    };
    Vector4 u(0, 0, 0, slope);
    constexpr double h = 1.0 / kSteps;
    curve_[0].setZero();
    for (int i = 0; i < kSteps; ++i) {
      const double s = i * h;
      const Vector4 k1 = rate(s, u), k2 = rate(s + h / 2, u + h / 2 * k1), k3 = rate(s + h / 2, u + h / 2 * k2),
                    k4 = rate(s + h, u + h * k3);
      u += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
      curve_[static_cast<std::size_t>(i) + 1] = u.head<3>();
    }
    return u[3];
  }
  double tip_load_, weight_;
  std::array<Vector3, kSteps + 1> curve_{};
};

/// Nodes whose rest coordinate on `axis` is `coordinate`.
std::vector<int> nodes_at(const HandModel& box, int axis, double coordinate) {
  std::vector<int> found;
  for (int n = 0; n < box.node_count(); ++n) {
    if (std::abs(box.nodes[static_cast<std::size_t>(n)][axis] - coordinate) < 1e-9) found.push_back(n);
  }
  return found;
}

/// Tip deflection over length of a strip of tissue with nu = 0, clamped at x = 0. The strip has `cells` bricks through
/// its thickness and one brick across.
double strip_deflection(const Parameters& p, int cells) {
  const double length = 0.1, height = length / p["slenderness"], youngs_modulus = p["youngs_modulus"];
  const int along = static_cast<int>(std::lround(p["slenderness"] * cells / p["brick_length"]));
  const double width = height / cells;
  const HandModel box =
      testing::box_mesh({along, cells, 1}, Vector3(length, height, width), {"strip", 1000, youngs_modulus, 0, 1e12, 0});
  const double second_moment = width * height * height * height / 12, rigidity = youngs_modulus * second_moment;
  const double tip_load = p["tip_load"] * rigidity / (length * length),
               weight = p["weight"] * rigidity / (length * length);

  State state = testing::rest_state(box);
  const std::vector<double> masses = lumped_masses(box);
  double total = 0;
  for (const double mass : masses) total += mass;
  Eigen::Matrix3Xd forces = Eigen::Matrix3Xd::Zero(3, box.node_count());
  for (int n = 0; n < box.node_count(); ++n) forces(1, n) = -weight * masses[static_cast<std::size_t>(n)] / total;
  const std::vector<int> end = nodes_at(box, 0, length);
  for (const int n : end) forces(1, n) -= tip_load / static_cast<double>(end.size());

  Tissue tissue(box);
  Inertia inertia(masses, 0);
  Supports wall(nodes_at(box, 0, 0), 1e4 * youngs_modulus * width * Matrix3::Identity(), state.node_positions);
  // So thin a strip would buckle sideways, so it is held in its plane. With nu = 0 this changes nothing else.
  std::vector<int> everywhere(static_cast<std::size_t>(box.node_count()));
  std::iota(everywhere.begin(), everywhere.end(), 0);
  Supports plane(everywhere, youngs_modulus * width * Vector3::UnitZ() * Vector3::UnitZ().transpose(),
                 state.node_positions);
  Load load(forces);
  // Newton's method starts at the elastica's shape, which saves load steps. The result does not depend on the start.
  const Elastica shape(p["tip_load"], p["weight"]);
  for (int n = 0; n < box.node_count(); ++n) {
    const Vector3& rest = box.nodes[static_cast<std::size_t>(n)];
    const Vector3& on = shape.curve()[static_cast<std::size_t>(std::lround(rest.x() / length * Elastica::kSteps))];
    const double across = rest.y() - 0.5 * height;
    state.node_positions.col(n) = Vector3(length * on.x() + across * std::sin(on.z()),
                                          0.5 * height - length * on.y() + across * std::cos(on.z()), rest.z());
  }
  NewtonSolver solver({&inertia, &tissue, &wall, &plane, &load}, state.layout(), resting(tip_load + weight));
  solver.step(state, kRestStep);
  // Stretching is stiff and bending is soft, so rounding of the energy ends the line search early. Newton's method
  // without line search continues from there.
  SolverOptions polish = resting(tip_load + weight);
  polish.line_search = false;
  polish.max_iterations = 20;
  polish.curvature = "exact";
  NewtonSolver last({&inertia, &tissue, &wall, &plane, &load}, state.layout(), polish);
  settle(last, state, tip_load + weight);
  double deflection = 0;
  for (const int n : end)
    deflection -=
        (state.node_positions(1, n) - box.nodes[static_cast<std::size_t>(n)].y()) / static_cast<double>(end.size());
  return deflection / length;
}

std::vector<Measurement> elastica(const Parameters& p) {
  const int cells = p.whole("cells");
  const double coarse = strip_deflection(p, cells), middle = strip_deflection(p, 2 * cells),
               fine = strip_deflection(p, 4 * cells);
  const Richardson result = extrapolate(coarse, middle, fine, 2);
  const double reference = Elastica(p["tip_load"], p["weight"]).tip_deflection();
  return {{"tip deflection / L, limit of the mesh", result.limit, reference, 0.01 * reference, "1",
           Order{result.order, 2, 0.3}}};
}

/// Cook's membrane as a slab with free faces and `cells` x `cells` x 1 bricks. Returns the vertical displacement at
/// (48, 52) times E t/F.
double cook_displacement(const Parameters& p, int cells) {
  const double youngs_modulus = p["youngs_modulus"], thickness = p["thickness"], force = p["force"];
  HandModel box =
      testing::box_mesh({cells, cells, 1}, Vector3(1, 1, 1), {"slab", 1, youngs_modulus, p["poisson_ratio"], 1e12, 0});
  const std::vector<int> left = nodes_at(box, 0, 0), right = nodes_at(box, 0, 1);
  for (Vector3& x : box.nodes)
    x = Vector3(48 * x.x(), (1 - x.x()) * 44 * x.y() + x.x() * (44 + 16 * x.y()), thickness * (x.z() - 0.5));
  State state = testing::rest_state(box);
  // A uniform shear load: every edge of the loaded side gives half of its load to each end.
  Eigen::Matrix3Xd forces = Eigen::Matrix3Xd::Zero(3, box.node_count());
  for (const int n : right) {
    const double y = box.nodes[static_cast<std::size_t>(n)].y();
    forces(1, n) = 0.5 * force / cells * (y < 44 + 1e-6 || y > 60 - 1e-6 ? 0.5 : 1.0);
  }
  Tissue tissue(box);
  Inertia inertia(lumped_masses(box), 0);
  Supports wall(left, 1e4 * youngs_modulus * thickness * Matrix3::Identity(), state.node_positions);
  Load load(forces);
  NewtonSolver solver({&inertia, &tissue, &wall, &load}, state.layout(), resting(force));
  settle(solver, state, force);
  double displacement = 0, count = 0;
  for (const int n : right) {
    if (std::abs(box.nodes[static_cast<std::size_t>(n)].y() - 52) > 1e-6) continue;
    displacement += state.node_positions(1, n) - 52;
    ++count;
  }
  return displacement / count * youngs_modulus * thickness / force;
}

std::vector<Measurement> cook(const Parameters& p) {
  const int cells = p.whole("cells");
  const double coarse = cook_displacement(p, cells), middle = cook_displacement(p, 2 * cells),
               fine = cook_displacement(p, 4 * cells);
  const double order = std::log2(std::abs((middle - coarse) / (fine - middle)));
  // The membrane's corners are singular, so the order is not two. The limit uses the observed order.
  const double limit = fine + (fine - middle) / (std::pow(2.0, order) - 1);
  return {{"u_y(48, 52) E t/F, limit of the mesh", limit, 23.96, 0.01 * 23.96, "1", Order{order, 1.75, 0.5}}};
}

Parameters strip_row(double tip_load, double weight) {
  return {{"tip_load", tip_load},  {"weight", weight}, {"slenderness", 20},
          {"youngs_modulus", 1e5}, {"cells", 4},       {"brick_length", 1}};
}

}  // namespace

std::vector<Case> bending_cases() {
  std::vector<Parameters> tip, weight;
  for (const double a : {2.0, 0.5, 1.0, 5.0, 10.0}) tip.push_back(strip_row(a, 0));
  for (const double b : {5.0, 1.0, 10.0}) weight.push_back(strip_row(0, b));
  return {
      {"elastica_tip_load", "theta'' = -a cos theta, a = P L^2/(E I); nu = 0, L/h = 20, thickness in 4, 8, 16 bricks",
       tip, elastica, 1},
      {"elastica_own_weight", "theta'' = -b (1 - s) cos theta, b = q L^3/(E I); nu, L/h and bricks as above", weight,
       elastica, 1},
      {"cooks_membrane",
       "23.96 F/(E t) at nu = 1/3 in plane stress (literature)",
       {{{"youngs_modulus", 1e6}, {"poisson_ratio", 1.0 / 3}, {"force", 100}, {"thickness", 1}, {"cells", 16}}},
       cook},
  };
}

}  // namespace softhand::verification
