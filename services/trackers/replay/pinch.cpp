#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "trackers/replay/grip.hpp"
#include "trackers/replay/posture_solver.hpp"

namespace softhand {
namespace {

constexpr double kClear = 4.5e-3;    // m, clearance of everything that does not grip
constexpr double kBodyClear = 2e-3;  // m, from a vessel; its handle leaves little room
constexpr double kBeside = 17e-3;    // m, from the index finger to the bracing middle finger along the bar
constexpr double kAbove = 3e-3;      // m, height of the pads above the middle: room for the fingertips
constexpr std::size_t kShut = 0, kWide = 1;

struct Distance {
  double value;
  Vector3 gradient;
};
// Signed distance to a bar about the origin along x, negative inside.
Distance outside_bar(const Vector3& point, double half, double half_length) {
  const Vector3 q = point.cwiseAbs() - Vector3(half_length, half, half);
  Eigen::Index face;
  const double deepest = q.maxCoeff(&face);
  Vector3 gradient = q.cwiseMax(0.0);
  const double outside = gradient.norm();
  if (outside > 0) {
    gradient /= outside;
  } else {
    gradient = Vector3::Unit(face);
  }
  for (int i = 0; i < 3; ++i) gradient[i] = std::copysign(gradient[i], point[i]);
  return {outside + std::min(deepest, 0.0), gradient};
}

// Posture of thumb and index finger with pads `distance` apart that face each other as well as possible. Ignores all
// other goals. Starts from several bends of the index finger, and takes the posture whose pads face each other best.
JointAngles facing_pads(const GripHand& hand, double distance) {
  const auto goals = [distance](PostureSolver& s) {
    const auto thumb = s.pad(Finger::thumb, 0), index = s.pad(Finger::index, 0);
    const Vector3 between = index.position - thumb.position;
    const double length = between.norm();
    const Vector3 axis = between / length;
    s.add_residual(kPerMetre, length - distance,
                   {by_point(0, index.body, index.position, axis), by_point(0, thumb.body, thumb.position, -axis)});
    for (int i = 0; i < 3; ++i) {
      const Vector3 unit = Vector3::Unit(i),
                    across = (unit - axis * axis[i]) / length;  // gradient of axis[i] with respect to `between`
      const Change by_index = by_point(0, index.body, index.position, across),
                   by_thumb = by_point(0, thumb.body, thumb.position, across);
      const auto negative = [](const Change& c) { return Change{c.posture, c.body, -c.force, -c.torque}; };
      s.add_residual(12, thumb.normal[i] - axis[i],
                     {by_direction(0, thumb.body, thumb.normal, unit), negative(by_index), by_thumb});
      s.add_residual(12, index.normal[i] + axis[i],
                     {by_direction(0, index.body, index.normal, unit), by_index, negative(by_thumb)});
      s.add_residual(2, index.along[i] - thumb.along[i],
                     {by_direction(0, index.body, index.along, unit), by_direction(0, thumb.body, thumb.along, -unit)});
    }
    s.add_start_goal(10);
  };
  constexpr double kPerGap = 0.1 * kPerMetre;  // a wrong distance of 10 mm counts like pads that look away
  JointAngles best;
  double best_facing = -std::numeric_limits<double>::infinity();
  for (const auto& bend : {std::array{-0.6, -0.5, -0.3}, std::array{-0.9, -0.2, 0.0}, std::array{-0.3, -0.2, -0.1}}) {
    JointAngles start = hand.open();
    hand.flex(start, Finger::index, bend[0], bend[1], bend[2]);
    hand.flex(start, Finger::thumb, -0.1, -0.2, -0.2);
    PostureSolver solver(hand, Pose{}, {hand.limited(start)});
    for (const Finger f : {Finger::thumb, Finger::index}) solver.free_finger(f, {0});
    solver.solve(goals);
    const auto thumb = solver.pad(Finger::thumb, 0), index = solver.pad(Finger::index, 0);
    const Vector3 between = index.position - thumb.position;
    const double facing =
        (thumb.normal - index.normal).dot(between.normalized()) - kPerGap * std::abs(between.norm() - distance);
    if (facing <= best_facing) continue;
    best_facing = facing;
    best = solver.angles(0);
  }
  return best;
}

// The wrist pose that brings these pads to the grip's axis, with the wrist above the axis.
Pose wrist_above(const GripHand& hand, const JointAngles& facing) {
  const JointFrames frames = forward_kinematics(hand.model(), Pose{}, facing);
  const Vector3 thumb = hand.pad(Finger::thumb, frames).position, index = hand.pad(Finger::index, frames).position;
  const Vector3 axis = (thumb - index).normalized(), middle = 0.5 * (thumb + index);
  const Vector3 up = (-middle + axis * axis.dot(middle)).normalized();
  Matrix3 in_hand;
  in_hand << up.cross(axis), up, axis;
  Pose wrist;
  wrist.orientation = Quaternion(Matrix3(in_hand.transpose()));
  wrist.position = -(wrist.orientation * middle);
  return wrist;
}

// Goals for the grip and the widest opening. Both use the same wrist pose.
struct PinchGoals {
  double half;          // m, half width of the bar
  double half_length;   // m, of the bar
  double closed, open;  // m, distance of the pads from the middle
  double closing_depth, lower_depth, tilt;
  double free_below;                  // m, between the bar and the table
  double stagger;                     // m, from index to thumb along the bar
  double body_distance, body_radius;  // m, of a vessel behind the index finger; radius 0: there is none
  double brace_depth;                 // m, of the back of the middle finger in the vessel; 0: it does not touch
  double exact = 0, clear = 0;        // weights of the pad positions and of the clearance

