// The tissue's material through the step's own kernels. Stress and stiffness of a uniformly deformed box follow from
// its nodal forces and Hessian.
#include <Eigen/Eigenvalues>
#include <algorithm>

#include "energies/corotational.hpp"
#include "energies/tissue.hpp"
#include "math/rotation.hpp"
#include "support/box_mesh.hpp"
#include "verification/cases.hpp"

namespace softhand::verification {
namespace {

using Matrix9 = Eigen::Matrix<double, 9, 9>;

Material material_of(const Parameters& p) {
  return {
      "tissue", 1000, p["youngs_modulus"], p["poisson_ratio"], p["limit_energy"], p["limit_ratio"] * p["limit_energy"]};
}

/// A box of tissue under one deformation gradient F, x = F X.
class UniformBox {
 public:
  explicit UniformBox(const Material& material)
      : box_(testing::box_mesh({1, 1, 1}, Vector3(0.02, 0.02, 0.02), material)),
        state_(testing::rest_state(box_)),
        tissue_(box_),
        matrix_(pattern()) {
    tissue_.bind(matrix_);
  }
  void deform(const Matrix3& f) { state_.node_positions = f * testing::rest_state(box_).node_positions; }
  /// First Piola-Kirchhoff stress: sum over the nodes of dU/dx X^T, per reference volume. Pa.
  Matrix3 stress() const {
    VectorX gradient = VectorX::Zero(state_.layout().dof_count());
    tissue_.add_gradient(state_, gradient);
    Matrix3 sum = Matrix3::Zero();
    for (int n = 0; n < box_.node_count(); ++n)
      sum += gradient.segment<3>(3 * n) * box_.nodes[static_cast<std::size_t>(n)].transpose();
    return sum / kVolume;
  }
  /// d vec P / d vec F, column by column. Pa.
  Matrix9 stiffness(Curvature curvature) {
    matrix_.set_zero();
    tissue_.add_hessian(state_, matrix_, curvature);
    Eigen::MatrixXd directions = Eigen::MatrixXd::Zero(3 * box_.node_count(), 9);
    for (int n = 0; n < box_.node_count(); ++n) {
      for (int j = 0; j < 3; ++j)
        directions.block<3, 3>(3 * n, 3 * j) = box_.nodes[static_cast<std::size_t>(n)][j] * Matrix3::Identity();
    }
    return directions.transpose() * matrix_.dense() * directions / kVolume;
  }

