// Co-rotational tissue: polar decomposition, known results, invariances, derivatives.
#include "energies/tissue.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "energies/derivative_suite.hpp"
#include "support/box_mesh.hpp"
#include "support/scalar_tissue.hpp"

namespace softhand::tissue_test {
namespace {

using testing::corotational_hessian;
using testing::CorotationalHessian;
using testing::Random;

Matrix3 random_matrix(Random& random) {
  Matrix3 m;
  for (int c = 0; c < 3; ++c) m.col(c) = random.vector();
  return m;
}

void expect_svd(const Matrix3& f) {
  const RotationSvd svd = rotation_svd(f);
  const double size = std::max(f.norm(), 1e-300);
  EXPECT_LE((svd.u.transpose() * svd.u - Matrix3::Identity()).norm(), 1e-14) << f;
  EXPECT_LE((svd.v.transpose() * svd.v - Matrix3::Identity()).norm(), 1e-14) << f;
  EXPECT_NEAR(svd.u.determinant(), 1, 1e-14);
  EXPECT_NEAR(svd.v.determinant(), 1, 1e-14);
  EXPECT_LE((svd.u * svd.singular_values.asDiagonal() * svd.v.transpose() - f).norm(), 1e-14 * size) << f;
  EXPECT_GE(svd.singular_values[0], svd.singular_values[1] - 1e-15 * size);
  EXPECT_GE(svd.singular_values[1], std::abs(svd.singular_values[2]) - 1e-15 * size);
}

TEST(RotationSvd, HoldsForEveryKindOfMatrix) {
  Random random(1);
  for (int i = 0; i < 2000; ++i) expect_svd(random_matrix(random));
  for (const double tiny : {0.0, 1e-16, 1e-12, 1e-8, -1e-8, -1e-12, -1e-16}) {
    for (const Vector3& s : {Vector3(1, 1, 1 + tiny), Vector3(1, 1, -1 + tiny), Vector3(2, 1 + tiny, 1),
                             Vector3(2, 1 + tiny, -1), Vector3(1, tiny, tiny), Vector3(1, 1, tiny),
                             Vector3(1, tiny, -tiny), Vector3(tiny, tiny, tiny), Vector3(1, 2, tiny)}) {
      expect_svd(s.asDiagonal());
      for (int i = 0; i < 20; ++i) expect_svd(random.rotation() * s.asDiagonal() * random.rotation().transpose());
    }
  }
  expect_svd(Matrix3::Zero());
  expect_svd(1e200 * random_matrix(random));
  expect_svd(1e-200 * random_matrix(random));
  EXPECT_FALSE(rotation_svd(Matrix3::Constant(NAN)).rotation().allFinite());
}

TEST(RotationSvd, RecoversTheRotation) {
  Random random(2);
  for (int i = 0; i < 500; ++i) {
    const Matrix3 r = random.rotation(), q = random.rotation();
    const Vector3 stretch(1.3, 0.9, 0.2);
    const Matrix3 f = r * (q * stretch.asDiagonal() * q.transpose());
    EXPECT_LE((rotation_svd(f).rotation() - r).norm(), 1e-12);
  }
}

CorotationalMaterial skin(double c) { return corotational_material(1e5, 0.45, 500, 500 * c); }

TEST(Corotational, UniaxialStress) {
  const auto stress = [](double c, double e) {
    const CorotationalState s = evaluate_corotational(skin(c), Vector3(1 + e, 1 - 0.45 * e, 1 - 0.45 * e).asDiagonal());
    EXPECT_NEAR(s.stress()(1, 1), 0, 1e-6);
    return s.stress()(0, 0);
  };
  EXPECT_NEAR(stress(1, 0.05), 5000, 1e-6);
  EXPECT_NEAR(stress(1, 0.10), 10000, 1e-6);
  EXPECT_NEAR(stress(1, 0.15), 33750, 1e-6);
  EXPECT_NEAR(stress(1, 0.20), 80000, 1e-6);
  EXPECT_NEAR(stress(1, 0.30), 270000, 1e-5);
  EXPECT_NEAR(stress(10, 0.15), 202500, 1e-5);
  EXPECT_NEAR(stress(10, 0.20), 620000, 1e-5);
}

TEST(Corotational, SimpleShearStress) {
  const auto stress = [](double g) {
    Matrix3 f = Matrix3::Identity();
    f(0, 1) = g;
    return evaluate_corotational(skin(1), f).stress()(0, 1);
  };
  EXPECT_NEAR(stress(0.1), 3491.299, 1e-3);
  EXPECT_NEAR(stress(0.2), 10232.946, 1e-3);
  EXPECT_NEAR(stress(0.5), 222261.29, 1e-2);
}

Eigen::Matrix<double, 9, 9> dense(const CorotationalHessian& h) {
  Eigen::Matrix<double, 9, 9> matrix = h.identity * Eigen::Matrix<double, 9, 9>::Identity();
  for (std::size_t k = 0; k < 5; ++k) {
    const Eigen::Map<const Eigen::Matrix<double, 9, 1>> q(h.direction[k].data());
    matrix += h.weight[k] * q * q.transpose();
  }
  return matrix;
}

TEST(Corotational, HessianEigenvalues) {
  // W_max is out of reach, so the state is below the limit.
  const CorotationalMaterial material = corotational_material(1e5, 0.45, 1e12, 0);
  const CorotationalState state = evaluate_corotational(material, Vector3(1.2, 0.9, 0.7).asDiagonal());
  const auto eigenvalues = [&](Curvature curvature) {
    const auto matrix = dense(corotational_hessian(material, state, curvature));
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>>(matrix).eigenvalues().eval();
  };
  const auto exact = eigenvalues(Curvature::exact);
  EXPECT_NEAR(exact[0], -94827.59, 0.01);
  EXPECT_NEAR(exact[1], -68965.52, 0.01);
  EXPECT_NEAR(exact[2], -55829.23, 0.01);
  for (int k = 3; k < 8; ++k) EXPECT_NEAR(exact[k], 68965.52, 0.01);
  EXPECT_NEAR(exact[8], 1e6, 0.01);
  // The projected Hessian has the same eigenvalues, with the negative ones clamped.
  const auto projected = eigenvalues(Curvature::projected);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(projected[k], 0, 1e-6);
  for (int k = 3; k < 9; ++k) EXPECT_NEAR(projected[k], exact[k], 1e-6);
}

TEST(Corotational, FiniteAtDegenerateSingularValues) {
  const CorotationalMaterial material = corotational_material(1e5, 0.499, 500, 5e8);
  for (const double tiny : {0.0, -0.0, 1e-16, 1e-12, 1e-8, -1e-8, -1e-12}) {
    for (const Vector3& s :
         {Vector3(1, 1, 1 + tiny), Vector3(tiny, tiny, tiny), Vector3(2, tiny, tiny), Vector3(1, 1, -1 + tiny),
          Vector3(1, tiny, -tiny), Vector3(9, 1, -1 + tiny), Vector3(-1, -1, -1)}) {
      const CorotationalState state = evaluate_corotational(material, s.asDiagonal());
      EXPECT_TRUE(std::isfinite(state.density));
      EXPECT_TRUE(state.stress().allFinite());
      EXPECT_TRUE(dense(corotational_hessian(material, state, Curvature::exact)).allFinite());
      const Eigen::Matrix<double, 9, 9> projected = dense(corotational_hessian(material, state, Curvature::projected));
      ASSERT_TRUE(projected.allFinite());
      const double least = Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>>(projected).eigenvalues()[0];
      EXPECT_GE(least, -1e-12 * projected.norm());
    }
  }
}

TEST(Corotational, RefusesBadConstants) {
  for (const double limit : {0.0, -1.0, double(NAN)})
    EXPECT_THROW(corotational_material(1e5, 0.45, limit, 0), std::invalid_argument);
  EXPECT_THROW(corotational_material(0, 0.45, 1, 0), std::invalid_argument);
  EXPECT_THROW(corotational_material(1e5, 0.5, 1, 0), std::invalid_argument);
  EXPECT_THROW(corotational_material(1e5, 0.45, 1, -1), std::invalid_argument);
  for (const double ramp : {-0.1, 1.1, double(NAN)})
    EXPECT_THROW(corotational_material(1e5, 0.45, 1, 1, ramp), std::invalid_argument);
}

TEST(Corotational, ARampStiffensWithoutAJumpAndEndsAtTheSameStress) {
  constexpr double kLimit = 500, kStiffness = 5000, kStep = 1e-3;  // J/m^3
  for (const double ramp : {0.05, 0.25, 1.0}) {
    const CorotationalMaterial material = corotational_material(5e4, 0.3, kLimit, kStiffness, ramp),
                               without = corotational_material(5e4, 0.3, kLimit, kStiffness);
    const auto stretched = [](const CorotationalMaterial& m, double energy) {
      const double strain = std::sqrt(energy / (m.mu + 0.5 * m.lambda));
      return evaluate_corotational(m, Vector3(1 + strain, 1, 1).asDiagonal());
    };
    double last = 0;
    for (double energy = 0.5; energy < 1200; energy += 1) {
      const CorotationalState state = stretched(material, energy), next = stretched(material, energy + kStep);
      ASSERT_NEAR(state.quadratic, energy, 1e-9);
      EXPECT_NEAR((next.density - state.density) / kStep, 0.5 * (state.factor + next.factor), 1e-5) << energy;
      EXPECT_NEAR((next.factor - state.factor) / kStep, 0.5 * (state.stiffening + next.stiffening), 1e-7) << energy;
      // In a step of 1 J/m^3 it may grow by 1/(2 w W_max) of its end value.
      EXPECT_NEAR(state.stiffening, last, 1.01 * kStiffness / (kLimit * kLimit) / (2 * ramp * kLimit)) << energy;
      last = state.stiffening;
      if (energy <= (1 - ramp) * kLimit) {
        EXPECT_EQ(state.factor, 1) << energy;
      } else if (energy >= (1 + ramp) * kLimit) {
        EXPECT_NEAR(state.factor, stretched(without, energy).factor, 1e-12) << energy;
      }
    }
    EXPECT_NEAR(last, kStiffness / (kLimit * kLimit), 1e-12);
  }
}

// A distorted brick of tissue: every node is moved.
HandModel distorted(std::uint64_t seed, double nu = 0.45, double strain_limit_ramp = 0) {
  HandModel box =
      testing::box_mesh({2, 2, 2}, Vector3(0.02, 0.02, 0.02), {"skin", 1000, 1e5, nu, 500, 500, strain_limit_ramp});
  Random random(seed);
  for (auto& node : box.nodes) node += 0.0012 * random.vector();
  return box;
}

void place(State& state, const HandModel& box, const Matrix3& f) {
  for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) = f * box.nodes[static_cast<std::size_t>(n)];
}

TEST(Tissue, Derivatives) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const HandModel box = distorted(seed, 0.45, seed == 4 ? 1 : 0);
    Tissue tissue(box);
    State state = testing::rest_state(box);
    // Mild deformations, partly below and partly above the strain limit.
    for (const double amount : {0.0002, 0.002}) {
      Random random(seed + 10);
      for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += amount * random.vector();
      testing::DerivativeCheck check;
      check.step = 1e-7;
      check.tolerance = 2e-5;
      testing::check_term(tissue, state, 0.01, check);
      testing::check_balance(tissue, state);
    }
  }
}

