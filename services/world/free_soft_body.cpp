#include "world/free_soft_body.hpp"

#include <utility>

namespace softhand {
namespace {

// Fast steps of a step. So a step that does not converge does not make the world late.
constexpr double kWorkBudget = 4;

TissueModel model_of(const SoftBody& body) {
  TissueModel model;
  model.nodes = body.nodes;
  model.node_body.assign(body.nodes.size(), 0);
  append_body(model, body, 0, 0);
  return model;
}

State state_of(const SoftObject& object, int obstacles) {
  State state;
  const auto nodes = static_cast<Eigen::Index>(object.body->nodes.size());
  state.node_positions.resize(3, nodes);
  for (Eigen::Index n = 0; n < nodes; ++n)
    state.node_positions.col(n) = object.pose * object.body->nodes[static_cast<std::size_t>(n)];
  state.node_velocities.setZero(3, nodes);
  state.body_poses.resize(static_cast<std::size_t>(obstacles));
  state.body_velocities.resize(static_cast<std::size_t>(obstacles));
  return state;
}

}  // namespace

FreeSoftBody::FreeSoftBody(const SoftObject& object, int obstacles, const NodeSpring& spring)
    : model_(model_of(*object.body)),
      masses_(lumped_masses(model_)),
      state_(state_of(object, obstacles)),
      inertia_(masses_, obstacles),
      tissue_(model_, widest_instruction_set(), "soft_tissue"),
      contacts_(ContactPoints(model_, masses_), model_.node_count(), object.contact_stiffness, 0, 0, obstacles),
      contact_(contacts_, "soft_contact"),
      friction_(contacts_, "soft_friction") {
  inertia_.set_node_gravity(object.gravity);
  tissue_.use_single_hessian();
  DofLayout layout = state_.layout();
  layout.border_bodies = obstacles;
  SolverOptions options;
  options.work_budget = kWorkBudget;
  options.condenses_all_contact = true;
  std::vector<Energy*> terms{&inertia_, &tissue_, &contact_, &friction_};
  if (spring.stiffness > 0) {
    coupling_ = std::make_unique<NodeCoupling>(0, masses_, spring.stiffness, spring.damping_ratio);
    terms.push_back(coupling_.get());
  }
  solver_ = std::make_unique<NewtonSolver>(std::move(terms), layout, options);
  solver_->use_linkage(
      Linkage(layout, {}, std::vector<std::int32_t>(masses_.size(), -1)),
      [this](Linkage& linkage) {
        linkage.clear_touching();
        if (contacts_.count() > 0) linkage.set_loose_touching();
        return false;
      },
      nullptr);
}

void FreeSoftBody::set_obstacle(int number, const Obstacle& obstacle) {
  if (obstacle.shape == nullptr) {
    contacts_.clear_object(number);
    return;
  }
  state_.body_poses[static_cast<std::size_t>(number)] = obstacle.pose;
  contacts_.set_object(number, obstacle.shape, obstacle.friction, static_cast<std::uint32_t>(number + 1),
                       ContactObject::fixed);
}

void FreeSoftBody::start(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities) {
  state_.node_positions = positions;
  state_.node_velocities = velocities;
  contacts_.reset();
  solver_->forget();
}

bool FreeSoftBody::step(double dt) {
  const StepReport report = solver_->step(state_, dt);
  if (!report.state_changed) contact_.cancel_step();
  return report.state_changed;
}

}  // namespace softhand
