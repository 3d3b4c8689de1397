#include "error_runtime/peer.hpp"

#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletSoftBody/btDeformableBackwardEulerObjective.h>
#include <BulletSoftBody/btDeformableBodySolver.h>
#include <BulletSoftBody/btDeformableGravityForce.h>
#include <BulletSoftBody/btDeformableLinearElasticityForce.h>
#include <BulletSoftBody/btDeformableMultiBodyConstraintSolver.h>
#include <BulletSoftBody/btDeformableMultiBodyDynamicsWorld.h>
#include <BulletSoftBody/btSoftBody.h>
#include <BulletSoftBody/btSoftBodyHelpers.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <iostream>
#include <numeric>
#include <set>

#include "bench/measure.hpp"
#include "cli/outcome.hpp"
#include "energies/inertia.hpp"
#include "energies/tissue.hpp"
#include "solver/newton_solver.hpp"
#include "verification/supports.hpp"

namespace softhand::error_runtime {
namespace {

constexpr double kYoungsModulus = 6e4;  // Pa
constexpr double kPoissonRatio = 0.4;
constexpr double kDensity = 1000;   // kg/m^3
constexpr double kStep = 1.0 / 90;  // s
constexpr int kSteps = 60;
const Vector3 kWeight(0, -9.81, 0);  // m/s^2

// The tissue alone, with one material. The palm's nodes are held.
struct Problem {
  HandModel hand;
  std::vector<double> masses;  // kg, by node
  std::vector<int> held;
};

Problem problem_of(const std::string& name) {
  Problem p;
  p.hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/" + name + ".hand.json");
  for (Material& material : p.hand.materials) {
    material.density = kDensity;
    material.youngs_modulus = kYoungsModulus;
    material.poisson_ratio = kPoissonRatio;
    material.strain_limit_stiffness = 0;
  }
  p.masses = lumped_masses(p.hand);
  for (std::size_t n = 0; n < p.hand.nodes.size(); ++n) {
    const Body body = static_cast<Body>(p.hand.node_body[n]);
    if (finger_of(body) == Finger::palm || is_metacarpal(body)) p.held.push_back(static_cast<int>(n));
  }
  return p;
}

Sample sample_at(const Problem& p, int step, const Eigen::Matrix3Xd& nodes) {
  Sample sample;
  sample.tick = step;
  sample.skin.resize(3, static_cast<Eigen::Index>(p.hand.skin_vertices.size()));
  for (std::size_t v = 0; v < p.hand.skin_vertices.size(); ++v)
    sample.skin.col(static_cast<Eigen::Index>(v)) = embedded(p.hand, v, nodes);
  return sample;
}

// This project's energy terms for the problem.
class OwnFall {
 public:
  OwnFall(const Problem& p, const SolverOptions& options)
      : state_(at_rest(p)),
        inertia_(p.masses, 0),
        tissue_(p.hand),
        palm_(p.held, 1e6 * Matrix3::Identity(), state_.node_positions),
        solver_({&inertia_, &tissue_, &palm_}, state_.layout(), options) {
    inertia_.set_node_gravity(kWeight);
  }
  void step() { report_ = solver_.step(state_, kStep); }
  Eigen::Matrix3Xd nodes() const { return state_.node_positions; }
  const StepReport& report() const { return report_; }

