// Shapes from distance grids, and thin shells: a finger slides across cells, starts inside, crosses and presses walls.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "bench/measure.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "runtime/object_store.hpp"
#include "scene/finger_gap.hpp"
#include "stress/cases.hpp"
#include "stress/hand_events.hpp"
#include "support/box_mesh.hpp"
#include "support/meshes.hpp"
#include "trackers/replay/motion.hpp"
#include "trackers/replay/posture_solver.hpp"

namespace softhand::stress {
namespace {

using Geometry = std::shared_ptr<const ShapeGeometry>;

Geometry grid_of(const TriangleMesh& mesh, double cell) { return std::make_shared<const ShapeGeometry>(mesh, cell); }

// --- a grid against the shape that it samples -------------------------------------------------------------------

/// A shape twice: analytic, and as a grid. `height` is that of its top above its origin.
struct Twice {
  Shape shape;
  Geometry grid;
  double height;
};

// An edge of the mesh lies edge^2/(8 radius) too deep: `radius`/20,000.
Twice ball(double radius, double cell) {
  const double edge = radius * std::sqrt(8.0 / 20'000);
  return {round_shape(ShapeKind::sphere, radius, 0), grid_of(testing::sphere_mesh(radius, edge), cell), radius};
}

// The top of a box of 60 x 20 x 60 mm, away from its edges.
Twice block(double cell) {
  const Vector3 half(0.03, 0.01, 0.03);
  return {box_shape(half), grid_of(testing::box_mesh(half), cell), half.y()};
}

// The object presses 2 mm into the pulp of the index finger and slides by 12 mm at `speed`, along the finger and across
// it. The forces on the grid must be those on the analytic shape, and must not jump at the borders of cells.
Findings grid_slides(const Twice& twice, double speed) {
  constexpr double kGap = 0.5e-3, kDepth = 2e-3, kRise = 0.3, kWait = 0.2, kWay = 12e-3;
  constexpr double kSame = 1;  // % of the largest force
  Event event;
  event.hand = one_finger(shipped_hand(), Finger::index);
  event.object.shape = twice.shape;
  event.object.pose.position = pad_of(event.hand, Finger::index) - Vector3(0, twice.height + kGap, 0);
  const double slides = kRise + kWait;
  event.seconds = slides + kWay / speed;
  event.object.motion = [=](double time) {
    Displacement motion;
    motion.shift.y() = (kGap + kDepth) * minimum_jerk(time / kRise);
    motion.shift += speed * std::max(0.0, time - slides) * Vector3(0.75, 0, 0.66).normalized();
    return motion;
  };
  const auto forces_of = [&event](std::vector<Vector3>& forces) {
    return run(event, [&](const EventStep& now) { forces.push_back(now.simulation.contact_wrench(now.slot).force); });
  };
  std::vector<Vector3> exact, grid;
  forces_of(exact);
  event.object.geometry = twice.grid;
  Findings findings = forces_of(grid);
  double largest = 0, apart = 0, jump = 0, exact_jump = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    largest = std::max(largest, exact[i].norm());
    apart = std::max(apart, (grid[i] - exact[i]).norm());
    if (i == 0 || static_cast<double>(i) * kStep < slides + kStep) continue;
    jump = std::max(jump, (grid[i] - grid[i - 1]).norm());
    exact_jump = std::max(exact_jump, (exact[i] - exact[i - 1]).norm());
  }
  findings.demand_at_least("pressed", "largest force", largest, 0.3, "N");
  findings.demand("no step", "largest change of the force in a step beyond that on the analytic shape",
                  100 * (jump - exact_jump) / largest, kSame, "%");
  findings.demand("as the analytic shape", "largest difference of the forces over the largest force",
                  100 * apart / largest, kSame, "%");
  return findings;
}

// Slides a pad over a plate whose cells lie obliquely. The drag must be mu f_n and steady.
Findings grid_drag(double cell, double speed) {
  constexpr double kWay = 25e-3;
  const Vector3 half(0.06, 0.01, 0.06);
  const Quaternion oblique = rotation_exp(Vector3(0.3, 0.5, 0.2));
  TriangleMesh mesh = testing::box_mesh(half);
  for (Vector3& vertex : mesh.vertices) vertex = oblique * vertex;
  Event event;
  event.hand = one_finger(shipped_hand(), Finger::index);
  event.object.geometry = grid_of(mesh, cell);
  event.object.pose = {pad_of(event.hand, Finger::index) - Vector3(0, half.y() + 2e-3, 0), oblique.conjugate()};
  event.seconds = 0.5 + kWay / speed;
  event.bones = [=, down = press_down(4e-3, 0.3)](double time) {
    Displacement motion = down(time);
    if (time > 0.5) motion.shift.x() = speed * (time - 0.5), motion.velocity.x() = speed;
    return motion;
  };
  SlidingForce force;
  Findings findings = run(event, [&](const EventStep& now) {
    if (now.time >= 0.5 + 0.6 * kWay / speed) force.add(now.simulation.contact_wrench(now.slot));
  });
  force.judge(event.object.friction, findings);
  return findings;
}

Findings grid_deep_start(double cell) {
  EventObject block;
  block.geometry = grid_of(testing::box_mesh(Vector3::Constant(0.04)), cell);
  return start_inside(block);
}

// --- walls ---------------------------------------------------------------------------------------------------------

/// A wall below the finger.
struct Wall {
  Geometry geometry;
  Quaternion turn = Quaternion::Identity();  ///< of the wall's frame
  double height = 0;                         ///< m, of the wall's top above its origin
  Vector3 middle = Vector3::Zero();          ///< m, from the origin to the place under the fingertip, world axes
  /// True for a place behind the far face of the wall, in the wall's frame.
  std::function<bool(const Vector3&)> is_behind;
};

Wall plate(double thickness, double cell) {
  const Vector3 half(0.05, 0.5 * thickness, 0.05);
  return {grid_of(testing::box_mesh(half), cell), Quaternion::Identity(), half.y(), Vector3::Zero(),
          [half](const Vector3& x) { return x.y() < -half.y() && std::abs(x.x()) < 0.045 && std::abs(x.z()) < 0.045; }};
}

Wall sphere_shell(double outer, double thickness, double cell) {
  return {grid_of(testing::shell_mesh(outer, outer - thickness, 1e-3), cell), Quaternion::Identity(), outer,
          Vector3::Zero(), [=](const Vector3& x) { return x.norm() < outer - thickness; }};
}

// The mug of config/objects, lying. Its wall is 4 mm thick.
Wall lying_mug() {
  constexpr double kRadius = 0.04, kThickness = 4e-3;  // m
  const LoadedObject mug = load_object(SOFTHAND_SOURCE_DIR "/config/objects/mug.object.json");
  const ObjectLink& link = mug.model.links[0];
  double bottom = 1, top = -1;
  for (const Vector3& vertex : link.mesh.vertices)
    bottom = std::min(bottom, vertex.y()), top = std::max(top, vertex.y());
  // The mug's axis lies along z, and its handle to the side.
  const Quaternion turn = rotation_exp(Vector3(0.5 * M_PI, 0, 0));
  return {grid_of(link.mesh, link.grid_spacing), turn, kRadius, turn * Vector3(0, 0.5 * (bottom + top), 0),
          [=](const Vector3& x) {
            return std::hypot(x.x(), x.z()) < kRadius - kThickness && x.y() > bottom + 0.01 && x.y() < top;
          }};
}

Event above(const Wall& wall, double gap) {
  Event event;
  event.hand = one_finger(shipped_hand(), Finger::index);
  const Vector3 pad = pad_of(event.hand, Finger::index);
  event.object.geometry = wall.geometry;
  event.object.pose = {pad - wall.middle - Vector3(0, wall.height + gap, 0), wall.turn};
  return event;
}

// Nodes of the skin behind the wall.
int behind(const Wall& wall, const EventStep& now) {
  const Pose to_wall = now.simulation.slot_pose(now.slot).inverse();
  const auto& nodes = now.simulation.state().node_positions;
  int count = 0;
  for (Eigen::Index n = 0; n < nodes.cols(); ++n) count += wall.is_behind(to_wall * Vector3(nodes.col(n))) ? 1 : 0;
  return count;
}

// Wall and finger meet at `speed`, at random phases of a step and random places. No node may be behind the wall once
// the tissue is at rest.
Findings crossing(const Wall& wall, bool wall_moves, double speed, double rate, int trials) {
  constexpr double kPast = 1e-3, kRest = 0.25;  // m, s
  testing::Random random(7);
  int tunnels = 0;
  Findings findings;
  for (int trial = 0; trial < trials; ++trial) {
    const double gap = speed / rate * (1 + 0.5 * (1 + random())), travel = gap + kPast;
    Event event = above(wall, gap);
    event.time_step = [rate](int) { return 1 / rate; };
    event.strokes = true;
    event.object.pose.position += 5e-3 * Vector3(random(), 0, random());
    event.seconds = travel / speed + kRest;
    const double sign = wall_moves ? 1 : -1;
    (wall_moves ? event.object.motion : event.bones) = [=](double time) {
      const double way = std::min(speed * time, travel);
      return Displacement{Vector3(0, sign * way, 0), Vector3(0, way < travel ? sign * speed : 0, 0)};
    };
    int nodes = 0;
    Findings one = run(event, [&](const EventStep& now) { nodes = behind(wall, now); });
    tunnels += nodes > 0 ? 1 : 0;
    const bool nonfinite = !one.demands.front().met();
    if (trial == 0 || nonfinite) findings = std::move(one);
    if (nonfinite) break;
  }
  findings.demand("no tunnel", fmt::format("tunnels in {} trials", trials), tunnels, 0, "1");
  return findings;
}

// The finger presses on the wall until its target is `depth` behind the touch, stays there, and slides along the wall.
// No node may go behind the wall, and the wall must never be pulled.
Findings pressed(const Wall& wall, double depth, double way) {
  constexpr double kGap = 1e-3, kPress = 0.3, kSlides = 0.8, kSlide = 0.6, kRest = 0.3;  // m, s
  Event event = above(wall, kGap);
  event.seconds = kSlides + kSlide + kRest;
  event.bones = [=, down = press_down(kGap + depth, kPress)](double time) {
    constexpr double kInstant = 1e-6;
    Displacement motion = down(time);
    const auto at = [=](double t) { return way * minimum_jerk((t - kSlides) / kSlide); };
    motion.shift.z() = at(time);
    motion.velocity.z() = (at(time + kInstant) - at(time)) / kInstant;
    return motion;
  };
  int most = 0;
  double push = 0, pull = 0;
  Findings findings = run(event, [&](const EventStep& now) {
    most = std::max(most, behind(wall, now));
    const double down = -now.simulation.contact_wrench(now.slot).force.y();
    push = std::max(push, down), pull = std::max(pull, -down);
  });
  findings.demand_at_least("pressed", "largest force", push, 0.5, "N");
  findings.demand("right side", "force that pulls the wall towards the finger, over the largest force", pull / push,
                  0.02, "1");
  findings.demand("not through", "most nodes behind the wall", most, 0, "1");
  return findings;
}

// --- a tube that is too narrow for all fingers ------------------------------------------------------------------

// Bunches all five fingertips as far as the joints allow. `middle` and `axis`: of the tips.
JointAngles bunched(const GripHand& hand, Vector3& middle, Vector3& axis) {
  PostureSolver solver(hand, Pose{}, {hand.open()});
  for (int f = 0; f < kFingerCount; ++f) solver.free_finger(static_cast<Finger>(f), {0});
  const Vector3 goal = hand.pad(Finger::middle, solver.frames(0)).position + Vector3(0, -0.03, 0.02);
  solver.solve([&goal](PostureSolver& s) {
    for (int f = 0; f < kFingerCount; ++f) {
      const GripHand::Pad pad = s.pad(static_cast<Finger>(f), 0);
      s.add_point_goal(kPerMetre, 0, pad.body, pad.centre, goal);
      s.add_direction_goal(0.2, 0, pad.body, pad.along, Vector3(0, -0.6, -0.8));
    }
    s.add_start_goal(0.1);
  });
  middle = axis = Vector3::Zero();
  for (int f = 0; f < kFingerCount; ++f) {
    const GripHand::Pad pad = solver.pad(static_cast<Finger>(f), 0);
    middle += pad.centre / kFingerCount;
    axis += pad.along;
  }
  axis.normalize();
  return solver.angles(0);
}

// A tube about y, 30 mm long, with a wall of 6 mm and rounded rims.
Geometry tube(double bore) {
  const auto squarish = [](double x) { return std::copysign(std::pow(std::abs(x), 0.4), x); };
  return grid_of(testing::closed_grid(72, 40,
                                      [&](double u, double v) {
                                        const double r = 0.5 * bore + 3e-3 * (1 + squarish(std::cos(v)));
                                        return Vector3(r * std::sin(u), 0.015 * squarish(std::sin(v)), r * std::cos(u));
                                      }),
                 1e-3);
}

// The fingers bunch, and a tube is pushed over them and taken off again. It takes two fingers and presses the tips of
// the others with its rim.
Findings tube_over_the_fingers(double bore) {
  constexpr double kMove = 0.6, kOn = 0.8, kOff = 2.2, kOpen = 2.9, kSeconds = 4;  // s
  constexpr double kFar = 0.07, kWay = 0.067;                                      // m, before the tips
  const HandModel& model = shipped_hand();
  const GripHand grip(model);
  Vector3 middle, axis;
  const JointAngles shut = bunched(grip, middle, axis);
  const Geometry shape = tube(bore);
  SimulationOptions options;
  options.skin_contact = true;
  HandSimulation simulation(model, options, 0, 1);
  simulation.enable_ledger(true);
  simulation.set_slot(0, {.id = 1, .shape = shape.get(), .friction = 0.3});
  const Quaternion turned = Quaternion::FromTwoVectors(Vector3::UnitY(), axis);
  const auto moved = [](double time, double there, double back) {
    return minimum_jerk((time - there) / kMove) - minimum_jerk((time - back) / kMove);
  };
  const auto place = [&](double time) { return Vector3(middle + (kFar - kWay * moved(time, kOn, kOff)) * axis); };
  HandWatch watch;
  double force = 0, gap = 1;
  for (double time = 0; time < kSeconds; time += kStep) {
    const JointFrames targets = forward_kinematics(model, Pose{}, grip.from_open(moved(time, 0, kOpen), shut));
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      simulation.set_target(body, targets[static_cast<std::size_t>(index_of(joint_of(body)))], {});
    }
    simulation.set_slot_motion(0, {place(time), turned},
                               {(place(time + kStep) - place(time)) / kStep, Vector3::Zero()});
    watch.after_step(simulation, simulation.step(kStep), kStep);
    force = std::max(force, simulation.contact_wrench(0).force.norm());
    gap = std::min(gap, finger_gap(model, simulation.state()));
  }
  Findings findings;
  watch.judge(simulation, findings);
  findings.demand_at_least("pressed", "largest force of the tube", force, 20, "N");
  findings.demand_at_least("fingers", "smallest gap between bones of two fingers", gap * 1e3, 0, "mm");
  return findings;
}

}  // namespace

