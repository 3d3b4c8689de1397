// NewtonSolver: when it makes a new factor, in which precision, and when it reuses one. How its line search handles
// kinks.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "contact/coulomb.hpp"
#include "solver/block_cholesky.hpp"
#include "solver/newton_solver.hpp"
#include "support/brick.hpp"

namespace softhand::newton_factor_test {
namespace {

using testing::Anchors;
using testing::Brick;
using testing::converging;
using testing::FaultyTerm;
using testing::same_bits;

/// Holds every node at its position at the start of the step, with a small force at most. The stiffness is far above
/// that of the tissue. There is a kink where the node starts to slip.
class Rubbing final : public Energy {
 public:
  std::string_view name() const override { return "rubbing"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern&) const override {}
  void bind(const BlockMatrix& matrix) override {
    for (int n = 0; n < matrix.block_count(); ++n) slots_.push_back(matrix.find(n, n));
  }
  void begin_step(const State& state, double) override { start_ = state.node_positions; }
  double value(const State& state) const override {
    double sum = 0;
    for (Eigen::Index n = 0; n < start_.cols(); ++n) sum += kSpring.energy(stretch(state, n).norm());
    return sum;
  }
  double add_gradient(const State& state, VectorX& gradient) const override {
    for (Eigen::Index n = 0; n < start_.cols(); ++n)
      gradient.segment<3>(3 * n) += kSpring.secant(stretch(state, n).norm()) * stretch(state, n);
    return value(state);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature) const override {
    for (Eigen::Index n = 0; n < start_.cols(); ++n)
      hessian.add(slots_[static_cast<std::size_t>(n)], kSpring.tangent(stretch(state, n), Vector3::UnitY()));
  }

 private:
  static constexpr CoulombSpring kSpring{1e6, 0.02};
  Vector3 stretch(const State& state, Eigen::Index n) const {
    Vector3 s = state.node_positions.col(n) - start_.col(n);
    s.y() = 0;
    return s;
  }
  std::vector<BlockSlot> slots_;
  Eigen::Matrix3Xd start_;
};

/// A spring of zero rest length between nodes 0 and 1.
class Rod final : public Energy {
 public:
  explicit Rod(double stiffness) : stiffness_(stiffness) {}
  std::string_view name() const override { return "rod"; }
  void add_pattern(BlockPattern& pattern) const override { pattern.add(1, 0); }
  void bind(const BlockMatrix& matrix) override {
    for (int k = 0; k < 3; ++k) slots_[static_cast<std::size_t>(k)] = matrix.find(k == 0 ? 0 : 1, k == 2 ? 1 : 0);
  }
  double value(const State& state) const override {
    return 0.5 * stiffness_ * (state.node_positions.col(1) - state.node_positions.col(0)).squaredNorm();
  }
  double add_gradient(const State& state, VectorX& gradient) const override {
    const Vector3 pull = stiffness_ * (state.node_positions.col(1) - state.node_positions.col(0));
    gradient.segment<3>(0) -= pull;
    gradient.segment<3>(3) += pull;
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    hessian.add(slots_[0], stiffness_ * Matrix3::Identity());
    hessian.add(slots_[1], -stiffness_ * Matrix3::Identity());
    hessian.add(slots_[2], stiffness_ * Matrix3::Identity());
  }