 private:
  static constexpr double kVolume = 0.02 * 0.02 * 0.02;
  BlockPattern pattern() const {
    BlockPattern pattern(box_.node_count());
    tissue_.add_pattern(pattern);
    return pattern;
  }
  HandModel box_;
  State state_;
  Tissue tissue_;
  BlockMatrix matrix_;
};

Parameters uniaxial_row(double ratio, double strain) {
  return {{"youngs_modulus", 1e5},
          {"poisson_ratio", 0.45},
          {"limit_energy", 500},
          {"limit_ratio", ratio},
          {"strain", strain}};
}

// Factors of stress and tangent: 1 up to the limit. Above the limit the stress factor is 1 + c (e^2/e_m^2 - 1), and
// `tangent` is the slope of factor times strain.
struct LimitFactor {
  double stress = 1, tangent = 1;
};
LimitFactor limit_factor(const Parameters& p) {
  const double c = p["limit_ratio"], e = p["strain"], limit = std::sqrt(2 * p["limit_energy"] / p["youngs_modulus"]);
  const double square = e * e / (limit * limit);
  return square > 1 ? LimitFactor{1 + c * (square - 1), 1 + c * (3 * square - 1)} : LimitFactor{};
}

Matrix3 uniaxial(const Parameters& p) {
  const double e = p["strain"], lateral = 1 - p["poisson_ratio"] * e;
  return Vector3(1 + e, lateral, lateral).asDiagonal();
}

std::vector<Measurement> uniaxial_stress(const Parameters& p) {
  UniformBox box(material_of(p));
  box.deform(uniaxial(p));
  const Matrix3 stress = box.stress();
  const double reference = p["youngs_modulus"] * p["strain"] * limit_factor(p).stress;
  const double rounding = 1e-9 * std::abs(reference);
  return {{"axial first Piola stress", stress(0, 0), reference, rounding, "Pa", {}},
          {"lateral stress", stress(1, 1), 0, rounding, "Pa", {}}};
}

std::vector<Measurement> uniaxial_tangent(const Parameters& p) {
  UniformBox box(material_of(p));
  box.deform(uniaxial(p));
  // Measures along the path F' = diag(1, -nu, -nu). Its lateral stresses stay zero.
  Eigen::Matrix<double, 9, 1> along = Eigen::Matrix<double, 9, 1>::Zero();
  along[0] = 1;
  along[4] = along[8] = -p["poisson_ratio"];
  const double reference = p["youngs_modulus"] * limit_factor(p).tangent;
  return {{"d stress / d strain",
           along.dot(box.stiffness(Curvature::exact) * along),
           reference,
           1e-9 * reference,
           "Pa",
           {}}};
}

std::vector<Measurement> shear_stress(const Parameters& p) {
  UniformBox box(material_of(p));
  const double g = p["shear"], r = std::sqrt(4 + g * g);
  Matrix3 f = Matrix3::Identity();
  f(0, 1) = g;
  box.deform(f);
  const CorotationalMaterial m = corotational_material(p["youngs_modulus"], p["poisson_ratio"], p["limit_energy"], 0);
  const double density = m.mu * r * (r - 2) + 0.5 * m.lambda * (r - 2) * (r - 2);
  const double factor = 1 + p["limit_ratio"] * std::max(0.0, density / p["limit_energy"] - 1);
  const double reference = g / r * (m.mu * (2 * r - 2) + m.lambda * (r - 2)) * factor;
  return {{"shear stress P12", box.stress()(0, 1), reference, 1e-9 * reference, "Pa", {}}};
}

// Eigenvalues of dP/dF at diag(s) below the limit: three twists, 2 mu five times, and 2 mu + 3 lambda (Smith, De Goes
// and Kim 2019).
std::vector<Measurement> hessian_eigenvalues(const Parameters& p) {
  UniformBox box(material_of(p));
  const Vector3 s(p["s1"], p["s2"], p["s3"]);
  box.deform(s.asDiagonal());
  const CorotationalMaterial m = corotational_material(p["youngs_modulus"], p["poisson_ratio"], p["limit_energy"], 0);
  const auto eigenvalues = [&box](Curvature curvature) {
    const Matrix9 matrix = box.stiffness(curvature);
    return Eigen::SelfAdjointEigenSolver<Matrix9>(0.5 * (matrix + matrix.transpose())).eigenvalues().eval();
  };
  std::vector<double> expected(5, 2 * m.mu);
  expected.push_back(2 * m.mu + 3 * m.lambda);
  for (int i = 0; i < 3; ++i) {
    const double sum = s[i] + s[(i + 1) % 3];
    expected.push_back(2 * m.mu + 2 * (m.lambda * (s.sum() - 3) - 2 * m.mu) / sum);
  }
  std::sort(expected.begin(), expected.end());
  const double tolerance = 1e-9 * (2 * m.mu + 3 * m.lambda);
  const auto exact = eigenvalues(Curvature::exact), projected = eigenvalues(Curvature::projected);
  std::vector<Measurement> found;
  double clamped = 0;
  for (Eigen::Index k = 0; k < 9; ++k) {
    const double reference = expected[static_cast<std::size_t>(k)];
    found.push_back({"eigenvalue " + std::to_string(k + 1) + " of dP/dF", exact[k], reference, tolerance, "Pa", {}});
    clamped = std::max(clamped, std::abs(projected[k] - std::max(0.0, reference)));
  }
  found.push_back({"projected eigenvalues: worst distance from max(0, exact)", clamped, 0, tolerance, "Pa", {}});
  return found;
}

std::vector<Measurement> uniform_compression(const Parameters& p) {
  UniformBox box(material_of(p));
  box.deform(p["stretch"] * Matrix3::Identity());
  const CorotationalMaterial m = corotational_material(p["youngs_modulus"], p["poisson_ratio"], p["limit_energy"], 0);
  const Matrix9 matrix = box.stiffness(Curvature::exact);
  const double least = Eigen::SelfAdjointEigenSolver<Matrix9>(0.5 * (matrix + matrix.transpose())).eigenvalues()[0];
  const double s = p["stretch"], reference = 2 * m.mu + (m.lambda * (3 * s - 3) - 2 * m.mu) / s;
  return {{"least eigenvalue of dP/dF", least, reference, 1e-9 * std::abs(reference), "Pa", {}}};
}

std::vector<Measurement> stress_difference(const Parameters& p) {
  UniformBox box(material_of(p));
  box.deform(Vector3(p["s1"], p["s2"], p["s3"]).asDiagonal());
  const Matrix3 stress = box.stress();
  const double reference = p["youngs_modulus"] / (1 + p["poisson_ratio"]);
  return {{"(P1 - P2)/(s1 - s2)",
           (stress(0, 0) - stress(1, 1)) / (p["s1"] - p["s2"]),
           reference,
           1e-6 * reference,
           "Pa",
           {}}};
}

/// A brick of 2 x 2 x 2 cells of six tetrahedra each. Every node is moved by up to a tenth of a cell per axis.
HandModel distorted_brick(const Parameters& p) {
  HandModel box = testing::box_mesh({2, 2, 2}, Vector3(0.02, 0.02, 0.02), material_of(p));
  testing::Random random(static_cast<std::uint64_t>(p.whole("seed")));
  for (Vector3& node : box.nodes) node += 0.001 * random.vector();
  return box;
}

std::vector<Measurement> patch_test(const Parameters& p) {
  const HandModel box = distorted_brick(p);
  Tissue tissue(box);
  State state = testing::rest_state(box);
  BlockPattern pattern(box.node_count());
  tissue.add_pattern(pattern);
  BlockMatrix matrix(pattern);
  tissue.bind(matrix);
  Matrix3 slope;
  slope << 0.02, 0.01, 0, 0, -0.01, 0.015, 0.005, 0, 0.01;
  const Matrix3 f = Matrix3::Identity() + p["amount"] * slope;
  state.node_positions = f * state.node_positions;
  constexpr int interior = 13;  // index of the interior node of 3 x 3 x 3 nodes
  const Vector3 expected = state.node_positions.col(interior);
  state.node_positions.col(interior) += Vector3(5e-4, -4e-4, 3e-4);
  for (int iteration = 0; iteration < 40; ++iteration) {
    VectorX gradient = VectorX::Zero(state.layout().dof_count());
    matrix.set_zero();
    tissue.add_all(state, gradient, matrix, Curvature::projected);
    const Matrix3 stiffness = matrix.dense().block<3, 3>(3 * interior, 3 * interior);
    state.node_positions.col(interior) -= stiffness.ldlt().solve(gradient.segment<3>(3 * interior));
  }
  const Material& m = box.materials.front();
  const CorotationalMaterial material = corotational_material(m);
  const CorotationalState uniform = evaluate_corotational(material, f);
  double density_spread = 0, stress_spread = 0;
  for (int e = 0; e < tissue.element_count(); ++e) {
    density_spread = std::max(density_spread, std::abs(tissue.energy_density(state, e) / uniform.density - 1));
    const auto& n = box.tetrahedra[static_cast<std::size_t>(e)];
    Matrix3 rest, now;
    for (int k = 0; k < 3; ++k) {
      const auto corner = static_cast<std::size_t>(n[static_cast<std::size_t>(k) + 1]),
                 origin = static_cast<std::size_t>(n[0]);
      rest.col(k) = box.nodes[corner] - box.nodes[origin];
      now.col(k) = state.node_positions.col(n[static_cast<std::size_t>(k) + 1]) - state.node_positions.col(n[0]);
    }
    const Matrix3 stress = evaluate_corotational(material, now * rest.inverse()).stress();
    stress_spread = std::max(stress_spread, (stress - uniform.stress()).norm() / uniform.stress().norm());
  }
  return {{"interior node from its affine place",
           (state.node_positions.col(interior) - expected).norm(),
           0,
           1e-9 * 0.02,
           "m",
           {}},
          {"stress: worst relative deviation from uniform", stress_spread, 0, 1e-9, "1", {}},
          {"energy density: worst relative deviation from uniform", density_spread, 0, 1e-9, "1", {}}};
}

std::vector<Measurement> rotation(const Parameters& p) {
  const HandModel box = distorted_brick(p);
  Tissue tissue(box);
  State state = testing::rest_state(box);
  state.node_positions =
      rotation_exp(p["degrees"] * M_PI / 180 * Vector3(1, 2, 3).normalized()).toRotationMatrix() * state.node_positions;
  VectorX gradient = VectorX::Zero(state.layout().dof_count());
  tissue.add_gradient(state, gradient);
  return {{"largest nodal force",
           gradient.lpNorm<Eigen::Infinity>(),
           0,
           1e-9 * p["youngs_modulus"] * 0.02 * 0.02,
           "N",
           {}}};
}

// A box is stretched along x by s, at constant width. Its second Piola-Kirchhoff stress without relaxation is
// S_e = m (2 mu + lambda)(s - 1)/s. This returns the s at which S_e is `stress`.
double stretch_at(double stress, const CorotationalMaterial& material) {
  double low = 1, high = 2;
  for (int i = 0; i < 60; ++i) {
    const double s = 0.5 * (low + high);
    const Matrix3 f = Vector3(s, 1, 1).asDiagonal().toDenseMatrix();
    (evaluate_corotational(material, f).stress()(0, 0) / s < stress ? low : high) = s;
  }
  return low;
}

// The stress S_e rises evenly for `ramp` seconds to beyond the strain limit and then stays. Steps of a hand at 90 Hz.
std::vector<Measurement> relaxation(const Parameters& p) {
  constexpr double kTimeStep = 1.0 / 90, kHold = 0.5, kStretch = 1.1;  // s, s, 1
  const PronySeries series{{0.004, 0.07, 1.4}, {{0.3, 0.2, 0.25}}};
  const Vector3 size(0.02, 0.02, 0.02);
  const HandModel box = testing::box_mesh({1, 1, 1}, size, material_of(p));
  const CorotationalMaterial material = corotational_material(box.materials[0]);
  const CorotationalState stretched =
      evaluate_corotational(material, Vector3(kStretch, 1, 1).asDiagonal().toDenseMatrix());
  const double most = stretched.stress()(0, 0) / kStretch;
  RelaxingTissue tissue(box, series);
  State state = testing::rest_state(box);
  const int rise = static_cast<int>(std::lround(p["ramp"] / kTimeStep));
  const double duration = rise * kTimeStep, rate = most / duration;
  const int end = rise + static_cast<int>(kHold / kTimeStep);
  std::vector<Measurement> rows;
  for (int i = 1; i <= end; ++i) {
    const double time = i * kTimeStep, stretch = stretch_at(rate * std::min(time, duration), material);
    State next = testing::rest_state(box);
    next.node_positions.row(0) *= stretch;
    tissue.begin_step(state, kTimeStep);
    VectorX gradient = VectorX::Zero(next.layout().dof_count());
    tissue.add_gradient(next, gradient);
    state = next;
    tissue.end_step(state);
    if (i != rise && i != end) continue;
    double sum = 0, stress = most;  // of x times force; second Piola-Kirchhoff
    for (int n = 0; n < box.node_count(); ++n) sum += gradient[3 * n] * box.nodes[static_cast<std::size_t>(n)].x();
    for (std::size_t b = 0; b < kRelaxationBranches; ++b) {
      const double constant = series.time_constants[b], held = time - duration;
      stress += series.weights[0][b] *
                (rate * constant * -std::expm1(-duration / constant) * std::exp(-held / constant) - most);
    }
    const double reference = stretch * stress;
    rows.push_back({i == end ? "stress after 0.5 s" : "stress at the end of the ramp",
                    sum / size.prod(),
                    reference,
                    0.01 * reference,
                    "Pa",
                    {}});
  }
  return rows;
}

Parameters brick_row(const std::string& key, double value) {
  return Parameters{
      {"youngs_modulus", 1e5}, {"poisson_ratio", 0.45}, {"limit_energy", 500}, {"limit_ratio", 1}, {"seed", 6}}
      .with(key, value);
}

Parameters stretched_row(double s1, double s2, double s3) {
  return {{"youngs_modulus", 1e5},
          {"poisson_ratio", 0.45},
          {"limit_energy", 1e12},
          {"limit_ratio", 0},
          {"s1", s1},
          {"s2", s2},
          {"s3", s3}};
}

}  // namespace

std::vector<Case> material_cases() {
  std::vector<Parameters> uniaxial_table, tangent_table, shear_table;
  for (const double strain : {0.05, 0.10, 0.15, 0.20, 0.30, -0.05, -0.15})
    uniaxial_table.push_back(uniaxial_row(1, strain));
  for (const double strain : {0.15, 0.20}) uniaxial_table.push_back(uniaxial_row(10, strain));
  // On both sides of the kink at 0.1.
  for (const double strain : {0.05, 0.1 * (1 - 1e-12), 0.1 * (1 + 1e-12), 0.2})
    tangent_table.push_back(uniaxial_row(1, strain));
  for (const double shear : {0.1, 0.2, 0.5}) {
    shear_table.push_back({{"youngs_modulus", 1e5},
                           {"poisson_ratio", 0.45},
                           {"limit_energy", 500},
                           {"limit_ratio", 1},
                           {"shear", shear}});
  }
  std::vector<Parameters> rotations;
  for (const double degrees : {1.0, 90.0, 179.99, 180.0}) rotations.push_back(brick_row("degrees", degrees));
  return {
      {"uniaxial_stress",
       "sigma = E e [1 + c (e^2/e_m^2 - 1)] for |e| > e_m = sqrt(2 W_max/E), else E e; no lateral stress at -nu e",
       uniaxial_table, uniaxial_stress},
      {"uniaxial_tangent", "E [1 + c (3 e^2/e_m^2 - 1)] above e_m, E below: the stiffness steps from E to E (1 + 2 c)",
       tangent_table, uniaxial_tangent},
      {"simple_shear", "P12 = (g/r) [mu (2 r - 2) + lambda (r - 2)] m, r = sqrt(4 + g^2), m the factor of eq. 27",
       shear_table, shear_stress},
      {"hessian_eigenvalues",
       "2 mu (5 times), 2 mu + 3 lambda, 2 mu + 2 (lambda (tr S - 3) - 2 mu)/(s_i + s_j)",
       {stretched_row(1.2, 0.9, 0.7)},
       hessian_eigenvalues},
      {"compressed_twist",
       "2 mu + (3 lambda (s - 1) - 2 mu)/s; -2.5 E at s = 0.8 and nu = 0.45",
       {{{"youngs_modulus", 1e5},
         {"poisson_ratio", 0.45},
         {"limit_energy", 1e12},
         {"limit_ratio", 0},
         {"stretch", 0.8}}},
       uniform_compression},
      {"stress_difference",
       "(P_i - P_j)/(s_i - s_j) = 2 mu",
       {stretched_row(1.2, 0.9, 0.7), stretched_row(1 + 1e-6, 1, 1), stretched_row(1.1, 0.8, -0.2)},
       stress_difference},
      {"patch_test",
       "an affine boundary gives an affine interior and a uniform stress, below and above the limit",
       {brick_row("amount", 1), brick_row("amount", 12)},
       patch_test},
      {"rotation", "no force under any rotation", rotations, rotation},
      {"relaxation",
       "the elastic stress rises at the rate r for T. S = c_0 r T + sum c r tau (1 - e^(-T/tau)) e^(-(t - T)/tau)",
       {brick_row("ramp", 0.02), brick_row("ramp", 0.1), brick_row("ramp", 1)},
       relaxation},
  };
}

}  // namespace softhand::verification