  void keep_above_table(PostureSolver& s, std::size_t posture, const GripHand::Sphere& sphere, double weight) const {
    const double height = sphere.centre.y() + half + free_below - sphere.radius - lower_depth;
    if (height < kClear)
      s.add_residual(weight, kClear - height, {by_point(posture, sphere.body, sphere.centre, -Vector3::UnitY())});
  }
  // From the axis of the vessel.
  Vector3 from_axis(const Vector3& point) const { return {0, point.y(), point.z() + body_distance}; }

  void operator()(PostureSolver& s) const {
    for (const std::size_t posture : {kShut, kWide}) {
      place_pads(s, posture);
      keep_clear(s, posture);
      s.add_distance_goal(posture, {Finger::middle, Finger::ring, Finger::little}, 2e-3);
      if (brace_depth > 0) brace(s, posture);
    }
    const Vector3& wrist = s.wrist().position;
    const Vector3 up = wrist.normalized(), side(std::cos(tilt), -std::sin(tilt), 0);
    s.add_residual(1, side.dot(up), {by_point(kShut, Body::carpus, wrist, (side - up * up.dot(side)) / wrist.norm())});
    s.add_start_goal(2);
  }

 private:
  void place_pads(PostureSolver& s, std::size_t posture) const {
    const bool gripping = posture == kShut;
    const auto thumb = s.pad(Finger::thumb, posture), index = s.pad(Finger::index, posture);
    const double reach = gripping ? closed : open;
    const Vector3 x = Vector3::UnitX(), y = Vector3::UnitY(), z = Vector3::UnitZ();
    const auto thumb_touch = thumb.touch(-z), index_touch = index.touch(z);
    const Vector3 &thumb_at = thumb_touch.point, &index_at = index_touch.point;
    const auto by_thumb = [&](const Vector3& gradient) { return thumb_touch.change(posture, gradient); };
    const auto by_index = [&](const Vector3& gradient) { return index_touch.change(posture, gradient); };
    s.add_residual(exact, thumb_at.z() - reach, {by_thumb(z)});
    s.add_residual(exact, index_at.z() + reach, {by_index(z)});
    const double across = gripping ? exact : 0.1 * kPerMetre;
    s.add_residual(across, thumb_at.x() - 0.5 * stagger, {by_thumb(x)});
    s.add_residual(across, index_at.x() + 0.5 * stagger, {by_index(x)});
    s.add_residual(across, thumb_at.y() - index_at.y(), {by_thumb(y), by_index(-y)});
    s.add_residual((gripping ? 1.0 : 0.3) * kPerMetre, 0.5 * (thumb_at.y() + index_at.y()) - kAbove,
                   {by_thumb(0.5 * y), by_index(0.5 * y)});
    const double flat = gripping ? 9 : 1.0;
    s.add_direction_goal(flat, posture, thumb.body, thumb.normal, -z);
    s.add_direction_goal(flat, posture, index.body, index.normal, z);
    // The fingertips point down. Otherwise they would cross.
    const Vector3 down(-std::sin(tilt), -std::cos(tilt), 0);
    s.add_direction_goal(gripping ? 2 : 1, posture, thumb.body, thumb.along, down);
    s.add_direction_goal(gripping ? 3 : 1, posture, index.body, index.along, down);
  }

