#include "stress/hand_events.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand::stress {
namespace {

constexpr double kRecoveredShare = 0.05;  // largest share of the displacement that may remain after a second, G3
constexpr double kRestDistance = 0.1e-3;  // m RMS after three seconds, G3

double rms_distance(const State& state, const Eigen::Matrix3Xd& rest) {
  return std::sqrt((state.node_positions - rest).squaredNorm() / static_cast<double>(rest.cols()));
}

}  // namespace

const HandModel& shipped_hand() {
  static const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  return hand;
}

HandModel one_finger(const HandModel& hand, Finger finger) {
  HandModel out = hand;
  const auto belongs = [&](std::int32_t node) {
    const Body body = static_cast<Body>(hand.node_body[static_cast<std::size_t>(node)]);
    return finger_of(body) == finger && !is_metacarpal(body);
  };
  const auto all_belong = [&](const auto& nodes) { return std::all_of(nodes.begin(), nodes.end(), belongs); };
  std::vector<std::int32_t> new_tetrahedron(hand.tetrahedra.size(), -1), new_node(hand.nodes.size(), -1);
  out.nodes.clear();
  out.node_body.clear();
  out.tetrahedra.clear();
  out.tetrahedron_material.clear();
  for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
    if (!all_belong(hand.tetrahedra[t])) continue;
    new_tetrahedron[t] = static_cast<std::int32_t>(out.tetrahedra.size());
    auto nodes = hand.tetrahedra[t];
    for (std::int32_t& node : nodes) {
      std::int32_t& renumbered = new_node[static_cast<std::size_t>(node)];
      if (renumbered < 0) {
        renumbered = static_cast<std::int32_t>(out.nodes.size());
        out.nodes.push_back(hand.nodes[static_cast<std::size_t>(node)]);
        out.node_body.push_back(hand.node_body[static_cast<std::size_t>(node)]);
      }
      node = renumbered;
    }
    out.tetrahedra.push_back(nodes);
    out.tetrahedron_material.push_back(hand.tetrahedron_material[t]);
  }
  // The surface keeps the skin of the finger's tetrahedra. The cut through the finger's root is inside and gets no
  // contact.
  out.surface.clear();
  for (auto triangle : hand.surface) {
    for (std::int32_t& node : triangle) node = new_node[static_cast<std::size_t>(node)];
    const auto has_triangle = [&](const auto& tetrahedron) {
      return std::ranges::all_of(triangle,
                                 [&](auto node) { return std::ranges::find(tetrahedron, node) != tetrahedron.end(); });
    };
    if (std::ranges::any_of(out.tetrahedra, has_triangle)) out.surface.push_back(triangle);
  }
  out.contact_points.clear();
  for (SkinPoint point : hand.contact_points) {
    point.tetrahedron = new_tetrahedron[static_cast<std::size_t>(point.tetrahedron)];
    if (point.tetrahedron >= 0) out.contact_points.push_back(point);
  }
  out.attachments.clear();
  for (Attachment attachment : hand.attachments) {
    attachment.tetrahedron = new_tetrahedron[static_cast<std::size_t>(attachment.tetrahedron)];
    if (attachment.tetrahedron >= 0) out.attachments.push_back(attachment);
  }
  out.skin_vertices.clear();
  out.skin_triangles.clear();
  return out;
}

Vector3 pad_of(const HandModel& hand, Finger finger) {
  Vector3 lowest(0, 1, 0);
  for (const SkinPoint& point : hand.contact_points) {
    const Vector3 place = hand.position_of(point);
    if (static_cast<Body>(point.body) == distal_of(finger) && place.y() < lowest.y()) lowest = place;
  }
  if (lowest.y() >= 1) throw std::logic_error("a finger without tissue");
  return lowest;
}

void hold_bones(HandSimulation& simulation, const Displacement& motion) {
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    Pose pose = simulation.hand().rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))];
    pose.position += motion.shift;
    simulation.set_target(body, pose, {motion.velocity, Vector3::Zero()});
  }
}

Findings let_go(const Release& release) {
  HandSimulation simulation(release.hand, release.options, 1, 1);
  simulation.enable_ledger(true);
  hold_bones(simulation, {});
  const Eigen::Matrix3Xd rest = simulation.state().node_positions;
  State disturbed = simulation.state();
  release.disturb(disturbed);
  simulation.restore(disturbed);
  const double before = rms_distance(simulation.state(), rest);
  HandWatch watch;
  watch.count_anchoring_as_work(release.overlapping);
  double after_second = before;
  for (int step = 1; step <= 270; ++step) {
    const StepReport report = simulation.step(kStep);
    watch.after_step(simulation, report, kStep);
    release.after_step(simulation);
    const double distance = rms_distance(simulation.state(), rest);
    if (step == 90) after_second = distance;
    // The hand is at rest. No input can move it again.
    if (step >= 90 && distance < 1e-7 && simulation.kinetic_energy() < 1e-15) break;
  }
  Findings findings;
  watch.judge(simulation, findings);
  if (before > 0)
    findings.demand("G3", "remaining share of the displacement after 1 s", after_second / before, kRecoveredShare, "1");
  findings.demand("G3", "distance from rest after 3 s, RMS", rms_distance(simulation.state(), rest) * 1e3,
                  kRestDistance * 1e3, "mm");
  return findings;
}

Shape box_shape(const Vector3& half_extents) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(ShapeKind::box);
  shape.size = to_wire(half_extents);
  return shape;
}

Shape round_shape(ShapeKind kind, double radius, double half_length) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(kind);
  shape.size = {radius, half_length, 0};
  return shape;
}