 private:
  static State at_rest(const Problem& p) {
    State state;
    state.node_positions.resize(3, p.hand.node_count());
    for (int n = 0; n < p.hand.node_count(); ++n)
      state.node_positions.col(n) = p.hand.nodes[static_cast<std::size_t>(n)];
    state.node_velocities = Eigen::Matrix3Xd::Zero(3, p.hand.node_count());
    return state;
  }
  State state_;
  Inertia inertia_;
  Tissue tissue_;
  verification::Supports palm_;
  NewtonSolver solver_;
  StepReport report_;
};

Trajectory run_own(const Problem& p, const SolverOptions& options, int steps = kSteps) {
  OwnFall fall(p, options);
  Trajectory trajectory;
  for (int step = 1; step <= steps; ++step) {
    trajectory.step_ms.push_back(1e3 * bench::seconds_of([&] { fall.step(); }));
    trajectory.worst_residual = std::max(trajectory.worst_residual, fall.report().residual);
    trajectory.iterations += static_cast<double>(fall.report().iterations) / steps;
    if (!fall.report().state_changed) ++trajectory.failed_steps;
    trajectory.samples.push_back(sample_at(p, step, fall.nodes()));
  }
  return trajectory;
}

// Gives access to the solver's limits, which are protected members.
class BulletSolver final : public btDeformableBodySolver {
 public:
  struct Limits {
    int newton = 0;     // iterations; 0: Bullet's own
    int conjugate = 0;  // iterations; 0: Bullet's own
    double tolerance = 0;
  };
  explicit BulletSolver(const Limits& limits) {
    if (limits.newton > 0) {
      m_maxNewtonIterations = limits.newton;
      m_newtonTolerance = 0;
    }
    if (limits.conjugate > 0) {
      m_cg.m_maxIterations = m_cr.m_maxIterations = limits.conjugate;
      m_cg.m_tolerance = m_cr.m_tolerance = static_cast<btScalar>(limits.tolerance);
    }
  }
};

btVector3 to_bullet(const Vector3& v) {
  return {static_cast<btScalar>(v.x()), static_cast<btScalar>(v.y()), static_cast<btScalar>(v.z())};
}

class BulletFall {
 public:
  BulletFall(const Problem& p, const BulletSolver::Limits& limits) : solver_(limits) {
    constraints_.setDeformableSolver(&solver_);
    world_.setGravity(to_bullet(kWeight));
    world_.getWorldInfo().m_gravity = to_bullet(kWeight);

    btAlignedObjectArray<btVector3> places;
    for (const Vector3& x : p.hand.nodes) places.push_back(to_bullet(x));
    body_ = std::make_unique<btSoftBody>(&world_.getWorldInfo(), places.size(), &places[0], nullptr);
    // Without links, Bullet hangs in rebuildNodeTree.
    std::set<std::pair<int, int>> edges;
    for (const auto& t : p.hand.tetrahedra) {
      body_->appendTetra(t[0], t[1], t[2], t[3]);
      for (std::size_t a = 0; a < 4; ++a) {
        for (std::size_t b = a + 1; b < 4; ++b) edges.insert(std::minmax(t[a], t[b]));
      }
    }
    for (const auto& [a, b] : edges) body_->appendLink(a, b, nullptr, true);
    btSoftBodyHelpers::generateBoundaryFaces(body_.get());
    body_->initializeDmInverse();
    body_->m_tetraScratches.resize(body_->m_tetras.size());
    body_->m_tetraScratchesTn.resize(body_->m_tetras.size());
    for (std::size_t n = 0; n < p.masses.size(); ++n)
      body_->setMass(static_cast<int>(n), static_cast<btScalar>(p.masses[n]));
    for (const int n : p.held) body_->setMass(n, 0);
    body_->m_cfg.collisions = 0;
    body_->m_cfg.drag = 0;
    body_->m_cfg.kDP = 0;
    body_->m_sleepingThreshold = 0;
    body_->setActivationState(DISABLE_DEACTIVATION);
    world_.addSoftBody(body_.get());
    elasticity_.setYoungsModulus(static_cast<btScalar>(kYoungsModulus));
    elasticity_.setPoissonRatio(static_cast<btScalar>(kPoissonRatio));
    elasticity_.setDamping(0, 0);
    world_.addForce(body_.get(), &elasticity_);
    world_.addForce(body_.get(), &gravity_);
    world_.setImplicit(true);
    world_.setLineSearch(false);
    world_.setUseProjection(true);  // without it nothing moves
  }
  ~BulletFall() { world_.removeSoftBody(body_.get()); }
  BulletFall(const BulletFall&) = delete;
  BulletFall& operator=(const BulletFall&) = delete;
  void step() {
    std::streambuf* const terminal = std::cout.rdbuf(nullptr);  // Bullet prints there each time that its iterations end
    world_.stepSimulation(static_cast<btScalar>(kStep), 1, static_cast<btScalar>(kStep));
    std::cout.rdbuf(terminal);
  }
  Eigen::Matrix3Xd nodes() const {
    Eigen::Matrix3Xd nodes(3, body_->m_nodes.size());
    for (int n = 0; n < body_->m_nodes.size(); ++n) {
      const btVector3& x = body_->m_nodes[n].m_x;
      nodes.col(n) = Vector3(x.x(), x.y(), x.z());
    }
    return nodes;
  }