  // The middle finger is beside the index finger. Its back is on the vessel, or clear of it.
  void brace(PostureSolver& s, std::size_t posture) const {
    const auto middle = s.pad(Finger::middle, posture);
    const auto back = middle.touch(-from_axis(middle.centre).normalized());
    const Vector3 out = from_axis(back.point);
    s.add_residual(exact, out.norm() - body_radius - (posture == kShut ? -brace_depth : kBodyClear),
                   {back.change(posture, out.normalized())});
    s.add_residual(kPerMetre, middle.centre.x() - (kBeside - 0.5 * stagger),
                   {by_point(posture, middle.body, middle.centre, Vector3::UnitX())});
    s.add_residual(0.5 * kPerMetre, middle.centre.y() - kAbove,
                   {by_point(posture, middle.body, middle.centre, Vector3::UnitY())});
  }

  void keep_clear(PostureSolver& s, std::size_t posture) const {
    for (const GripHand::Sphere& sphere : s.spheres(posture)) {
      const Finger whose = finger_of(sphere.body);
      keep_above_table(s, posture, sphere, clear);
      const Vector3 out = from_axis(sphere.centre);
      const double body = out.norm() - body_radius - sphere.radius;
      if (body_radius > 0 && body < kBodyClear && !(brace_depth > 0 && sphere.body == distal_of(Finger::middle)))
        s.add_residual(clear, kBodyClear - body, {by_point(posture, sphere.body, sphere.centre, -out.normalized())});
      // The tracked pads are as deep in the cube as they would press, and so is the bone behind them. A flat pad also
      // takes the joint of its bone into the cube. Skip both.
      const bool grips = posture == kShut && (whose == Finger::thumb || whose == Finger::index);
      if (grips && (sphere.body == distal_of(whose) ||
                    (end_joint_of(sphere.body) == joint_of(distal_of(whose)) && sphere.along == 1)))
        continue;
      const double margin = grips ? 1e-3 - closing_depth : kClear;
      const Distance cube = outside_bar(sphere.centre, half, half_length);
      const double clearance = cube.value - sphere.radius;
      if (clearance < margin)
        s.add_residual(clear, margin - clearance, {by_point(posture, sphere.body, sphere.centre, -cube.gradient)});
    }
  }
};

struct Postures {
  Pose wrist;
  JointAngles shut, wide;
  double cost = std::numeric_limits<double>::infinity();
};

// The weights rise from pass to pass. The low first weights of clearance let bones pass obstacles from a distant start.
Postures improved(const GripHand& hand, const Postures& start, PinchGoals goals,
                  std::initializer_list<std::array<double, 2>> weights) {
  PostureSolver solver(hand, start.wrist, {start.shut, start.wide});
  solver.free_wrist();
  for (const std::size_t posture : {kShut, kWide}) {
    for (const Finger f : {Finger::thumb, Finger::index}) solver.free_finger(f, {posture});
  }
  for (const Finger f : {Finger::middle, Finger::ring, Finger::little}) {
    if (f == Finger::middle && goals.brace_depth > 0) {
      for (const std::size_t posture : {kShut, kWide}) solver.free_finger(f, {posture});
    } else {
      solver.free_finger(f, {kShut, kWide});
    }
  }
  double cost = 0;
  for (const auto& [exact, clear] : weights) {
    goals.exact = exact * kPerMetre;
    goals.clear = clear * kPerMetre;
    cost = solver.solve(goals);
  }
  return {solver.wrist(), solver.angles(kShut), solver.angles(kWide), cost};
}

// Solves from several starts and returns the best result. The unused fingers start curled or stretched, and the hand
// starts with different leans.
Postures solve_postures(const GripHand& hand, const JointAngles& facing, const PinchGoals& goals) {
  const Pose above = wrist_above(hand, facing);
  Postures best;
  for (const auto& posture : {std::array{-0.9, -1.2, -0.7}, std::array{0.3, -0.2, -0.1}}) {
    for (const double lean : {-1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2}) {
      Postures start;
      start.wrist = Pose{Vector3::Zero(), Quaternion(Eigen::AngleAxisd(goals.tilt + lean, -Vector3::UnitZ()))} * above;
      start.shut = facing;
      for (const Finger finger : {Finger::middle, Finger::ring, Finger::little})
        hand.flex(start.shut, finger, posture[0], posture[1], posture[2]);
      if (goals.brace_depth > 0) hand.flex(start.shut, Finger::middle, -0.6, -0.5, -0.3);
      start.shut = hand.limited(start.shut);
      start.wide = start.shut;
      const JointAngles wider = hand.from_open(0.4, start.shut);
      for (const Finger finger : {Finger::index, Finger::thumb}) {
        for (const JointAxis& axis : axes_of(finger)) {
          const auto body = static_cast<std::size_t>(index_of(axis.body));
          start.wide[body][axis.axis] = wider[body][axis.axis];
        }
      }
      const Postures found = improved(hand, start, goals, {{0.3, 0.03}, {1, 0.2}, {3, 1}, {10, 2}});
      if (found.cost < best.cost) best = found;
    }
  }
  return improved(hand, best, goals, {{30, 2}});
}

// Contact points of the pads, and the angles (rad) between the pads and the faces.
struct Touches {
  Vector3 thumb, index, middle;  // of the middle finger: its back, on the vessel
  double thumb_turn, index_turn;

