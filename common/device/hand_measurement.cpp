#include "device/hand_measurement.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "device/body_mount.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "model/kinematics.hpp"

namespace softhand {
namespace {

constexpr double kLeastConfidence = 0.5;
constexpr std::size_t kFewestSamples = 20;                        // of a joint in a posture
constexpr double kThinnestRadius = 2e-3, kThickestRadius = 0.05;  // m; others are unknown
constexpr double kStraight = 1.2;  // rad, most flexion of a flat finger, of its three joints
constexpr double kClosing = 1.5;   // rad, least flexion that the fist adds to it
constexpr double kAcross =
    0.7;  // largest distance of thumb and little finger across the palm, as a part of the flat one
constexpr double kTail = 0.02;                       // of the samples, left out at each end of a range
constexpr double kSteady = 3e-3, kSteadyPart = 0.2;  // m and 1, largest standard deviation of a length
constexpr int kMedianPasses = 5;
constexpr std::array<const char*, kPostureCount> kNames{"flat hand", "fist", "thumb across", "relaxed hand"};

// `part` of the values are below it.
double quantile(std::vector<double> values, double part) {
  const auto place = values.begin() + std::lround(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}
double median(std::vector<double> values) { return quantile(std::move(values), 0.5); }

Vector3 median(const std::vector<Vector3>& values) {
  Vector3 out;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> along;
    for (const Vector3& value : values) along.push_back(value[axis]);
    out[axis] = median(std::move(along));
  }
  return out;
}

// The orientation from which the rotation vectors of `poses` have the median zero. `turns` are these vectors.
Quaternion median_orientation(const std::vector<Pose>& poses, std::vector<Vector3>& turns) {
  Quaternion out = poses.front().orientation;
  turns.resize(poses.size());
  for (int pass = 0; pass < kMedianPasses; ++pass) {
    if (pass > 0) out = (out * rotation_exp(median(turns))).normalized();
    for (std::size_t i = 0; i < poses.size(); ++i) turns[i] = rotation_log(out.conjugate() * poses[i].orientation);
  }
  return out;
}

[[noreturn]] void refuse(Posture posture, const std::string& problem) {
  const auto step = static_cast<std::size_t>(posture);
  throw std::runtime_error("step " + std::to_string(step + 1) + " of " + std::to_string(kPostureCount) + " (" +
                           kNames[step] + "): " + problem);
}

std::string degrees(double radians) { return std::to_string(std::lround(radians * 180 / M_PI)) + " degrees"; }
std::string millimetres(double metres) { return std::to_string(std::lround(metres * 1e3)) + " mm"; }
std::string name(Finger finger) { return std::string(kFingerNames[static_cast<std::size_t>(finger)]); }

}  // namespace

void HandMeasurement::add(Posture posture, const Skeleton& sample) {
  if (!(sample.confidence >= kLeastConfidence)) return;
  Frame frame;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const JointSample& joint = sample.joints[j];
    if ((joint.flags & kJointValid) == 0 || !(joint.confidence >= kLeastConfidence)) continue;
    frame.joints[j] = to_pose(joint);
    frame.good[j] = make_plausible(frame.joints[j]);
    if (joint.radius >= kThinnestRadius && joint.radius <= kThickestRadius) radii_[j].push_back(joint.radius);
  }
  frames_[static_cast<std::size_t>(posture)].push_back(frame);
}

// Median of the finger's flexion against its metacarpal.
double HandMeasurement::flexion(Posture posture, Finger finger) const {
  std::vector<double> sums;
  for (const Frame& frame : of(posture)) {
    double sum = 0;
    bool is_good = true;
    for (int joint = index_of(tip_of(finger)) - 3; joint < index_of(tip_of(finger)); ++joint) {
      const std::size_t j = static_cast<std::size_t>(joint), parent = slot_of(parent_of(static_cast<Joint>(joint)));
      is_good = is_good && frame.good[j] && frame.good[parent];
      sum -= rotation_log(frame.joints[parent].orientation.conjugate() * frame.joints[j].orientation).x();
    }
    if (is_good) sums.push_back(sum);
  }
  return sums.empty() ? 0 : median(std::move(sums));
}

// Median of the distance from the tip of the thumb to the base of the little finger.
double HandMeasurement::thumb_distance(Posture posture) const {
  std::vector<double> distances;
  const std::size_t tip = slot_of(Joint::thumb_tip), base = slot_of(Joint::little_proximal);
  for (const Frame& frame : of(posture)) {
    if (frame.good[tip] && frame.good[base])
      distances.push_back((frame.joints[tip].position - frame.joints[base].position).norm());
  }
  return distances.empty() ? 0 : median(std::move(distances));
}

