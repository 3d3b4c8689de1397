// Recorded hands: CSV with a column `t_s` and, for each WebXR joint, `<joint>.px py pz qx qy qz qw r` (metres, xyzw).
#pragma once

#include <iosfwd>
#include <string_view>

#include "trackers/replay/motion.hpp"

namespace softhand {

/// The joint's name in WebXR ("pinky-finger-phalanx-distal"); empty for the palm, which WebXR lacks.
std::string_view webxr_name(Joint joint);

class Recording : public Motion {
 public:
  /// Throws std::runtime_error with file, line, column and the expected value. The columns may be in any order. Times
  /// must ascend.
  static Recording load(const std::string& path);
  static Recording parse(std::istream& in, const std::string& name);

  double duration() const override { return times_.back(); }
  JointFrames at(double time) const override;
  std::span<const double> times() const override { return times_; }
  const std::array<double, kJointCount>& radii() const override { return radii_; }
  bool palm_inferred() const override { return true; }
  /// Every recorded frame, for `measure_skeleton`.
  std::span<const JointFrames> frames() const { return frames_; }
  /// Time of the first sample in the file. It is time 0 here.
  double start() const { return start_; }

 private:
  std::vector<double> times_;
  std::vector<JointFrames> frames_;
  std::array<double, kJointCount> radii_{};  // mean over the frames
  double start_ = 0;
};

}  // namespace softhand
