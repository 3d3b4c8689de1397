// Compares the tissue's batched kernels with the scalar reference, for every kind of deformation and every instruction
// set of this processor.
#include <gtest/gtest.h>

#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "energies/derivative_suite.hpp"
#include "energies/tissue.hpp"
#include "support/box_mesh.hpp"
#include "support/cores.hpp"
#include "support/scalar_tissue.hpp"

namespace softhand::tissue_kernel_test {
namespace {

using testing::Random;

std::vector<InstructionSet> supported_sets() {
  std::vector<InstructionSet> sets;
  for (const InstructionSet set : kInstructionSets) {
    if (is_supported(set)) sets.push_back(set);
  }
  return sets;
}

// Tetrahedra without common nodes, so that the results of each one can be checked.
HandModel loose_tetrahedra(int count, Random& random) {
  HandModel hand;
  hand.materials = {{"soft", 1000, 1e5, 0.45, 500, 500},
                    {"stiff", 1000, 1e6, 0.3, 50, 5e4},
                    {"unlimited", 1000, 2e5, 0.499, 1e12, 0},
                    {"with a ramp", 1000, 1e5, 0.45, 500, 500, 0.25},
                    {"with the longest ramp", 1000, 1e6, 0.3, 500, 5e4, 1}};
  for (int e = 0; e < count; ++e) {
    const std::int32_t first = 4 * e;
    hand.nodes.push_back(0.01 * random.vector());
    for (int a = 0; a < 3; ++a) {
      Vector3 edge = 0.001 * random.vector();
      edge[a] += 0.004;
      hand.nodes.push_back(hand.nodes[static_cast<std::size_t>(first)] + edge);
    }
    hand.tetrahedra.push_back({first, first + 1, first + 2, first + 3});
    hand.tetrahedron_material.push_back(static_cast<std::uint8_t>(e % 5));
  }
  return hand;
}

// Places element `e` with deformation gradient `f`.
void deform(State& state, const HandModel& hand, int e, const Matrix3& f) {
  const Vector3 origin = hand.nodes[static_cast<std::size_t>(4 * e)];
  for (int a = 0; a < 4; ++a) {
    state.node_positions.col(4 * e + a) = origin + f * (hand.nodes[static_cast<std::size_t>(4 * e + a)] - origin);
  }
}

struct Outcome {
  double value = 0;
  VectorX gradient;
  BlockMatrix hessian, exact;
};

Outcome evaluate(Energy& term, const State& state) {
  Outcome outcome;
  outcome.hessian = testing::bound_matrix(term, state);
  outcome.exact = outcome.hessian;
  outcome.gradient = VectorX::Zero(state.layout().dof_count());
  outcome.value = term.add_all(state, outcome.gradient, outcome.hessian, Curvature::projected);
  term.add_hessian(state, outcome.exact, Curvature::exact);
  return outcome;
}

// Expects equal numbers, and NaN at the same places.
void expect_same(std::span<const double> left, std::span<const double> right, const std::string& what) {
  ASSERT_EQ(left.size(), right.size());
  std::size_t different = 0;
  for (std::size_t i = 0; i < left.size(); ++i)
    different += left[i] == right[i] || (std::isnan(left[i]) && std::isnan(right[i])) ? 0 : 1;
  EXPECT_EQ(different, 0u) << what << ", of " << left.size();
}

std::span<const double> numbers(const VectorX& vector) {
  return {vector.data(), static_cast<std::size_t>(vector.size())};
}

void expect_same(const Outcome& left, const Outcome& right) {
  expect_same({&left.value, 1}, {&right.value, 1}, "value");
  expect_same(numbers(left.gradient), numbers(right.gradient), "gradient");
  expect_same(left.hessian.values(), right.hessian.values(), "projected Hessian");
  expect_same(left.exact.values(), right.exact.values(), "exact Hessian");
}

// The worst difference, relative to the largest entry of each element's gradient or Hessian. `floor` is the least such
// scale of each element, because terms of a gradient may cancel.
double worst_difference(std::span<const double> left, std::span<const double> right, std::size_t entries,
                        const std::vector<double>& floor) {
  double worst = 0;
  for (std::size_t e = 0; e < left.size() / entries; ++e) {
    double largest = floor[e], difference = 0;
    for (std::size_t i = e * entries; i < (e + 1) * entries; ++i) {
      largest = std::max(largest, std::abs(right[i]));
      difference = std::max(difference, std::abs(left[i] - right[i]));
    }
    worst = std::max(worst, difference / largest);
  }
  return worst;
}

struct Kind {
  const char* name;
  Vector3 least, most;  // the range of each singular value
};

// s_2 + s_3 stays away from zero relative to s_1. Otherwise the polar rotation is undefined, and so are the compared
// results.
const std::vector<Kind> kKinds{{"near rest", Vector3::Constant(0.999), Vector3::Constant(1.001)},
                               {"at rest, turned", Vector3::Ones(), Vector3::Ones()},
                               {"within the strain limit and beyond", Vector3::Constant(0.8), Vector3::Constant(1.2)},
                               {"large", Vector3::Constant(0.3), Vector3::Constant(3)},
                               {"inverted", Vector3(1.2, 0.7, -0.6), Vector3(1.5, 1.1, -0.01)},
                               {"flat", Vector3(1, 1, 0), Vector3(1, 1, 0)},
                               {"equal in pairs", Vector3(1.3, 0.7, 0.7), Vector3(1.3, 0.7, 0.7)},
                               {"tiny", Vector3::Constant(1e-8), Vector3::Constant(3e-8)},
                               {"huge", Vector3::Constant(3e2), Vector3::Constant(1e3)}};

TEST(TissueKernel, EqualsTheScalarReference) {
  Random random(1);
  const int count = 203;  // not a multiple of the batch
  const HandModel hand = loose_tetrahedra(count, random);
  testing::ScalarTissue reference(hand);
  State state = testing::rest_state(hand);
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.name);
    std::vector<double> force_scale, stiffness_scale(static_cast<std::size_t>(count), 0.0);
    for (int e = 0; e < count; ++e) {
      Vector3 s = kind.least;
      for (int k = 0; k < 3; ++k) s[k] += 0.5 * (random() + 1.0) * (kind.most[k] - kind.least[k]);
      // Some rotations are about coordinate axes or by half a turn. There off-diagonals vanish and differences cancel.
      Matrix3 r = random.rotation(), q = random.rotation();
      if (e % 5 == 0) r = Eigen::AngleAxisd(M_PI, random.vector().normalized()).toRotationMatrix();
      if (e % 7 == 0) q = Matrix3::Identity();
      if (e % 11 == 0) r = Matrix3::Identity();
      deform(state, hand, e, r * q * s.asDiagonal() * q.transpose());
      // The scale is the force at strains of order one, because F - R cancels near rest.
      const Material& m = hand.materials[hand.tetrahedron_material[static_cast<std::size_t>(e)]];
      const CorotationalMaterial c = corotational_material(m);
      force_scale.push_back((2 * c.mu + 3 * c.lambda) * 0.004 * 0.004);
    }
    const Outcome expected = evaluate(reference, state);
    for (const InstructionSet set : supported_sets()) {
      SCOPED_TRACE(std::string(to_string(set)));
      Tissue tissue(hand, set);
      const Outcome outcome = evaluate(tissue, state);
      EXPECT_NEAR(outcome.value, expected.value, 1e-12 * expected.value + 1e-24);
      EXPECT_EQ(tissue.value(state), outcome.value);
      VectorX gradient = VectorX::Zero(outcome.gradient.size());
      tissue.add_gradient(state, gradient);
      expect_same(numbers(gradient), numbers(outcome.gradient), "gradient alone");
      EXPECT_LE(worst_difference(numbers(outcome.gradient), numbers(expected.gradient), 12, force_scale), 1e-12);
      EXPECT_LE(worst_difference(outcome.hessian.values(), expected.hessian.values(), 90, stiffness_scale), 1e-12);
      EXPECT_LE(worst_difference(outcome.exact.values(), expected.exact.values(), 90, stiffness_scale), 1e-12);
    }
  }
}