TEST(Tissue, ElementsAroundNodesHaveTheirPartOfTheDerivatives) {
  const HandModel box = testing::box_mesh({4, 3, 3}, Vector3(0.04, 0.03, 0.03), {"skin", 1000, 1e5, 0.45, 500, 500});
  Tissue tissue(box);
  State state = testing::rest_state(box);
  Random random(5);
  for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += 0.002 * random.vector();
  const std::vector<std::int32_t> nodes{2, 3, 7, 20, 41};
  const Energy::Around before = testing::check_around(tissue, state, nodes);
  EXPECT_GT(before.share, 0);
  EXPECT_LT(before.share, 1);
  const double value = tissue.value(state);
  for (const std::int32_t node : nodes) state.node_positions.col(node) += 0.001 * random.vector();
  const Energy::Around after = testing::check_around(tissue, state, nodes);
  EXPECT_NEAR(after.energy - before.energy, tissue.value(state) - value, 1e-13 * value);
  EXPECT_EQ(after.share, before.share);
  const std::vector<std::int32_t> foreign{box.node_count()};  // a node of another part of the scene
  std::array<double, 3> gradient{};
  std::array<double, 18> blocks{};
  EXPECT_EQ(tissue.add_around(foreign, state, gradient.data(), blocks.data()).share, 0);
}