 private:
  btSoftBodyRigidBodyCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btDbvtBroadphase broadphase_;
  BulletSolver solver_;
  btDeformableMultiBodyConstraintSolver constraints_;
  btDeformableMultiBodyDynamicsWorld world_{&dispatcher_, &broadphase_, &constraints_, &configuration_, &solver_};
  btDeformableLinearElasticityForce elasticity_;
  btDeformableGravityForce gravity_{to_bullet(kWeight)};
  std::unique_ptr<btSoftBody> body_;
};

Trajectory run_bullet(const Problem& p, const BulletSolver::Limits& limits) {
  BulletFall fall(p, limits);
  Trajectory trajectory;
  for (int step = 1; step <= kSteps; ++step) {
    trajectory.step_ms.push_back(1e3 * bench::seconds_of([&] { fall.step(); }));
    const Eigen::Matrix3Xd nodes = fall.nodes();
    trajectory.samples.push_back(sample_at(p, step, nodes));
    trajectory.finite = trajectory.finite && nodes.allFinite();
  }
  return trajectory;
}

SolverOptions iterations(std::int64_t count, double residual) {
  SolverOptions options;
  options.max_iterations = count;
  options.residual_tolerance = residual;
  options.increment_tolerance = 1e-12;
  return options;
}

SolverOptions converged() {
  SolverOptions options = iterations(200, 0);
  options.factor = "double";
  return options;
}

}  // namespace

PeerStudy study_peer(const std::string& hand) {
  const Problem p = problem_of(hand);
  PeerStudy study;
  study.statement = fmt::format(
      "The fingers of a hand without bones fall under their weight.\n\n"
      "- Hand: {}, tissue only, {} nodes and {} tetrahedra. The palm's {} nodes are held.\n"
      "- Material: E = {:g} Pa, nu = {}, {} kg/m^3.\n"
      "- Run: {} steps of 1/90 s.\n"
      "- Bullet: version 3.24 as Debian builds it, in single precision.\n"
      "- Bullet's settings: `btDeformableLinearElasticityForce` (co-rotated), implicit, damping off.",
      hand, p.hand.nodes.size(), p.hand.tetrahedra.size(), p.held.size(), kYoungsModulus, kPoissonRatio, kDensity,
      kSteps);
  study.cannot =
      "Bullet's deformable bodies cannot model these features of the hand:\n\n"
      "- strain-limited tissue\n"
      "- attachments of bones inside elements (Bullet's anchors hold nodes)\n"
      "- joints with ranges and couplings in the same minimisation\n"
      "- contact inside the implicit solve\n"
      "- a result that repeats in double precision";
  const std::vector<double> weights = skin_weights(p.hand);
  const Trajectory exact = run_own(p, converged());
  const auto add = [&](const std::string& setting, const Trajectory& t) {
    Row row;
    row.scene = "soft_fingers_peer";
    row.knob = "engine";
    row.setting = setting;
    row.hand = hand;
    row.reference = "R0";
    row.ms_p50 = percentile(t.step_ms, 0.5);
    row.ms_p99 = percentile(t.step_ms, 0.99);
    row.ms_frame = std::accumulate(t.step_ms.begin(), t.step_ms.end(), 0.0) / kSteps;
    row.steps = t.step_ms.size();
    row.along = row.total = difference(t, exact, weights);
    row.along.touch_disagreement = std::nan("");
    row.iterations = t.iterations;
    row.worst_residual = t.worst_residual;
    row.classification = !t.finite || t.failed_steps > 0 || !(row.along.tissue_rms_mm < 11) ? "Diverged" : "Pass";
    study.rows.push_back(row);
  };
  add("softhand, converged (R0)", exact);
  for (const int count : {1, 2, 3, 5})
    add(fmt::format("softhand, {} iteration{}", count, count > 1 ? "s" : ""), run_own(p, iterations(count, 0)));
  add("softhand, default", run_own(p, SolverOptions{}));
  add("Bullet, as it comes", run_bullet(p, {}));
  for (const int count : {10, 25, 100, 400})
    add(fmt::format("Bullet, 1 Newton, {} CG", count), run_bullet(p, {1, count, 1e-8}));
  add("Bullet, 5 Newton, 200 CG", run_bullet(p, {5, 200, 1e-8}));
  return study;
}

PeerSteps compare_steps(const std::string& hand, int steps) {
  const Problem p = problem_of(hand);
  OwnFall own(p, SolverOptions{});
  BulletFall bullet(p, {});
  std::vector<double> own_seconds, bullet_seconds;
  for (int step = 0; step < steps; ++step) {
    own_seconds.push_back(bench::seconds_of([&] { own.step(); }));
    bullet_seconds.push_back(bench::seconds_of([&] { bullet.step(); }));
  }
  Trajectory exact = run_own(p, converged(), steps);
  exact.samples.erase(exact.samples.begin(), exact.samples.end() - 1);
  const std::vector<double> weights = skin_weights(p.hand);
  const auto error = [&](const Eigen::Matrix3Xd& nodes) {
    Trajectory last;
    last.samples.push_back(sample_at(p, steps, nodes));
    return difference(last, exact, weights).tissue_rms_mm;
  };
  return {bench::median(own_seconds), bench::median(bullet_seconds), error(own.nodes()), error(bullet.nodes())};
}

}  // namespace softhand::error_runtime