TEST(TissueKernel, DegenerateDeformationsGiveTheRightEnergyAndStayFinite) {
  Random random(2);
  const std::vector<Vector3> stretches{{0, 0, 0},          {2, 0, 0},           {1, 1e-8, -1e-8}, {1, 1, -1},
                                       {1, 1, -1 + 1e-12}, {-1, -1, -1},        {3, 3, -3},       {1e3, 1, 1e-8},
                                       {1, 1e-16, 0},      {1e-160, 0, 1e-160}, {1e60, 1, 1},     {1e3, 1e-8, -1e-8},
                                       {1e-310, 0, 0},     {1, 1e-130, 0},      {1, 1, 1e-140}};
  const HandModel hand = loose_tetrahedra(1, random);
  testing::ScalarTissue reference(hand);
  State state = testing::rest_state(hand);
  // Centred at the origin. Otherwise a difference of positions would round tiny stretches away.
  HandModel centred = hand;
  for (auto& node : centred.nodes) node -= hand.nodes[0];
  for (const Vector3& s : stretches) {
    for (int i = 0; i < 10; ++i) {
      const Matrix3 r = i < 2 ? Matrix3(Matrix3::Identity()) : random.rotation();
      const Matrix3 q = i % 2 == 0 ? Matrix3(Matrix3::Identity()) : random.rotation();
      deform(state, centred, 0, r * s.asDiagonal() * q.transpose());
      const Outcome expected = evaluate(reference, state);
      for (const InstructionSet set : supported_sets()) {
        Tissue tissue(hand, set);
        const Outcome outcome = evaluate(tissue, state);
        EXPECT_NEAR(outcome.value, expected.value, 1e-12 * expected.value) << s.transpose();
        EXPECT_TRUE(outcome.gradient.allFinite()) << s.transpose();
        EXPECT_TRUE(outcome.hessian.dense().allFinite() && outcome.exact.dense().allFinite()) << s.transpose();
      }
    }
  }
}