 private:
  double stiffness_;
  std::array<BlockSlot, 3> slots_;
};

TEST(NewtonSolver, UsesADoubleFactorIfTheMatrixIsSingularInFloat) {
  // k + m rounds to k in float, so the second pivot vanishes in float.
  Inertia inertia({1.0, 1.0}, 0);
  Rod rod(std::ldexp(1.0, 34));
  State start;
  start.node_positions = Eigen::Matrix3Xd::Zero(3, 2);
  start.node_positions(0, 1) = 1e-9;
  start.node_velocities = Eigen::Matrix3Xd::Random(3, 2);
  State results[2];
  for (const int k : {0, 1}) {
    SolverOptions options;
    options.factor = k == 0 ? "float" : "double";
    NewtonSolver solver({&inertia, &rod}, start.layout(), options);
    if (k == 0) {
      BlockCholesky<float> single;
      for (Energy* term : std::initializer_list<Energy*>{&inertia, &rod}) term->begin_step(start, 1.0);
      BlockMatrix matrix = solver.hessian();
      matrix.set_zero();
      inertia.add_hessian(start, matrix, Curvature::projected);
      rod.add_hessian(start, matrix, Curvature::projected);
      single.analyze(matrix);
      single.load(matrix);
      ASSERT_FALSE(single.factorize());
    }
    State& state = results[k] = start;
    const StepReport report = solver.step(state, 1.0);
    EXPECT_TRUE(report.state_changed);
    EXPECT_EQ(report.shifts, 0);
    EXPECT_EQ(report.double_factors > 0, k == 0);
  }
  EXPECT_TRUE(same_bits(results[0].node_positions, results[1].node_positions));
}

/// The block factorisation. While `fails` is set, every factorisation after the first one fails.
class Failing final : public LinearSolver {
 public:
  Failing(const bool& fails, int& solved_without) : fails_(fails), solved_without_(solved_without) {}
  void analyze(const BlockMatrix& matrix) override { sound_.analyze(matrix); }
  void load(const BlockMatrix& matrix) override { sound_.load(matrix); }
  bool factorize() override { return has_factor_ = sound_.factorize() && !(fails_ && ++factorisations_ > 1); }
  void solve(const VectorX& rhs, VectorX& x) override {
    solved_without_ += has_factor_ ? 0 : 1;
    sound_.solve(rhs, x);
  }