  Touches(const GripHand& hand, const PinchGoals& goals, const Pose& wrist, const JointAngles& angles) {
    const JointFrames frames = forward_kinematics(hand.model(), wrist, angles);
    const auto thumb_pad = hand.pad(Finger::thumb, frames), index_pad = hand.pad(Finger::index, frames);
    const auto middle_pad = hand.pad(Finger::middle, frames);
    thumb = thumb_pad.touch(-Vector3::UnitZ()).point;
    index = index_pad.touch(Vector3::UnitZ()).point;
    thumb_turn = std::acos(std::clamp(-thumb_pad.normal.z(), -1.0, 1.0));
    index_turn = std::acos(std::clamp(index_pad.normal.z(), -1.0, 1.0));
    middle = middle_pad.touch(-goals.from_axis(middle_pad.centre).normalized()).point;
  }
  double gap() const { return thumb.z() - index.z(); }
};

// The least clearance (m) between the bar and the fingers with their widest opening.
double clearance(const GripHand& hand, const PinchGoals& goals, const Pose& wrist, const JointAngles& wide) {
  double least = std::numeric_limits<double>::infinity();
  for (const GripHand::Sphere& sphere : hand.spheres(forward_kinematics(hand.model(), wrist, wide)))
    least = std::min(least, outside_bar(sphere.centre, goals.half, goals.half_length).value - sphere.radius);
  return least;
}

// Names the first requirement of a pinch that the postures do not meet. Empty if they grip.
std::string unreached(const PinchGoals& goals, const Touches& shut, const Touches& wide, double clear) {
  constexpr double kNear = 1e-3;                   // m
  constexpr double kWidestTurn = 60 * M_PI / 180;  // rad
  const auto text = [](const char* what, double found, const char* unit, const std::string& expected) {
    return std::string(what) + " " + std::to_string(found) + " " + unit + "; expected " + expected;
  };
  const auto millimetres = [](double metres) { return std::to_string(metres * 1e3) + " mm"; };
  for (const auto& [name, turn] : {std::pair{"thumb", shut.thumb_turn}, {"index finger", shut.index_turn}}) {
    if (turn > kWidestTurn)
      return text((std::string("the pad of the ") + name + " is turned from its face by").c_str(), turn * 180 / M_PI,
                  "degrees", "at most 60");
  }
  if (std::max(std::abs(shut.thumb.z() - goals.closed), std::abs(shut.index.z() + goals.closed)) > kNear)
    return text("the closed pads are apart by", shut.gap() * 1e3, "mm", millimetres(2 * goals.closed));
  if (std::min(wide.thumb.z(), -wide.index.z()) < goals.half + kNear)
    return text("the open pads are apart by", wide.gap() * 1e3, "mm",
                "at least " + millimetres(2 * (goals.half + kNear)) + " around its middle");
  if (clear < kNear)
    return text("the clearance of the open hand is", clear * 1e3, "mm", "at least " + millimetres(kNear));
  if (std::max(std::abs(shut.thumb.x() - 0.5 * goals.stagger), std::abs(shut.index.x() + 0.5 * goals.stagger)) > kNear)
    return text("along the bar the thumb is beyond the index finger by", (shut.thumb.x() - shut.index.x()) * 1e3, "mm",
                millimetres(goals.stagger));
  const double height = std::max(std::abs(shut.thumb.y()), std::abs(shut.index.y()));
  if (height > goals.half)
    return text("the pads touch at a height above or below the middle of", height * 1e3, "mm",
                "at most " + millimetres(goals.half) + ", the end of the faces");
  if (goals.brace_depth > 0) {
    const double depth = goals.body_radius - goals.from_axis(shut.middle).norm();
    if (std::abs(depth - goals.brace_depth) > kNear)
      return text("the back of the middle finger is in the vessel by", depth * 1e3, "mm",
                  millimetres(goals.brace_depth));
  }
  return {};
}

}  // namespace

// Wrist, grip and widest opening are solved together, so that one wrist pose serves both. Then the motion between them
// is solved with a fixed wrist.
Grip solve_pinch(const HandModel& model, const GeneratorOptions& o) {
  const GripHand hand(model);
  const double half = 0.5 * o.object_width, deepest = std::max(o.closing_depth, o.squeeze_depth);
  PinchGoals goals{half,           std::max(half, 0.5 * o.object_length),
                   half - deepest, half + o.opening,
                   deepest,        o.lower_depth,
                   o.tilt,         o.free_below,
                   o.stagger,      o.body_distance,
                   o.body_radius,  o.brace_depth};
  const JointAngles facing = facing_pads(hand, 2 * goals.closed);
  // Only the opening may be smaller than requested. A smaller opening still grips, but an impossible one would spoil
  // the grip.
  Postures best;
  std::string missing;
  for (const double share : {1.0, 0.75, 0.5, 0.25}) {
    goals.open = half + share * o.opening;
    best = solve_postures(hand, facing, goals);
    missing = unreached(goals, {hand, goals, best.wrist, best.shut}, {hand, goals, best.wrist, best.wide},
                        clearance(hand, goals, best.wrist, best.wide));
    if (missing.empty()) break;
  }
  if (!missing.empty()) {
    throw std::invalid_argument("generator: pinch of " + std::to_string(o.object_width * 1e3) + " mm: " + missing +
                                ". Use an object_width that the hand can span, or change the place of the fingers");
  }
  const Touches shut(hand, goals, best.wrist, best.shut), wide(hand, goals, best.wrist, best.wide);
  Grip grip;
  grip.wrist = best.wrist;
  grip.gripping = (deepest - o.closing_depth) / (0.5 * (wide.gap() - shut.gap()));
  for (std::size_t k = 0; k < kApertures; ++k) {
    const double s = static_cast<double>(k) / (kApertures - 1);
    JointAngles between = best.shut;
    for (std::size_t b = 2; b < kBodyCount; ++b) between[b] = (1 - s) * best.shut[b] + s * best.wide[b];
    PostureSolver solver(hand, grip.wrist, {between});
    for (const Finger f : {Finger::thumb, Finger::index}) solver.free_finger(f, {0});
    solver.solve([&](PostureSolver& way) {
      const Vector3 z = Vector3::UnitZ();
      constexpr double kOnTheWay = 30 * kPerMetre;
      way.add_touch_goal(kOnTheWay, 0, way.pad(Finger::thumb, 0).touch(-z), (1 - s) * shut.thumb + s * wide.thumb);
      way.add_touch_goal(kOnTheWay, 0, way.pad(Finger::index, 0).touch(z), (1 - s) * shut.index + s * wide.index);
      for (const GripHand::Sphere& sphere : way.spheres(0)) goals.keep_above_table(way, 0, sphere, 0.5 * kOnTheWay);
      way.add_start_goal(0.5);
    });
    grip.apertures.push_back(solver.angles(0));
  }
  place_in_world(grip, o, Vector3::UnitY());
  return grip;
}

}  // namespace softhand