TEST(TissueKernel, EachInstructionSetGivesTheSameBits) {
  Random random(3);
  for (const int count : {1, 2, 15, 16, 17, 100}) {
    const HandModel hand = loose_tetrahedra(count, random);
    State state = testing::rest_state(hand);
    for (int e = 0; e < count; ++e) {
      Vector3 s(1, 1, 1);
      const double amount = std::pow(10.0, 4 * random());
      s += (e % 3 == 0 ? 0.0 : amount) * random.vector();
      if (e % 13 == 0) s = Vector3(1, e % 2, 0);
      deform(state, hand, e, random.rotation() * s.asDiagonal() * random.rotation());
    }
    Tissue baseline(hand, InstructionSet::baseline);
    const Outcome expected = evaluate(baseline, state);
    for (const InstructionSet set : supported_sets()) {
      SCOPED_TRACE(std::string(to_string(set)));
      Tissue tissue(hand, set);
      expect_same(evaluate(tissue, state), expected);
    }
  }
  // Neighbouring elements add to the same blocks. Some elements are inverted.
  const HandModel box = testing::box_mesh({3, 3, 3}, Vector3(0.02, 0.02, 0.02), {"skin", 1000, 1e5, 0.45, 500, 500});
  State state = testing::rest_state(box);
  for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += 0.004 * random.vector();
  Tissue baseline(box, InstructionSet::baseline);
  ASSERT_GT(baseline.inverted_elements(state), 0);
  const Outcome expected = evaluate(baseline, state);
  for (const InstructionSet set : supported_sets()) {
    SCOPED_TRACE(std::string(to_string(set)));
    Tissue tissue(box, set);
    expect_same(evaluate(tissue, state), expected);
    expect_same(evaluate(tissue, state), expected);
  }
}

TEST(TissueKernel, TwoThreadsGiveTheBitsOfOne) {
  if (testing::allowed_cores() < 2) GTEST_SKIP() << "one core";
  HelperThread helper;
  ASSERT_TRUE(helper.present());
  const HandModel box = testing::box_mesh({9, 4, 4}, Vector3(0.06, 0.02, 0.02), {"skin", 1000, 1e5, 0.45, 500, 500});
  Random random(3);
  State state = testing::rest_state(box);
  for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += 0.002 * random.vector();
  Tissue alone(box), shared(box);
  shared.use(helper);
  const Outcome expected = evaluate(alone, state);
  for (int run = 0; run < 100; ++run) expect_same(evaluate(shared, state), expected);
}