 private:
  const bool& fails_;
  int& solved_without_;
  int factorisations_ = 0;
  bool has_factor_ = false;
  BlockCholesky<double> sound_;
};

TEST(NewtonSolver, DoesNotReuseAFailedFactor) {
  Brick brick;
  brick.shake(0.004, 4);
  bool fails = true;
  int solved_without = 0;
  SolverOptions options;
  options.linear_solver = [&] { return std::make_unique<Failing>(fails, solved_without); };
  NewtonSolver solver(brick.terms(), brick.state.layout(), options);
  const StepReport failed = solver.step(brick.state, 0.01);
  ASSERT_EQ(failed.status, StepStatus::failed_factorisation);
  ASSERT_GT(failed.iterations, 0);
  fails = false;
  EXPECT_EQ(solver.step(brick.state, 0.01).status, StepStatus::converged);
  EXPECT_EQ(solved_without, 0);
}

TEST(NewtonSolver, FloatFactorAndReusedFactorReachTheSameMinimum) {
  Brick brick;
  brick.shake(0.002, 4);
  const State start = brick.state;
  State reference = start;
  NewtonSolver exact(brick.terms(), start.layout(), converging());
  ASSERT_EQ(exact.step(reference, 0.01).status, StepStatus::converged);
  for (const char* factor : {"float", "double"}) {
    for (const bool reuses : {true, false}) {
      SolverOptions options = converging();
      options.factor = factor;
      options.keep_factor = reuses;
      NewtonSolver solver(brick.terms(), start.layout(), options);
      State state = start;
      const StepReport report = solver.step(state, 0.01);
      EXPECT_EQ(report.status, StepStatus::converged) << factor << ' ' << reuses;
      EXPECT_EQ(report.iterations > report.factorisations, reuses) << factor;
      EXPECT_LE((state.node_positions - reference.node_positions).cwiseAbs().maxCoeff(), 1e-10)
          << factor << ' ' << reuses;
      EXPECT_FALSE(same_bits(state.node_positions, start.node_positions));
    }
  }
}

TEST(NewtonSolver, UsesADoubleFactorWhenTheFloatFactorMakesNoMoreProgress) {
  Brick brick;
  brick.shake(0.002, 4);
  const State start = brick.state;
  double residuals[2];
  for (const int k : {0, 1}) {
    SolverOptions options = converging();
    options.residual_tolerance = options.increment_tolerance = 0;  // down to rounding
    options.factor = k == 0 ? "float" : "double";
    NewtonSolver solver(brick.terms(), start.layout(), options);
    State state = start;
    const StepReport report = solver.step(state, 0.01);
    EXPECT_EQ(report.double_factors > 0, k == 0);
    residuals[k] = report.residual;
    EXPECT_LE(report.residual, 1e-12) << options.factor
                                      << ": an earlier iterate was returned, whose energy is lower only by rounding";
  }
  EXPECT_LE(residuals[0], 10 * residuals[1]);
}

// A brick swings, is struck, and swings on.
TEST(NewtonSolver, ReusesAFactorAcrossStepsWhileItMakesProgress) {
  std::vector<Eigen::Matrix3Xd> paths[2];
  int factorisations[2] = {0, 0}, struck[2] = {0, 0};
  for (const int reuses : {0, 1}) {
    Brick brick;
    SolverOptions options;
    options.keep_factor = reuses == 1;
    options.residual_tolerance = 1e-7;
    NewtonSolver solver(brick.terms(), brick.state.layout(), options);
    brick.shake(1e-4, 9);
    for (int i = 0; i < 60; ++i) {
      if (i == 30) brick.shake(2e-3, 10);
      const StepReport report = solver.step(brick.state, 0.01);
      ASSERT_EQ(report.status, StepStatus::converged) << reuses << ' ' << i;
      factorisations[reuses] += report.factorisations;
      if (i == 30) struck[reuses] = report.factorisations;
      paths[reuses].push_back(brick.state.node_positions);
    }
  }
  for (std::size_t i = 0; i < paths[0].size(); ++i)
    ASSERT_LE((paths[0][i] - paths[1][i]).cwiseAbs().maxCoeff(), 1e-9) << i;
  EXPECT_LE(factorisations[1], factorisations[0] / 2);
  EXPECT_GT(struck[1], 0) << "a factor makes no progress far from the state where it was made";
}

/// Tissue that does not declare that it depends on the state alone.
class UndeclaredPotential final : public Energy {
 public:
  explicit UndeclaredPotential(Tissue& tissue) : tissue_(tissue) {}
  std::string_view name() const override { return "secretive"; }
  void add_pattern(BlockPattern& pattern) const override { tissue_.add_pattern(pattern); }
  void bind(const BlockMatrix& matrix) override { tissue_.bind(matrix); }
  double value(const State& state) const override { return tissue_.value(state); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    return tissue_.add_gradient(state, gradient);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override {
    tissue_.add_hessian(state, hessian, curvature);
  }
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override {
    return tissue_.add_all(state, gradient, hessian, curvature);
  }

 private:
  Tissue& tissue_;
};

// The tissue is evaluated once per iteration. The start of a step is not evaluated again, because the last step ended
// there. A solver that evaluates it again gives the same bits.
TEST(NewtonSolver, ReusesThePotentialsFromTheEndOfTheLastStep) {
  Eigen::Matrix3Xd paths[2];
  std::vector<int> at_start[2];
  for (const bool is_declared : {false, true}) {
    Brick brick;
    UndeclaredPotential undeclared(brick.tissue);
    SolverOptions options;
    options.residual_tolerance = 1e-7;
    NewtonSolver solver(
        {is_declared ? static_cast<Energy*>(&brick.tissue) : &undeclared, &brick.inertia, &brick.anchors},
        brick.state.layout(), options);
    brick.shake(1e-4, 9);
    solver.step(brick.state, 0.01);
    for (int i = 0; i < 5; ++i) {
      if (i == 3) brick.state.node_positions(0, 5) += 1e-7;
      const std::uint64_t before = brick.tissue.evaluated_elements();
      const StepReport report = solver.step(brick.state, 0.01);
      EXPECT_EQ(report.factorisations, 0);
      at_start[is_declared].push_back(static_cast<int>(brick.tissue.evaluated_elements() - before) /
                                          brick.tissue.element_count() -
                                      report.iterations);
    }
    paths[is_declared] = brick.state.node_positions;
  }
  EXPECT_EQ(at_start[0], (std::vector<int>{1, 1, 1, 1, 1}));
  EXPECT_EQ(at_start[1], (std::vector<int>{0, 0, 0, 1, 0})) << "evaluated again only after a node was moved";
  EXPECT_TRUE(same_bits(paths[0], paths[1]));
}

/// Pulls a body to the origin. It depends on one body, so its pattern has no pair.
class Tether final : public Energy {
 public:
  explicit Tether(bool is_declared) : is_declared_(is_declared) {}
  std::string_view name() const override { return "tether"; }
  bool is_potential() const override { return is_declared_; }
  void add_pattern(BlockPattern&) const override {}
  void bind(const BlockMatrix& matrix) override { slot_ = matrix.find(0, 0); }
  double value(const State& state) const override {
    return 0.5 * kStiffness * state.body_poses[0].position.squaredNorm();
  }
  double add_gradient(const State& state, VectorX& gradient) const override {
    gradient.segment<3>(0) += kStiffness * state.body_poses[0].position;
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    hessian.add(slot_, kStiffness * Matrix3::Identity());
  }