std::vector<Case> shape_cases() {
  CaseList cases("Shapes");
  auto* rows = &cases.add("grid_slide", "forces on a grid are those on the analytic shape within 1 %, without steps");
  for (const auto& [millimetres, speed] : {std::pair{0.5, 0.03}, {1.0, 0.03}, {2.0, 0.03}, {1.0, 0.003}, {1.0, 0.3}}) {
    rows->push_back({fmt::format("ball, cells {:g} mm, {:g} mm/s", millimetres, speed * 1e3),
                     [m = millimetres, v = speed] { return grid_slides(ball(0.02, m * 1e-3), v); },
                     {},
                     millimetres == 1 && speed == 0.03});
  }
  rows->push_back({"small ball, cells 0.5 mm, 30 mm/s", [] { return grid_slides(ball(0.006, 0.5e-3), 0.03); }});
  for (const double cell : {1.0, 3.0})
    rows->push_back(
        {fmt::format("block, cells {:g} mm, 30 mm/s", cell), [cell] { return grid_slides(block(cell * 1e-3), 0.03); }});
  rows = &cases.add("grid_drag", "the drag on a plate with oblique cells is mu f_n within 2 % and steady within 5 %");
  for (const double cell : {1.0, 3.0})
    for (const double speed : {2.5, 25.0})
      rows->push_back({fmt::format("cells {:g} mm, {:g} mm/s", cell, speed),
                       [=] { return grid_drag(cell * 1e-3, speed * 1e-3); },
                       {},
                       cell == 1 && speed == 25});
  rows = &cases.add("grid_deep_start", "the nodes leave the block, at less than 1 m/s");
  rows->push_back({"40 mm inside a block of 80 mm, cells 2 mm", [] { return grid_deep_start(2e-3); }, {}, true});
  rows = &cases.add("shell_crossing", "finger and wall meet fast: the finger never ends behind the wall");
  const auto crossings = [rows](const char* name, const std::function<Wall()>& wall) {
    constexpr int kTrials = 50;
    for (const double speed : {1.0, 5.0})
      for (const bool wall_moves : {true, false})
        rows->push_back({fmt::format("{}, {} moves at {:g} m/s", name, wall_moves ? "wall" : "finger", speed),
                         [=] { return crossing(wall(), wall_moves, speed, 60, kTrials); },
                         {},
                         speed == 5 && std::string(name) == (wall_moves ? "mug" : "plate of 1 mm")});
  };
  crossings("plate of 1 mm", [] { return plate(1e-3, 0.5e-3); });
  crossings("ball of 2 mm wall", [] { return sphere_shell(0.03, 2e-3, 1e-3); });
  crossings("mug", lying_mug);
  rows = &cases.add("shell_press",
                    "a finger that presses on a wall and slides along it stays on its side, without a pull");
  const auto press = [rows](const char* name, const std::function<Wall()>& wall, double depth, double way) {
    rows->push_back({fmt::format("{}, target {:g} mm behind, slides {:g} mm", name, depth, way),
                     [=] { return pressed(wall(), depth * 1e-3, way * 1e-3); },
                     {},
                     depth == 15});
  };
  const auto thin = [] { return plate(1e-3, 0.5e-3); };
  for (const double slides : {0.0, 15.0}) press("plate of 1 mm", thin, 4, slides);
  press("plate of 1 mm", thin, 15, 15);
  for (const double depth : {4.0, 15.0, 30.0}) press("mug", lying_mug, depth, 15);
  rows = &cases.add("tube", "a tube is pushed over five bunched fingers, and no finger passes another");
  for (const double millimetres : {20.0, 30.0})
    rows->push_back({named("bore", millimetres, "mm"),
                     [=] { return tube_over_the_fingers(1e-3 * millimetres); },
                     {},
                     millimetres == 20});
  return cases.take();
}

}  // namespace softhand::stress