TEST(TissueKernel, FloatHessianIsRightToSixDigitsAndTheRestIsUnchanged) {
  const HandModel box = testing::box_mesh({3, 3, 3}, Vector3(0.02, 0.02, 0.02), {"skin", 1000, 1e5, 0.45, 500, 500});
  for (const double amount : {2e-4, 0.004}) {
    Random random(5);
    State state = testing::rest_state(box);
    for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += amount * random.vector();
    Tissue exact(box, InstructionSet::baseline), baseline(box, InstructionSet::baseline);
    baseline.use_single_hessian();
    const Outcome expected = evaluate(exact, state), in_float = evaluate(baseline, state);
    double largest = 0, difference = 0;
    for (std::size_t k = 0; k < expected.hessian.values().size(); ++k) {
      largest = std::max(largest, std::abs(expected.hessian.values()[k]));
      difference = std::max(difference, std::abs(in_float.hessian.values()[k] - expected.hessian.values()[k]));
    }
    EXPECT_LE(difference, 1e-6 * largest);
    EXPECT_GT(difference, 0) << "the Hessian was computed in double";
    EXPECT_EQ(in_float.value, expected.value);
    expect_same(numbers(in_float.gradient), numbers(expected.gradient), "gradient");
    for (const InstructionSet set : supported_sets()) {
      SCOPED_TRACE(std::string(to_string(set)));
      Tissue tissue(box, set);
      tissue.use_single_hessian();
      expect_same(evaluate(tissue, state), in_float);
    }
  }
}

// The squares of tiny edges lose their digits. Axes made from them would not have unit length.
TEST(TissueKernel, HessianOfTissueCollapsedToAPointStaysPositiveSemidefinite) {
  Random random(8);
  const int count = 40;
  const HandModel hand = loose_tetrahedra(count, random);
  for (const bool in_float : {false, true}) {
    Tissue tissue(hand);
    if (in_float) tissue.use_single_hessian();
    for (int exponent = in_float ? 12 : 150; exponent < (in_float ? 30 : 170); ++exponent) {
      State state = testing::rest_state(hand);
      for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n)
        state.node_positions.col(n) = std::pow(10.0, -exponent) * random.vector();
      const Eigen::MatrixXd hessian = evaluate(tissue, state).hessian.dense();
      for (int e = 0; e < count; ++e) {
        const Eigen::VectorXd values =
            Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(hessian.block<12, 12>(12 * e, 12 * e)).eigenvalues();
        EXPECT_GE(values[0], -(in_float ? 1e-5 : 1e-9) * values[11])
            << "1e-" << exponent << " m, element " << e << (in_float ? ", float" : "");
      }
    }
  }
}

TEST(TissueKernel, NaNStaysInItsElement) {
  Random random(4);
  const int count = 40, bad = 21;
  const HandModel hand = loose_tetrahedra(count, random);
  State state = testing::rest_state(hand);
  for (int e = 0; e < count; ++e)
    deform(state, hand, e, Matrix3(random.rotation()) * Vector3(1.1, 0.9, 1.0).asDiagonal());
  for (const InstructionSet set : supported_sets()) {
    SCOPED_TRACE(std::string(to_string(set)));
    Tissue tissue(hand, set);
    const Outcome before = evaluate(tissue, state);
    for (const double wrong : {double(NAN), double(INFINITY), -double(INFINITY)}) {
      for (int node = 0; node < 4; ++node) {
        for (int axis = 0; axis < 3; ++axis) {
          State corrupted = state;
          corrupted.node_positions(axis, 4 * bad + node) = wrong;
          EXPECT_TRUE(std::isnan(tissue.value(corrupted)));
          const Outcome after = evaluate(tissue, corrupted);
          EXPECT_TRUE(std::isnan(after.value));
          EXPECT_FALSE(after.gradient.segment<12>(12 * bad).allFinite());
          for (int e = 0; e < count; ++e) {
            if (e == bad) continue;
            const auto first = static_cast<std::size_t>(e);
            expect_same(numbers(after.gradient).subspan(12 * first, 12),
                        numbers(before.gradient).subspan(12 * first, 12), "gradient");
            expect_same(after.hessian.values().subspan(90 * first, 90), before.hessian.values().subspan(90 * first, 90),
                        "Hessian");
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace softhand::tissue_kernel_test