TEST(Tissue, RestIsStationaryAndRotationFree) {
  const HandModel box = distorted(4);
  Tissue tissue(box);
  State state = testing::rest_state(box);
  for (const double degrees : {0.0, 1.0, 90.0, 179.99, 180.0}) {
    place(state, box, Eigen::AngleAxisd(degrees * M_PI / 180, Vector3(1, 2, 3).normalized()).toRotationMatrix());
    VectorX gradient = VectorX::Zero(3 * box.node_count());
    tissue.add_gradient(state, gradient);
    EXPECT_LE(gradient.lpNorm<Eigen::Infinity>(), 1e-9 * 1e5 * 0.02 * 0.02) << degrees;
    EXPECT_NEAR(tissue.value(state), 0, 1e-20);
  }
  Random random(5);
  for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += 0.012 * random.vector();
  EXPECT_GT(tissue.inverted_elements(state), 0);
  testing::check_rigid_motion(tissue, state, {Vector3(0.1, -0.2, 0.3), Quaternion(0.3, -0.5, 0.7, 0.2).normalized()});
  testing::check_balance(tissue, state);
}

TEST(Tissue, PassesThePatchTestBelowAndAboveTheStrainLimit) {
  const HandModel box = distorted(6);
  Tissue tissue(box);
  State state = testing::rest_state(box);
  BlockMatrix matrix = testing::bound_matrix(tissue, state);
  const int interior = 13;  // the middle one of 3 x 3 x 3 nodes
  Matrix3 affine = Matrix3::Identity();
  affine << 1.02, 0.01, 0, 0, 0.99, 0.015, 0.005, 0, 1.01;
  for (const double amount : {1.0, 12.0}) {
    const Matrix3 f = Matrix3::Identity() + amount * (affine - Matrix3::Identity());
    place(state, box, f);
    EXPECT_EQ(tissue.energy_density(state, 0) > 500, amount > 1);
    state.node_positions.col(interior) += Vector3(5e-4, -4e-4, 3e-4);
    for (int iteration = 0; iteration < 40; ++iteration) {
      VectorX gradient = VectorX::Zero(3 * box.node_count());
      matrix.set_zero();
      tissue.add_all(state, gradient, matrix, Curvature::projected);
      const Matrix3 stiffness = matrix.dense().block<3, 3>(3 * interior, 3 * interior);
      state.node_positions.col(interior) -= stiffness.ldlt().solve(gradient.segment<3>(3 * interior));
    }
    EXPECT_LE((state.node_positions.col(interior) - f * box.nodes[interior]).norm(), 1e-9 * 0.02);
    for (int e = 1; e < tissue.element_count(); ++e) {
      EXPECT_NEAR(tissue.energy_density(state, e), tissue.energy_density(state, 0),
                  1e-9 * tissue.energy_density(state, 0));
      EXPECT_NEAR(tissue.von_mises_stress(state, e), tissue.von_mises_stress(state, 0),
                  1e-9 * tissue.von_mises_stress(state, 0));
    }
  }
}

