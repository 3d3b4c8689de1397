// Hands in motion that tests send through a tracker's protocol, generated and recorded, and how well they arrive.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iomanip>
#include <sstream>
#include <string>
#include <vector>

#include "model/hand_model.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/replay/recording.hpp"

namespace softhand::testing {

/// A recorded Quest 3 hand. It is not part of this project, so tests that need it are skipped without it.
inline std::string recorded_hand_path() { return SOFTHAND_SOURCE_DIR "/../shared/data/quest3/right.csv"; }

/// Frames of a right hand, and a hand of its bone lengths.
struct MovingHand {
  HandModel hand;
  std::vector<JointFrames> frames;
};

/// A fist that opens and closes, and then every joint in motion. The joints bend as the hand's own do.
inline MovingHand generated_hand(const HandModel& hand) {
  MovingHand moving{hand, {}};
  for (const char* name : {"fist", "free_motion"}) {
    GeneratorOptions options;
    options.motion = name;
    const auto motion = make_motion(hand, options);
    for (double time = 0; time < motion->duration(); time += 0.05) moving.frames.push_back(motion->at(time));
  }
  return moving;
}

/// The recorded hand. It bends and twists in ways that the joints of `hand` cannot.
inline MovingHand recorded_hand(const HandModel& hand) {
  const Recording recording = Recording::load(recorded_hand_path());
  return {fitted(hand, measure_skeleton(recording.frames(), recording.radii())),
          {recording.frames().begin(), recording.frames().end()}};
}

/// The columns of a recording, by the names of WebXR.
inline std::string recording_header() {
  std::string header = "t_s";
  const auto add = [&header](const std::string& joint) {
    for (const char* suffix : {"px", "py", "pz", "qx", "qy", "qz", "qw", "r"}) header += "," + joint + "." + suffix;
  };
  for (const char* joint : {"wrist", "thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip"})
    add(joint);
  for (const char* finger : {"index-finger", "middle-finger", "ring-finger", "pinky-finger"}) {
    for (const char* part : {"metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"})
      add(std::string(finger) + "-" + part);
  }
  return header + "\n";
}

/// A recording of `motion` at `times` (s), with every digit. It begins at 20 s.
inline std::string recording_text(const Motion& motion, const std::vector<double>& times) {
  std::ostringstream text;
  text << recording_header() << std::setprecision(17);
  for (const double time : times) {
    text << 20 + time;
    const JointFrames frames = motion.at(time);
    for (std::size_t j = 1; j < kJointCount; ++j) {
      for (const double x : frames[j].position) text << "," << x;
      for (const double x : frames[j].orientation.coeffs()) text << "," << x;
      text << ",0.01";
    }
    text << "\n";
  }
  return text.str();
}

/// Distances, mm, and turns, degrees, between joints that arrived and the joints that were sent. The palm is left out,
/// because most protocols have none.
class Deviations {
 public:
  void add(std::size_t joint, const Pose& arrived, const Pose& sent) {
    if (joint == 0) return;
    distances_.push_back(1e3 * (arrived.position - sent.position).norm());
    turns_.push_back(arrived.orientation.angularDistance(sent.orientation) * 180 / M_PI);
  }
  std::size_t count() const { return distances_.size(); }
  double distance(double quantile) { return at(distances_, quantile); }
  double turn(double quantile) { return at(turns_, quantile); }
  void print(const char* what) {
    std::printf("%s: median %.2f mm, 99 %% below %.2f mm, worst %.2f mm; ", what, distance(0.5), distance(0.99),
                distance(1));
    std::printf("median %.1f, 99 %% below %.1f, worst %.1f degrees\n", turn(0.5), turn(0.99), turn(1));
  }

 private:
  static double at(std::vector<double>& values, double quantile) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(quantile * static_cast<double>(values.size() - 1))];
  }
  std::vector<double> distances_, turns_;
};

}  // namespace softhand::testing
