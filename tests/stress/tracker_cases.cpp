// Tracker cases: jumps, freezes, NaN, wrong clocks, impossible hands.
#include <cmath>
#include <limits>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "stress/cases.hpp"
#include "stress/grasp.hpp"

namespace softhand::stress {
namespace {

constexpr double kWristFollows = 15e-3;  // m, distance between simulated and tracked wrist at the end
const std::size_t kWrist = static_cast<std::size_t>(index_of(Joint::wrist));
const std::size_t kIndex = static_cast<std::size_t>(index_of(Joint::index_intermediate));

using Samples = std::deque<Skeleton>;

void move_all(Skeleton& skeleton, const Pose& by) {
  for (JointSample& joint : skeleton.joints) {
    const Pose pose = by * to_pose(joint);
    joint.position = to_wire(pose.position);
    joint.orientation = to_wire(pose.orientation);
  }
}

// Turns the hand about its own wrist.
void turn_about_wrist(Skeleton& skeleton, const Vector3& turn) {
  const Pose wrist = to_pose(skeleton.joints[kWrist]);
  const Quaternion rotation = wrist.orientation * rotation_exp(turn) * wrist.orientation.conjugate();
  move_all(skeleton, {wrist.position - rotation * wrist.position, rotation});
}

// Runs a grasp. At the end the hand must be where the tracker last reported it.
Grasped run_faulty(Grasp setting, bool follow = true) {
  Vec3 target{};
  const auto inner = setting.tracker;
  setting.tracker = [&target, inner](double time, Samples& samples) {
    if (inner) inner(time, samples);
    if (!samples.empty() && softhand::all_finite(samples.back().joints[kWrist].position))
      target = samples.back().joints[kWrist].position;
  };
  Vector3 reached = Vector3::Zero();
  setting.at_step = [&reached](VirtualRig& rig, double) {
    reached = rig.hand().simulation().joint_pose(Joint::wrist).position;
  };
  Grasped result = grasp(setting);
  if (follow)
    result.findings.demand("follows", "distance between simulated and tracked wrist at the end",
                           (reached - to_vector(target)).norm() * 1e3, kWristFollows * 1e3, "mm");
  return result;
}

// The hand moves in the air, half a metre over the table.
Grasp in_the_air() {
  Grasp setting;
  setting.held = false;
  setting.overrides = {"generator.motion=free_motion", "generator.object_position=[0,0.5,0]",
                       "generator.free_time=600"};
  return setting;
}

Findings teleport(bool with_object) {
  Grasp setting;
  setting.seconds = 3;
  setting.held = false;
  const double when = with_object ? kEvent : 0.1;
  setting.overrides = {fmt::format("tracker.teleport_at={}", when), "tracker.teleport_offset=[10,0,0]",
                       "tracker.teleport_time=0.7"};
  Grasped result = run_faulty(setting);
  result.demand_slow_cube();
  return result.findings;
}

Findings half_turn(const Vector3& axis, double angle) {
  Grasp setting = in_the_air();
  setting.tracker = [axis, angle](double time, Samples& samples) {
    if (time > 0.15) turn_about_wrist(samples.front(), angle * axis);
  };
  return run_faulty(setting).findings;
}

Findings twist() {
  Grasp setting = in_the_air();
  setting.seconds = 3;
  setting.tracker = [](double time, Samples& samples) {
    turn_about_wrist(samples.front(), 720 * kDegree * minimum_jerk((time - 0.15) / 2) * Vector3::UnitZ());
  };
  return run_faulty(setting).findings;
}

Findings sign_flips() {
  Grasp setting;
  const Grasped plain = grasp(setting);
  setting.overrides = {"tracker.flip_signs=true"};
  Grasped flipped = run_faulty(setting);
  flipped.findings.demand("same", "largest distance of a node from a run without flips",
                          (plain.state.node_positions - flipped.state.node_positions).cwiseAbs().maxCoeff(), 1e-9, "m");
  return flipped.findings;
}

// Scales the quaternion of one bone from 0.6 s on.
Findings quaternion_length(double length) {
  Grasp setting;
  setting.tracker = [length](double time, Samples& samples) {
    if (time < 0.6) return;
    for (double& x : samples.front().joints[kIndex].orientation) x *= length;
  };
  Grasped result = run_faulty(setting);
  const bool usable = length >= 0.5 && length <= 2;
  const auto refused = static_cast<double>(result.tracking.refused_implausible);
  if (usable) {
    result.findings.demand("accepted", "joints refused", refused, 0, "1");
  } else {
    result.findings.demand_at_least("counted", "joints refused", refused, 100, "1");
  }
  return result.findings;
}

// Sets all numbers of one bone to `value` from 0.6 s on, so that they give no valid pose.
Findings bone_value(double value) {
  Grasp setting;
  setting.tracker = [value](double time, Samples& samples) {
    if (time < 0.6) return;
    samples.front().joints[kIndex].position.fill(value);
    samples.front().joints[kIndex].orientation.fill(value);
  };
  Grasped result = run_faulty(setting);
  result.findings.demand_at_least(
      "counted", "joints refused",
      static_cast<double>(result.tracking.refused_nonfinite + result.tracking.refused_implausible), 100, "1");
  return result.findings;
}

Findings freeze() {
  constexpr double kSlip = 1e-3, kFlag = 0.1;  // m, s
  Grasp setting;
  setting.seconds = 4;
  setting.overrides = {fmt::format("tracker.freeze_at={}", kEvent), "tracker.freeze_time=2"};
  Grasped result = run_faulty(setting);
  result.findings.demand("G7", "last sample to the stale flag",
                         result.first_stale < 0 ? std::nan("") : (result.first_stale - kEvent) * 1e3, kFlag * 1e3,
                         "ms");
  result.findings.demand("slip", "slip of the cube during the freeze and 0.5 s after it", result.slip(kEvent, 4) * 1e3,
                         kSlip * 1e3, "mm");
  return result.findings;
}

Findings dropout() {
  Grasp setting;
  setting.seconds = 4.5;
  setting.held = false;
  setting.overrides = {fmt::format("tracker.freeze_at={}", kEvent), "tracker.freeze_time=2"};
  setting.tracker = [](double time, Samples& samples) {
    if (time > kEvent + 1) move_all(samples.front(), {Vector3(0, 0.3, 0), Quaternion::Identity()});
  };
  Grasped result = run_faulty(setting);
  result.demand_slow_cube();
  return result.findings;
}

// Samples are missing again and again, while the hand grasps, lifts and holds.
Findings gaps(double seconds) {
  Grasp setting;
  setting.seconds = 3;
  setting.overrides = {"tracker.dropout_period=0.5", fmt::format("tracker.dropout_time={}", seconds)};
  return run_faulty(setting).findings;
}

Findings tracker_rate(double rate) {
  Grasp setting;
  setting.seconds = 3;
  setting.overrides = {fmt::format("tracker.rate_hz={}", rate), "generator.lift_time=1.2"};  // 5 mm per sample at 10 Hz
  return run_faulty(setting).findings;
}

Findings order(const std::function<void(double, Samples&)>& change, bool refusals) {
  Grasp setting;
  setting.tracker = change;
  Grasped result = run_faulty(setting);
  if (refusals)
    result.findings.demand_at_least("counted", "samples refused because of their order",
                                    static_cast<double>(result.tracking.refused_order), 10, "1");
  return result.findings;
}

std::function<void(double, Samples&)> duplicates() {
  return [](double, Samples& samples) { samples.push_back(samples.front()); };
}

// Delivers every other sample after its successor.
std::function<void(double, Samples&)> swaps() {
  return [delayed = Samples{}, n = 0](double, Samples& samples) mutable {
    if (n++ % 2 == 0) {
      delayed = samples;
      samples.clear();
    } else {
      samples.push_back(delayed.front());
    }
  };
}

std::function<void(double, Samples&)> equal_stamps() {
  return [last = Nanoseconds{0}, n = 0](double, Samples& samples) mutable {
    if (n++ % 2 == 0) last = samples.front().stamp.sample_time;
    samples.front().stamp.sample_time = last;
  };
}

std::function<void(double, Samples&)> clock_off_by(double seconds) {
  return [seconds](double, Samples& samples) {
    samples.front().stamp.sample_time += static_cast<Nanoseconds>(seconds * 1e9);
  };
}

// The device's clock jumps back by half an hour at 0.8 s and runs backwards from then on.
std::function<void(double, Samples&)> clock_backwards() {
  return [](double time, Samples& samples) {
    if (time > 0.8) samples.front().stamp.sample_time -= static_cast<Nanoseconds>((1800 + 2 * (time - 0.8)) * 1e9);
  };
}

// `cutoff`: of the filter on the tracker's poses, Hz; 0: no filter.
Findings noise(double cutoff) {
  constexpr double kJitter = 0.2e-3;  // m RMS
  Grasp setting;
  setting.seconds = 3;
  setting.overrides = {"tracker.position_noise=0.001", fmt::format("tracker.rotation_noise={}", 1 * kDegree),
                       fmt::format("tracking.input.smoothing_cutoff={}", cutoff)};
  Grasped result = run_faulty(setting);
  result.findings.demand("jitter", "movement of the held cube about its mean over 1.4 s, RMS",
                         result.jitter(1.6, 3) * 1e3, kJitter * 1e3, "mm");
  return result.findings;
}

// Bends all fingers back by a right angle at every joint, through each other and through the back of the hand.
Findings impossible_pose() {
  Grasp setting = in_the_air();
  setting.tracker = [](double time, Samples& samples) {
    const double angle = 90 * kDegree * minimum_jerk((time - 0.2) / 0.4);
    for (int finger = 0; finger < kFingerCount; ++finger) {
      const int tip = index_of(tip_of(static_cast<Finger>(finger)));
      for (int pivot = tip - 3; pivot < tip; ++pivot) {
        const Pose joint = to_pose(samples.front().joints[static_cast<std::size_t>(pivot)]);
        const Quaternion turn = joint.orientation * rotation_exp(Vector3(angle, 0, 0)) * joint.orientation.conjugate();
        for (int j = pivot; j <= tip; ++j) {
          JointSample& moved = samples.front().joints[static_cast<std::size_t>(j)];
          const Pose pose = to_pose(moved);
          moved.position = to_wire(Vector3(joint.position + turn * (pose.position - joint.position)));
          moved.orientation = to_wire((turn * pose.orientation).normalized());
        }
      }
    }
  };
  return run_faulty(setting).findings;
}

// Scales the distance of all joints from the wrist.
Findings bone_length(double factor) {
  Grasp setting = in_the_air();
  setting.tracker = [factor](double, Samples& samples) {
    const Vector3 wrist = to_vector(samples.front().joints[kWrist].position);
    for (JointSample& joint : samples.front().joints)
      joint.position = to_wire(Vector3(wrist + factor * (to_vector(joint.position) - wrist)));
  };
  return run_faulty(setting, false).findings;
}

}  // namespace

std::vector<Case> tracker_cases() {
  CaseList cases("Tracker");
  auto* rows = &cases.add("teleport", "the hand jumps by 10 m and back after 0.7 s, and the cube stays below 5 m/s");
  rows->push_back({"free",
                   [] { return teleport(false); },
                   {Class::violated, "the grip closes in full motion after the hand has jumped back"}});
  rows->push_back({"with the cube held", [] { return teleport(true); }, {}, true});
  rows = &cases.add("half_turn", "the tracked hand turns from one sample to the next, and the simulated hand follows");
  const std::array<std::pair<const char*, Vector3>, 3> axes{
      {{"x", Vector3::UnitX()}, {"y", Vector3::UnitY()}, {"z", Vector3::UnitZ()}}};
  for (const auto& [name, axis] : axes) {
    for (const double angle : {180.0, 179.999, 180.001}) {
      rows->push_back({fmt::format("{:g} degrees about {}", angle, name),
                       [axis, angle] { return half_turn(axis, angle * kDegree); },
                       {},
                       angle == 180.0 && axis.x() == 1});
    }
  }
  cases.add("twist", "the hand turns by 720 degrees in 2 s about its long axis")
      .push_back({"720 degrees", [] { return twist(); }, {}, true});
  cases.add("sign_flips", "q and -q alternate, and the result equals a run without sign flips")
      .push_back({"each sample", [] { return sign_flips(); }, {}, true});
  rows = &cases.add("quaternion_length",
                    "length of one bone's quaternion: 0.5 to 2 is normalised, else the bone is refused and counted");
  for (const double length : {0.5, 2.0, 1e-20, 0.0})
    rows->push_back({named("|q|", length), [length] { return quaternion_length(length); }, {}, length == 1e-20});
  rows = &cases.add("bone_value",
                    "one bone with this value in all its numbers is refused and counted, the other bones go on");
  for (const double value :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e308, 5e-324}) {
    rows->push_back({named("value", value), [value] { return bone_value(value); }, {}, true});
  }
  cases.add("freeze", "the tracker freezes for 2 s in a grasp: slip at most 1 mm, stale flag within 100 ms")
      .push_back({"2 s", [] { return freeze(); }, {}, true});
  cases.add("dropout", "no samples for 2 s, then the hand is 0.3 m away, and the cube stays below 5 m/s")
      .push_back({"2 s", [] { return dropout(); }});
  cases.add("gaps", "samples are missing at the end of each half second, and the cube is lifted and held")
      .push_back({"100 ms", [] { return gaps(0.1); }, {}, true});
  rows = &cases.add("tracker_rate", "the cube is lifted and held");
  for (const double rate : {10.0, 90.0, 500.0, 1000.0})
    rows->push_back({named("rate", rate, "Hz"), [rate] { return tracker_rate(rate); }, {}, rate == 10});
  rows = &cases.add("order", "the cube is lifted and held, and refused samples are counted");
  rows->push_back({"each sample twice", [] { return order(duplicates(), true); }});
  rows->push_back({"neighbours swapped", [] { return order(swaps(), true); }});
  rows->push_back({"stamps equal in pairs", [] { return order(equal_stamps(), true); }});
  rows = &cases.add("clock", "the cube is lifted and held");
  rows->push_back({"1 h ahead", [] { return order(clock_off_by(3600), false); }});
  rows->push_back({"1 h behind", [] { return order(clock_off_by(-3600), false); }});
  rows->push_back({"backwards from 0.8 s on", [] { return order(clock_backwards(), false); }});
  rows = &cases.add("noise", "held cube within 0.2 mm RMS");
  rows->push_back({"1 mm, 1 degree",
                   [] { return noise(0); },
                   {Class::violated, "the tracker's poses are not filtered: `smoothing_cutoff` is 0, its default"},
                   true});
  rows->push_back({"1 mm, 1 degree, smoothing_cutoff 0.3 Hz", [] { return noise(0.3); }, {}, true});
  cases.add("impossible_pose", "").push_back({"all fingers bent back at every joint", [] {
                                                return impossible_pose();
                                              }});
  rows = &cases.add("bone_length", "");
  for (const double factor : {0.5, 2.0})
    rows->push_back({named("factor", factor), [factor] { return bone_length(factor); }});
  return cases.take();
}

}  // namespace softhand::stress