 private:
  static constexpr double kStiffness = 50;
  bool is_declared_;
  BlockSlot slot_;
};

TEST(NewtonSolver, NoticesThatTheBodyOfAPotentialMoved) {
  Vector3 ends[2];
  for (const bool is_declared : {false, true}) {
    Inertia inertia({}, 1);
    inertia.set_dynamic(0, 0.1, 1e-4 * Matrix3::Identity(), Vector3::Zero());
    Tether tether(is_declared);
    State state = empty_state({0, 1});
    NewtonSolver solver({&tether, &inertia}, state.layout(), SolverOptions{});
    for (int i = 0; i < 4; ++i) {
      if (i == 2) state.body_poses[0].position = Vector3(0.1, 0.02, -0.05);
      solver.step(state, 0.01);
    }
    ends[is_declared] = state.body_poses[0].position;
  }
  EXPECT_EQ(ends[0], ends[1]) << "the forces of the old place were reused";
}

// A line search that halves steps until the energy falls would stop short of a kink. It takes 538 iterations here, 65
// of them in one step.
TEST(NewtonSolver, LineSearchCrossesKinks) {
  Brick brick;
  Rubbing rubbing;
  auto terms = brick.terms();
  terms.push_back(&rubbing);
  NewtonSolver solver(terms, brick.state.layout(), converging(200));
  int most = 0, sum = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    brick.shake(3e-3, seed);
    for (int i = 0; i < 5; ++i) {
      const StepReport report = solver.step(brick.state, 0.01);
      EXPECT_EQ(report.status, StepStatus::converged);
      most = std::max(most, report.iterations);
      sum += report.iterations;
    }
  }
  EXPECT_LE(most, 45);
  EXPECT_LE(sum, 450);
}

// Friction that starts to slip changes only a few blocks. The new factor is made with the same tissue Hessian.
TEST(NewtonSolver, RenewsOnlyTheTermsWithKinks) {
  Eigen::Matrix3Xd paths[2];
  int kinks = 0, whole[2] = {0, 0};
  for (const int reuses : {0, 1}) {
    Brick brick;
    Rubbing rubbing;
    std::vector<Energy*> terms{&rubbing};  // listed first, although it is evaluated last
    for (Energy* term : brick.terms()) terms.push_back(term);
    SolverOptions options;
    options.max_iterations = 200;
    options.curvature = "projected";  // an exact Hessian would be renewed sooner
    options.keep_factor = reuses == 1;
    options.residual_tolerance = 1e-8;
    NewtonSolver solver(terms, brick.state.layout(), options);
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      brick.shake(2e-4, seed);
      for (int i = 0; i < 5; ++i) {
        const StepReport report = solver.step(brick.state, 0.01);
        ASSERT_EQ(report.status, StepStatus::converged) << reuses << ' ' << seed << ' ' << i;
        EXPECT_EQ(report.terms[0].name, "rubbing");
        kinks += report.kink_factors;
        whole[reuses] += report.factorisations - report.kink_factors;
      }
    }
    paths[reuses] = brick.state.node_positions;
  }
  EXPECT_LE((paths[0] - paths[1]).cwiseAbs().maxCoeff(), 1e-7);
  EXPECT_GT(kinks, 20);
  EXPECT_LE(whole[1], whole[0] / 2);
}

// One node's stiffness in the factor is a million times too large. The node hardly moves in any iteration, however far
// it has to go.
TEST(NewtonSolver, ChordStepDoesNotMistakeATooStiffFactorForConvergence) {
  Brick brick;
  State state = brick.state;
  state.body_poses.resize(1);  // carries the nodes
  state.body_velocities.resize(1);
  Inertia inertia(lumped_masses(brick.box), 1);
  inertia.set_dynamic(0, 0.01, 1e-6 * Matrix3::Identity(), Vector3::Zero());
  FaultyTerm faulty;
  const DofLayout layout = state.layout();
  NewtonSolver solver({&inertia, &brick.tissue, &brick.anchors, &faulty}, layout, SolverOptions{});
  solver.use_linkage(Linkage(layout, {}, std::vector<std::int32_t>(static_cast<std::size_t>(layout.node_count), 0)),
                     [](Linkage&) { return true; });
  faulty.curvature = 1e9;
  EXPECT_TRUE(solver.step(state, 0.01).chord);
  faulty.curvature = 0;
  state.node_positions(0, 0) += 1e-4;
  for (int i = 0; i < 60; ++i) EXPECT_TRUE(solver.step(state, 0.01).chord) << i;
  EXPECT_LE((state.node_positions - brick.state.node_positions).colwise().norm().maxCoeff(), 5e-6);
}

/// A one-sided spring against x below the rest position, for all nodes: a limit, as joints and strain have one.
class Limit final : public Energy {
 public:
  Limit(const Eigen::Matrix3Xd& rest, bool has_kinks) : least_(rest.row(0)), has_kinks_(has_kinks) {}
  std::string_view name() const override { return "limit"; }
  bool has_kinks() const override { return has_kinks_; }
  bool is_potential() const override { return !has_kinks_; }
  int needed_bodies() const override { return 0; }
  void add_pattern(BlockPattern&) const override {}
  void bind(const BlockMatrix& matrix) override {
    for (int n = 0; n < matrix.block_count(); ++n) slots_.push_back(matrix.find(n, n));
  }
  double value(const State& state) const override {
    return 0.5 * kStiffness * (state.node_positions.row(0) - least_).cwiseMin(0.0).squaredNorm();
  }
  double add_gradient(const State& state, VectorX& gradient) const override {
    for (Eigen::Index n = 0; n < least_.size(); ++n)
      gradient[3 * n] += kStiffness * std::min(0.0, state.node_positions(0, n) - least_[n]);
    return value(state);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature) const override {
    Matrix3 block = Matrix3::Zero();
    block(0, 0) = kStiffness;
    for (Eigen::Index n = 0; n < least_.size(); ++n) {
      if (state.node_positions(0, n) < least_[n]) hessian.add(slots_[static_cast<std::size_t>(n)], block);
    }
  }

