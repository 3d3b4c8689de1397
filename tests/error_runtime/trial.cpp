#include "error_runtime/trial.hpp"

#include <stdexcept>

#include "bench/measure.hpp"
#include "energies/corotational.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "runtime/config.hpp"
#include "world/solid.hpp"

namespace softhand::error_runtime {
namespace {

constexpr double kSettleSeconds = 0.7;

ObjectDescription describe_as(const ObjectOptions& object, std::uint32_t id) {
  const Solid solid = make_solid(object);
  ObjectDescription description;
  description.object = id;
  set_text(description.name, object.name);
  description.is_static = object.mass > 0 ? 0 : 1;
  description.mass = object.mass;
  description.inertia = to_wire(solid.inertia);
  description.friction = object.friction;
  description.shape = solid.shape;
  return description;
}

ObjectState state_of(const ObjectOptions& object, std::uint32_t id) {
  ObjectState state;
  state.object = id;
  state.position = object.position;
  state.orientation = object.orientation;
  if (object.mass <= 0) return state;
  state.gravity = {0, -9.81, 0};
  NeighbourPlane floor;
  floor.point = {object.position[0], kFloor, object.position[2]};
  floor.normal = {0, 1, 0};
  floor.gap = object.position[1] - make_solid(object).radius - kFloor;
  floor.friction = object.friction;
  state.planes.push_back(floor);
  return state;
}

// Norm of the first Piola stress of each element, Pa.
std::vector<double> stress_norms(const HandModel& hand, const State& state) {
  std::vector<CorotationalMaterial> materials;
  for (const Material& m : hand.materials) materials.push_back(corotational_material(m));
  std::vector<double> norms;
  for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
    const auto& n = hand.tetrahedra[t];
    Matrix3 rest, now;
    for (int k = 0; k < 3; ++k) {
      rest.col(k) = hand.nodes[static_cast<std::size_t>(n[static_cast<std::size_t>(k + 1)])] -
                    hand.nodes[static_cast<std::size_t>(n[0])];
      now.col(k) = state.node_positions.col(n[static_cast<std::size_t>(k + 1)]) - state.node_positions.col(n[0]);
    }
    norms.push_back(
        evaluate_corotational(materials[hand.tetrahedron_material[t]], now * rest.inverse()).stress().norm());
  }
  return norms;
}

}  // namespace

HandOptions options_of(const Scene& scene, const std::vector<std::string>& overrides) {
  HandOptions options;
  for (const std::string& assignment : scene.options) apply_override(options, assignment);
  for (const std::string& assignment : overrides) apply_override(options, assignment);
  return options;
}

Player::Player(const Scene& scene, const HandModel& hand, std::shared_ptr<const Motion> motion,
               const HandOptions& options)
    : scene_(scene),
      motion_(std::move(motion)),
      loop_(std::make_unique<HandLoop>(hand, options, HandKey{}, ObjectSpring{}, scene.soft_objects)),
      period_(static_cast<Nanoseconds>(1e9 / options.rate_hz)),
      ticks_per_step_(static_cast<std::int64_t>(std::llround(kTicksPerSecond / options.rate_hz))) {
  if (std::abs(static_cast<double>(ticks_per_step_) * options.rate_hz - kTicksPerSecond) > 1e-6) {
    throw std::invalid_argument("hand.rate_hz = " + std::to_string(options.rate_hz) + ": expected a divisor of " +
                                std::to_string(kTicksPerSecond));
  }
  std::uint32_t id = 0;
  for (const ObjectOptions& object : scene_.objects) {
    loop_->describe_object(describe_as(object, ++id));
    world_.objects.push_back(state_of(object, id));
  }
  skeleton_.stamp.epoch = 1;
}

double Player::advance(double motion_time, bool has_begun) {
  now_ += period_;
  constexpr double kHalf = 1e-4;  // s; the motions are smooth on this scale
  const JointFrames frames = motion_->at(motion_time), before = motion_->at(motion_time - kHalf),
                    after = motion_->at(motion_time + kHalf);
  const bool still = motion_time <= 0;
  ++skeleton_.stamp.sequence;
  skeleton_.stamp.sample_time = now_;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    Twist velocity;
    if (!still) {
      velocity.linear = (after[j].position - before[j].position) / (2 * kHalf);
      velocity.angular = rotation_log(after[j].orientation * before[j].orientation.conjugate()) / (2 * kHalf);
    }
    skeleton_.joints[j] = {to_wire(frames[j].position),
                           to_wire(frames[j].orientation),
                           to_wire(velocity.linear),
                           to_wire(velocity.angular),
                           0,
                           kJointValid,
                           1};
  }
  world_.stamp.sample_time = now_;
  RequestedOutputs requested;
  requested.surface = requested.bone_wrench = false;
  requested.ledger = has_begun;
  const bool world_there = has_begun || !scene_.soft_objects.empty();
  const double milliseconds =
      1e3 * bench::seconds_of([&] {
        output_ = &loop_->step(now_, {&skeleton_, nullptr, world_there ? &world_ : nullptr}, requested);
      });
  for (const ObjectTwin& twin : output_->coupling.twins) {
    if (twin.owned == 0) continue;
    ObjectState& state = world_.objects[twin.object - 1];
    state.position = twin.position;
    state.orientation = twin.orientation;
    state.linear_velocity = twin.linear_velocity;
    state.angular_velocity = twin.angular_velocity;
  }
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Vector3 behind = frames[j].position - to_vector(output_->simulated.joints[j].position),
                  velocity = to_vector(skeleton_.joints[j].linear_velocity);
    lag_numerator_ += behind.dot(velocity);
    lag_denominator_ += velocity.squaredNorm();
  }
  return milliseconds;
}