void HandMeasurement::check(Posture posture) const {
  for (std::size_t j = 0; j < kJointCount; ++j) {
    if (static_cast<Joint>(j) == Joint::palm) continue;  // not every tracker has one
    const auto count = static_cast<std::size_t>(
        std::count_if(of(posture).begin(), of(posture).end(), [j](const Frame& frame) { return frame.good[j]; }));
    if (count >= kFewestSamples) continue;
    refuse(posture, "the joint " + std::string(kJointNames[j]) + " was seen well in " + std::to_string(count) +
                        " samples, expected at least " + std::to_string(kFewestSamples) +
                        ". Hold the hand where the tracker sees all of it, and start again");
  }
  for (const Finger finger : {Finger::index, Finger::middle, Finger::ring, Finger::little}) {
    const double flat = flexion(Posture::flat, finger);
    if (posture == Posture::flat && flat > kStraight)
      refuse(posture, "the " + name(finger) + " finger was bent by " + degrees(flat) + ", expected at most " +
                          degrees(kStraight) + ". Stretch all fingers, and start again");
    const double closing = flexion(posture, finger) - flat;
    if (posture == Posture::fist && closing < kClosing)
      refuse(posture, "the " + name(finger) + " finger closed by " + degrees(closing) + ", expected at least " +
                          degrees(kClosing) + ". Close all fingers to a fist, and start again");
  }
  if (posture != Posture::thumb_across) return;
  const double flat = thumb_distance(Posture::flat), across = thumb_distance(posture);
  if (across > kAcross * flat)
    refuse(posture, "the tip of the thumb was " + millimetres(across) +
                        " from the base of the little finger, expected " + "at most " + millimetres(kAcross * flat) +
                        ". Lay the thumb across the palm of the open hand, and start again");
}

std::vector<Pose> HandMeasurement::local_poses(Joint joint) const {
  std::vector<Pose> poses;
  const std::size_t j = slot_of(joint), parent = slot_of(parent_of(joint));
  for (const auto& frames : frames_) {
    for (const Frame& frame : frames)
      if (frame.good[j] && frame.good[parent]) poses.push_back(frame.joints[parent].inverse() * frame.joints[j]);
  }
  return poses;
}

UserHand HandMeasurement::measure(Side side) const {
  for (std::size_t step = 0; step < kPostureCount; ++step) check(static_cast<Posture>(step));
  UserHand user;
  user.side = side == Side::left ? "left" : "right";
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    UserJoint& out = user.joints[j];
    if (!radii_[j].empty()) out.radius = median(radii_[j]);
    const std::vector<Pose> poses = local_poses(joint);
    if (joint == Joint::wrist || poses.empty()) continue;
    std::vector<Vector3> offsets, turns;
    std::vector<double> lengths;
    for (const Pose& pose : poses) {
      offsets.push_back(pose.position);
      lengths.push_back(pose.position.norm());
    }
    out.offset = to_wire(median(offsets));
    const double length = median(lengths);
    for (double& each : lengths) each = std::abs(each - length);
    const double deviation = 1.4826 * median(lengths);  // of a normal distribution
    if (joint != Joint::palm && deviation > std::max(kSteady, kSteadyPart * length))
      throw std::runtime_error("the length from " + std::string(kJointNames[slot_of(parent_of(joint))]) + " to " +
                               std::string(kJointNames[j]) + " varied by " + millimetres(deviation) + " around " +
                               millimetres(length) +
                               ". The tracker does not see this bone well: hold the hand nearer to it or in better " +
                               "light, and start again");
    out.orientation = to_wire(median_orientation(poses, turns));
    const auto range = [&turns](int axis) {
      std::vector<double> angles;
      for (const Vector3& turn : turns) angles.push_back(turn[axis]);
      return std::array{quantile(angles, kTail), quantile(angles, 1 - kTail)};
    };
    out.flexion = range(0);
    out.abduction = range(1);
  }
  UserJoint& palm = user.joints[slot_of(Joint::palm)];
  if (palm.offset == Vec3{})
    palm.offset = to_wire(Vector3(0.5 * to_vector(user.joints[slot_of(Joint::middle_proximal)].offset)));
  return user;
}

}  // namespace softhand