 private:
  static constexpr double kStiffness = 1e4;
  Eigen::RowVectorXd least_;
  bool has_kinks_;
  std::vector<BlockSlot> slots_;
};

// The Hessian of a limit jumps, although the term has no kinks in the sense of the interface. The steps end at the same
// minimum, in about as many iterations.
TEST(NewtonSolver, ConvergesAcrossLimitsOfTermsWithoutKinks) {
  Eigen::Matrix3Xd paths[2];
  int iterations[2] = {0, 0}, most[2] = {0, 0};
  for (const int has_kinks : {0, 1}) {
    Brick brick;
    Rubbing rubbing;
    Limit limit(brick.state.node_positions, has_kinks == 1);
    auto terms = brick.terms();
    terms.push_back(&limit);
    terms.push_back(&rubbing);
    SolverOptions options;
    options.max_iterations = 200;
    options.residual_tolerance = 1e-8;
    NewtonSolver solver(terms, brick.state.layout(), options);
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      brick.shake(2e-4, seed);
      for (int i = 0; i < 5; ++i) {
        const StepReport report = solver.step(brick.state, 0.01);
        ASSERT_EQ(report.status, StepStatus::converged) << has_kinks << ' ' << seed << ' ' << i;
        iterations[has_kinks] += report.iterations;
        most[has_kinks] = std::max(most[has_kinks], report.iterations);
      }
    }
    paths[has_kinks] = brick.state.node_positions;
  }
  std::printf("  iterations %d (most %d), with kinks %d (%d)\n", iterations[0], most[0], iterations[1], most[1]);
  EXPECT_LE((paths[0] - paths[1]).cwiseAbs().maxCoeff(), 1e-7);
  EXPECT_LE(iterations[0], 1.2 * iterations[1]);
  EXPECT_LE(most[0], 60);
}