Findings run(const Event& event, const std::function<void(const EventStep&)>& after_step, double slow) {
  constexpr double kGravity = 9.81;  // m/s^2
  const EventObject& object = event.object;
  const auto shared = object.geometry ? object.geometry : std::make_shared<const ShapeGeometry>(object.shape);
  const ShapeGeometry& geometry = *shared;
  const bool moving = object.mass > 0;
  HandSimulation simulation(event.hand, event.options, 1, 1);
  simulation.enable_ledger(true);
  const int slot = moving ? 0 : 1;
  const double mass = moving ? object.mass : 1;
  MirroredObject mirrored{7, &geometry, mass, mass / geometry.solid().volume * geometry.solid().inertia,
                          object.friction};
  simulation.set_slot(slot, mirrored);
  simulation.set_slot_motion(slot, object.pose, {object.velocity, object.spin});
  NeighbourPlane table;
  if (object.on_table) {
    std::array<RestingPoint, ShapeGeometry::most_resting_points> points;
    const std::size_t count = geometry.resting_points(object.pose.orientation.conjugate() * Vector3::UnitY(), points);
    double lowest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < count; ++i)
      lowest = std::min(lowest, (object.pose * points[i].centre).y() - points[i].radius);
    table.neighbour = 8;
    table.kind = kNeighbourStatic;
    table.point = {object.pose.position.x(), lowest, object.pose.position.z()};
    table.normal = {0, 1, 0};
    table.friction = object.table_friction;
  }
  HandWatch watch;
  watch.exempt_penetration(event.overlapping);
  watch.count_anchoring_as_work(event.overlapping || event.strokes);
  double time = 0;
  for (int n = 0; time < event.seconds - 1e-9; ++n) {
    const double step = event.time_step(n);
    hold_bones(simulation, event.bones(time + step));
    if (moving) {
      simulation.make_dynamic(slot, Vector3(0, -kGravity, 0));
      if (object.on_table) simulation.set_planes(slot, std::span(&table, 1));
    } else {
      // The velocity leads from the present position to the next one, because the object may stop within the step.
      const Vector3 from = object.motion(time).shift, to = object.motion(time + step).shift;
      const Pose start{object.pose.position + from, rotation_exp(time * object.spin) * object.pose.orientation};
      simulation.set_slot_motion(slot, start, {(to - from) / step, object.spin});
    }
    const StepReport report = simulation.step(step);
    time += step;
    watch.after_step(simulation, report, step);
    if (after_step) after_step({time, simulation, report, slot});
  }
  Findings findings;
  watch.judge(simulation, findings, slow);
  return findings;
}

Findings run_touching(const Event& event, double least, const char* invariant, const char* quantity) {
  double force = 0;
  Findings findings =
      run(event, [&](const EventStep& now) { force = now.simulation.contact_wrench(now.slot).force.norm(); });
  findings.demand_at_least(invariant, quantity, force, least, "N");
  return findings;
}

Findings start_inside(const EventObject& object) {
  constexpr double kExit = 1;  // m/s
  constexpr double kLeft = 2;  // mm; the finger is pulled back to its place and rests on the surface
  Event event;
  event.hand = one_finger(shipped_hand(), Finger::index);
  event.object = object;
  event.object.pose.position = pad_of(event.hand, Finger::index);
  event.overlapping = true;
  event.seconds = 2;
  const auto geometry = object.geometry ? object.geometry : std::make_shared<const ShapeGeometry>(object.shape);
  double fastest = 0, deepest = 0;
  Findings findings = run(event, [&](const EventStep& now) {
    const State& state = now.simulation.state();
    fastest = std::max(fastest, state.node_velocities.colwise().norm().maxCoeff());
    deepest = 0;
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n)
      deepest = std::max(deepest,
                         -geometry->signed_distance(to_local(event.object.pose, Vector3(state.node_positions.col(n)))));
  });
  findings.demand("exit", "fastest node", fastest, kExit, "m/s");
  findings.demand("left", "deepest node at the end", 1e3 * deepest, kLeft, "mm");
  return findings;
}

void SlidingForce::add(const Wrench& contact) {
  const double drag = std::hypot(contact.force.x(), contact.force.z());
  ++count_, drag_ += drag, drag_squared_ += drag * drag, normal_ += std::abs(contact.force.y());
}

void SlidingForce::judge(double friction, Findings& findings) const {
  const double mean = drag_ / count_, deviation = std::sqrt(std::max(0.0, drag_squared_ / count_ - mean * mean));
  findings.demand("slides", "drag / (mu f_n) minus one", std::abs(mean / (friction * normal_ / count_) - 1), 0.02, "1");
  findings.demand("steady", "standard deviation of the drag over its mean", deviation / mean, 0.05, "1");
}

std::function<Displacement(double)> press_down(double depth, double time) {
  return [depth, time](double now) {
    const double h = 1e-6;
    const double y = -depth * minimum_jerk(now / time);
    return Displacement{Vector3(0, y, 0), Vector3(0, (-depth * minimum_jerk((now + h) / time) - y) / h, 0)};
  };
}

Event pressed_on_block(double depth) {
  constexpr double kGap = 2e-3;  // m
  Event event;
  double lowest = std::numeric_limits<double>::infinity();
  for (const Vector3& node : event.hand.nodes) lowest = std::min(lowest, node.y());
  event.object.shape = box_shape({0.2, 0.02, 0.2});
  event.object.pose.position = Vector3(0, lowest - kGap - 0.02, -0.1);
  event.bones = press_down(kGap + depth, 0.3);
  return event;
}

}  // namespace softhand::stress