void Player::settle() {
  const double rate = static_cast<double>(kTicksPerSecond) / static_cast<double>(ticks_per_step_);
  for (int i = 0; i < kSettleSeconds * rate; ++i) advance(0, false);
}

void Player::take_state(const Player& other) {
  loop_->take_state(*other.loop_);
  now_ = other.now_;
  tick_ = other.tick_;
  skeleton_ = other.skeleton_;
  world_ = other.world_;
  lag_numerator_ = other.lag_numerator_;
  lag_denominator_ = other.lag_denominator_;
}

double Player::step() {
  tick_ += ticks_per_step_;
  return advance(static_cast<double>(tick_) / kTicksPerSecond, true);
}

Vector3 embedded(const HandModel& hand, std::size_t v, const Eigen::Matrix3Xd& nodes) {
  const SkinVertex& vertex = hand.skin_vertices[v];
  Vector3 place = Vector3::Zero();
  for (std::size_t k = 0; k < 4; ++k)
    place += static_cast<double>(vertex.weights[k]) *
             nodes.col(hand.tetrahedra[static_cast<std::size_t>(vertex.tetrahedron)][k]);
  return place;
}

Sample sample_of(const Player& player) {
  const HandSimulation& simulation = player.loop().simulation();
  const HandModel& hand = simulation.hand();
  const State& state = simulation.state();
  Sample sample;
  sample.tick = player.tick();
  sample.skin.resize(3, static_cast<Eigen::Index>(hand.skin_vertices.size()));
  for (std::size_t v = 0; v < hand.skin_vertices.size(); ++v)
    sample.skin.col(static_cast<Eigen::Index>(v)) = embedded(hand, v, state.node_positions);
  if (sample.tick % (kTicksPerSecond / 30) == 0) {
    const std::vector<double> norms = stress_norms(hand, state);
    sample.stress.resize(sample.skin.cols());
    for (std::size_t v = 0; v < hand.skin_vertices.size(); ++v)
      sample.stress[static_cast<Eigen::Index>(v)] = norms[static_cast<std::size_t>(hand.skin_vertices[v].tetrahedron)];
  }
  for (std::size_t j = 0; j < kJointCount; ++j) sample.joints[j] = simulation.joint_pose(static_cast<Joint>(j));
  if (const SoftObjects* soft = simulation.soft())
    sample.soft = state.node_positions.rightCols(soft->first_node(soft->count()) - soft->first_node(0));
  sample.skin_contacts = static_cast<std::size_t>(simulation.skin_contact_count());
  const Contacts& contacts = player.output().contacts;
  sample.fingers = contacts.fingers;
  for (const ObjectState& object : player.world().objects)
    sample.objects.push_back(to_pose(object.position, object.orientation));
  sample.touch.assign(hand.nodes.size(), 0);
  for (const Contact& contact : contacts.contacts)
    sample.touch[contact.node] = (contact.flags & kContactSticking) != 0 ? 1 : 2;
  return sample;
}

Trajectory play(const Scene& scene, Player& player, const std::function<void(const Player&)>& before_step) {
  Trajectory trajectory;
  const std::int64_t end = player.tick() + std::llround(scene.seconds * kTicksPerSecond);
  const std::uint64_t failed_before = player.loop().counters().failed_steps;
  const double lag_numerator = player.lag_numerator(), lag_denominator = player.lag_denominator();
  double iterations = 0;
  while (player.tick() < end) {
    if (before_step) before_step(player);
    trajectory.step_ms.push_back(player.step());
    const StepReport& report = player.output().report;
    iterations += report.iterations;
    trajectory.worst_residual = std::max(trajectory.worst_residual, report.residual);
    if (report.status != StepStatus::converged) ++trajectory.steps_not_converged;
    if (report.status == StepStatus::budget_spent) ++trajectory.steps_cut_off;
    for (const Contact& contact : player.output().contacts.contacts)
      trajectory.penetrations.push_back(contact.penetration);
    if (!player.at_sample()) continue;
    trajectory.samples.push_back(sample_of(player));
    const Sample& sample = trajectory.samples.back();
    trajectory.finite = trajectory.finite && sample.skin.allFinite() && sample.soft.allFinite();
    trajectory.inverted = std::max(trajectory.inverted, player.loop().simulation().inverted_elements());
  }
  trajectory.energy_defect = player.loop().simulation().ledger().defect();
  trajectory.inverted_at_end = player.loop().simulation().inverted_elements();
  trajectory.iterations = iterations / static_cast<double>(trajectory.step_ms.size());
  trajectory.failed_steps = static_cast<int>(player.loop().counters().failed_steps - failed_before);
  trajectory.lag_ms =
      1e3 * (player.lag_numerator() - lag_numerator) / std::max(player.lag_denominator() - lag_denominator, 1e-12);
  return trajectory;
}

}  // namespace softhand::error_runtime