// The factor is too stiff at one node of 400. The RMS hardly sees this node.
TEST(NewtonSolver, ChordStepSeesASingleNodeThatMoves) {
  constexpr int kNodes = 400;
  const DofLayout layout{kNodes, 1};  // the body carries the nodes
  State state = empty_state(layout);
  std::vector<int> all(kNodes);
  std::iota(all.begin(), all.end(), 0);
  Anchors anchors(all, 1e4, state.node_positions);
  Inertia inertia(std::vector<double>(kNodes, 1e-6), 1);
  inertia.set_dynamic(0, 0.01, 1e-6 * Matrix3::Identity(), Vector3::Zero());
  FaultyTerm faulty;
  NewtonSolver solver({&inertia, &anchors, &faulty}, layout, SolverOptions{});
  solver.use_linkage(Linkage(layout, {}, std::vector<std::int32_t>(kNodes, 0)), [](Linkage&) { return true; });
  faulty.curvature = 5e3;
  EXPECT_TRUE(solver.step(state, 0.01).chord);
  faulty.curvature = 0;
  state.node_positions(0, 0) = 3e-4;
  EXPECT_TRUE(solver.step(state, 0.01).chord);
  EXPECT_LE(std::abs(state.node_positions(0, 0)), 4e-5) << "an iteration leaves a third of the way";
}

// The material is almost steel: a small remaining motion still means much energy.
TEST(NewtonSolver, ChordStepDoesNotRaiseTheEnergy) {
  Brick brick({3, 2, 2}, testing::soft(0.45, 1e11));
  State state = brick.state;
  state.body_poses.resize(1);  // carries the nodes
  state.body_velocities.resize(1);
  Inertia inertia(lumped_masses(brick.box), 1);
  inertia.set_dynamic(0, 0.01, 1e-6 * Matrix3::Identity(), Vector3::Zero());
  const DofLayout layout = state.layout();
  NewtonSolver solver({&inertia, &brick.tissue, &brick.anchors}, layout, SolverOptions{});
  solver.use_linkage(
      Linkage(layout, {Linkage::Link{}}, std::vector<std::int32_t>(static_cast<std::size_t>(layout.node_count), 0)),
      [](Linkage&) { return true; });
  const auto energy = [&] {
    return inertia.kinetic_energy(state) + brick.tissue.value(state) + brick.anchors.value(state);
  };
  testing::Random random(5);
  for (int i = 0; i < 60; ++i) {
    if (i % 20 == 0) {
      for (int n = 0; n < layout.node_count; ++n) state.node_velocities.col(n) += random.vector();
      state.body_velocities[0].angular += 10 * random.vector();
    }
    const double before = energy();
    solver.step(state, 0.01);
    EXPECT_LE(energy(), 1.001 * before + 1e-9) << i;
  }
}

// If each iteration makes its own factor anyway, no factor is reused.
TEST(NewtonSolver, ReusesNoFactorWithFewIterations) {
  Brick reusing, other;
  SolverOptions options;
  options.max_iterations = 2;
  NewtonSolver one(reusing.terms(), reusing.state.layout(), options);
  options.keep_factor = false;
  NewtonSolver two(other.terms(), other.state.layout(), options);
  reusing.shake(0.001, 9);
  other.shake(0.001, 9);
  for (int i = 0; i < 10; ++i) {
    one.step(reusing.state, 0.01);
    two.step(other.state, 0.01);
    ASSERT_TRUE(same_bits(reusing.state.node_positions, other.state.node_positions)) << i;
  }
}

}  // namespace
}  // namespace softhand::newton_factor_test