TEST(Tissue, StatisticsOfUniaxialTension) {
  const HandModel box = distorted(7);
  const Tissue tissue(box);
  State state = testing::rest_state(box);
  place(state, box, Vector3(1.05, 1 - 0.45 * 0.05, 1 - 0.45 * 0.05).asDiagonal());
  EXPECT_EQ(tissue.inverted_elements(state), 0);
  EXPECT_NEAR(tissue.von_mises_stress(state, 0), 5000, 1e-6);
  EXPECT_NEAR(tissue.energy_density(state, 0), 0.5 * 5000 * 0.05, 1e-8);
  place(state, box, Vector3(1, 1, -1).asDiagonal());
  EXPECT_EQ(tissue.inverted_elements(state), tissue.element_count());
}

TEST(Tissue, IsFoldedBeyondTheMirrorImageButNotJustBeyondFlat) {
  HandModel box = distorted(7);
  for (Material& material : box.materials) material.strain_limit_energy = 1e9;
  const Tissue tissue(box);
  State state = testing::rest_state(box);
  const auto folded = [&](double width, double thickness) {
    place(state, box, Vector3(width, width, thickness).asDiagonal());
    return tissue.is_folded(state, 0);
  };
  EXPECT_FALSE(folded(1, 1));
  EXPECT_FALSE(folded(1, 4)) << "it holds more energy, but it is not inverted";
  EXPECT_FALSE(folded(1, -0.1));
  EXPECT_TRUE(folded(0.8, -0.8));
}

TEST(Tissue, RefusesFlatTetrahedraAndWrongIndices) {
  HandModel box = distorted(8);
  HandModel flat = box;
  const auto& t = flat.tetrahedra[0];
  flat.nodes[static_cast<std::size_t>(t[3])] = flat.nodes[static_cast<std::size_t>(t[0])];
  const auto refusal = [](const HandModel& hand) -> std::string {
    try {
      Tissue{hand};
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_NE(refusal(flat).find("no volume"), std::string::npos) << refusal(flat);
  HandModel no_material = box;
  no_material.tetrahedron_material[2] = 1;
  EXPECT_EQ(refusal(no_material), "Tissue: tetrahedron 2: material out of range");
  for (const std::int32_t node : {-1, 99}) {
    box.tetrahedra[3][1] = node;
    EXPECT_EQ(refusal(box), "Tissue: tetrahedron 3: node out of range");
  }
}

}  // namespace
}  // namespace softhand::tissue_test
