#include "trackers/replay/hand_to_hand.hpp"

#include <algorithm>
#include <cmath>

#include "messages/convert.hpp"
#include "trackers/replay/posture_solver.hpp"

namespace softhand {
namespace {

// Of the skin below the bones that `counts`, m in the wrist's frame.
template <typename Counts>
double lowest_skin(const GripHand& hand, const JointAngles& angles, Counts&& counts) {
  double lowest = 1;
  for (const GripHand::Sphere& sphere : hand.spheres(forward_kinematics(hand.model(), Pose{}, angles)))
    if (counts(sphere.body)) lowest = std::min(lowest, sphere.centre.y() - sphere.radius);
  return lowest;
}

bool is_palm(Body body) { return is_metacarpal(body) && finger_of(body) != Finger::thumb; }

// Each finger straightens from the open hand until its tip is as high as the palm. The thumb rises beside it.
JointAngles flat_hand(const HandModel& model) {
  constexpr int kSteps = 100;
  const GripHand hand(model);
  const double palm = lowest_skin(hand, hand.open(), is_palm);
  JointAngles flat = hand.open();
  for (const Finger finger : kFourFingers) {
    const auto is_tip = [&](Body body) { return body == distal_of(finger); };
    for (int step = 0; step <= kSteps; ++step) {
      const double s = static_cast<double>(step) / kSteps;
      JointAngles tried = flat;
      hand.flex(tried, finger, 0.5 * s, 0.8 * s, 0.5 * s);
      tried = hand.limited(tried);
      if (step < kSteps && lowest_skin(hand, tried, is_tip) < palm) continue;
      flat = tried;
      break;
    }
  }
  PostureSolver solver(hand, Pose{}, {flat});
  solver.free_finger(Finger::thumb, {0});
  solver.solve([palm](PostureSolver& s) {
    const auto thumb = s.pad(Finger::thumb, 0);
    s.add_residual(0.3 * kPerMetre, thumb.centre.y() - thumb.radius - palm,
                   {by_point(0, thumb.body, thumb.centre, Vector3::UnitY())});
    s.add_start_goal(0.5);
  });
  return solver.angles(0);
}

// The flat hand moves along X with one posture. A subclass says how it is turned, where it meets the other hand, and
// when.
class HandToHand : public Motion {
 public:
  HandToHand(const HandModel& model, const GeneratorOptions& options)
      : model_(model), options_(options), flat_(flat_hand(model_)) {}
  double duration() const override { return phases_.back().end; }
  std::vector<MotionPhase> phases() const override { return phases_; }
  const std::array<double, kJointCount>& radii() const override { return model_.joint_radii; }
  JointFrames at(double time) const override {
    Pose wrist = meeting_;
    wrist.position.x() += side() * distance_at(std::clamp(time, 0.0, duration()));
    return forward_kinematics(model_, wrist, flat_);
  }

 protected:
  double side() const { return model_.side == Side::right ? 1 : -1; }
  /// In the wrist's frame.
  JointFrames posture() const { return forward_kinematics(model_, Pose{}, flat_); }
  /// From the place where the hand meets the middle, m; negative beyond it.
  virtual double distance_at(double time) const = 0;
  void add_phase(const char* name, double seconds) {
    const double begin = phases_.empty() ? 0 : phases_.back().end;
    phases_.push_back({name, begin, begin + seconds});
  }

  HandModel model_;
  GeneratorOptions options_;
  JointAngles flat_;
  Pose meeting_;  // of the wrist, where palm or fingertip meets the middle
  std::vector<MotionPhase> phases_;
};

// Palms face each other, and the fingers point to -Z. Between two claps the hand swings as |sin|, so it meets the other
// at full speed.
class Clap final : public HandToHand {
 public:
  Clap(const HandModel& model, const GeneratorOptions& options) : HandToHand(model, options) {
    const JointFrames frames = posture();
    // The skin of the palm lies lower than its round bones say.
    double lowest = lowest_skin(GripHand(model_), flat_, is_palm);
    for (std::size_t n = 0; n < model_.nodes.size(); ++n)
      if (is_palm(static_cast<Body>(model_.node_body[n]))) lowest = std::min(lowest, model_.nodes[n].y());
    meeting_.orientation = Quaternion(Eigen::AngleAxisd(-side() * M_PI / 2, Vector3::UnitZ()));
    Vector3 palm = frames[slot_of(Joint::palm)].position;
    palm.y() = lowest;
    meeting_.position = to_vector(options.object_position) - meeting_.orientation * palm;
    add_phase("approach", options.approach_time);
    for (std::int64_t i = 0; i < options.repeats; ++i) {
      add_phase("close", options.close_time / 2);
      add_phase("open", options.close_time / 2);
    }
    add_phase("retreat", options.retreat_time);
  }

 private:
  double distance_at(double time) const override {
    const double begin = phases_.front().end, end = phases_.back().begin;
    const double swing = std::abs(std::cos(M_PI * (std::clamp(time, begin, end) - begin) / options_.close_time));
    return (options_.approach_distance + options_.closing_depth) * swing - options_.closing_depth;
  }
};

// Palms face down, and the fingers point at the other hand, which is a quarter of the fingers' pitch nearer to the
// user.
class Interlace final : public HandToHand {
 public:
  Interlace(const HandModel& model, const GeneratorOptions& options) : HandToHand(model, options) {
    const JointFrames frames = posture();
    const auto tip = [&](Finger finger) { return frames[slot_of(tip_of(finger))].position; };
    const double pitch = std::abs(tip(Finger::index).x() - tip(Finger::little).x()) / 3;
    meeting_.orientation = Quaternion(Eigen::AngleAxisd(side() * M_PI / 2, Vector3::UnitY()));
    const Vector3 centre = 0.5 * (tip(Finger::middle) + tip(Finger::ring));
    const Vector3 meets(centre.x(), centre.y(), tip(Finger::middle).z());
    meeting_.position = to_vector(options.object_position) - meeting_.orientation * meets;
    meeting_.position.z() -= side() * pitch / 4;
    add_phase("approach", options.approach_time);
    add_phase("close", options.close_time);
    add_phase("hold", options.hold_time);
    add_phase("open", options.release_time);
    add_phase("retreat", options.retreat_time);
  }

 private:
  double distance_at(double time) const override {
    const auto done = [&](std::size_t phase) {
      const MotionPhase& p = phases_[phase];
      return p.end > p.begin ? minimum_jerk((time - p.begin) / (p.end - p.begin)) : (time >= p.end ? 1.0 : 0.0);
    };
    const double inside = done(1) - done(3);
    return options_.approach_distance * (1 - done(0) + done(4)) + kClear * (1 - inside) -
           options_.closing_depth * inside;
  }
  // m; before they interlace and afterwards, the tips are this far from the middle.
  static constexpr double kClear = 0.005;
};

}  // namespace

std::unique_ptr<Motion> make_hand_to_hand(const HandModel& hand, const GeneratorOptions& options) {
  if (options.motion == "clap") return std::make_unique<Clap>(hand, options);
  return std::make_unique<Interlace>(hand, options);
}

}  // namespace softhand
