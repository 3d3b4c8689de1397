#include "trackers/replay/recording.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string_view>

namespace softhand {
namespace {

constexpr std::size_t kValuesPerJoint = 8;
constexpr std::array<std::string_view, kValuesPerJoint> kSuffixes{"px", "py", "pz", "qx", "qy", "qz", "qw", "r"};
// WebXR's names in OpenXR's order, without the palm.
constexpr std::array<std::string_view, kJointCount - 1> kWebXrNames{"wrist",
                                                                    "thumb-metacarpal",
                                                                    "thumb-phalanx-proximal",
                                                                    "thumb-phalanx-distal",
                                                                    "thumb-tip",
                                                                    "index-finger-metacarpal",
                                                                    "index-finger-phalanx-proximal",
                                                                    "index-finger-phalanx-intermediate",
                                                                    "index-finger-phalanx-distal",
                                                                    "index-finger-tip",
                                                                    "middle-finger-metacarpal",
                                                                    "middle-finger-phalanx-proximal",
                                                                    "middle-finger-phalanx-intermediate",
                                                                    "middle-finger-phalanx-distal",
                                                                    "middle-finger-tip",
                                                                    "ring-finger-metacarpal",
                                                                    "ring-finger-phalanx-proximal",
                                                                    "ring-finger-phalanx-intermediate",
                                                                    "ring-finger-phalanx-distal",
                                                                    "ring-finger-tip",
                                                                    "pinky-finger-metacarpal",
                                                                    "pinky-finger-phalanx-proximal",
                                                                    "pinky-finger-phalanx-intermediate",
                                                                    "pinky-finger-phalanx-distal",
                                                                    "pinky-finger-tip"};
constexpr std::size_t kColumns = 1 + kValuesPerJoint * kWebXrNames.size();

std::string column_name(std::size_t column) {
  if (column == 0) return "t_s";
  return std::string(kWebXrNames[(column - 1) / kValuesPerJoint]) + "." +
         std::string(kSuffixes[(column - 1) % kValuesPerJoint]);
}

std::vector<std::string_view> split(std::string_view line) {
  while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.remove_suffix(1);
  std::vector<std::string_view> cells;
  for (;;) {
    const std::size_t comma = line.find(',');
    cells.push_back(line.substr(0, comma));
    if (comma == std::string_view::npos) return cells;
    line.remove_prefix(comma + 1);
  }
}

Pose between(const Pose& a, const Pose& b, double fraction) {
  return {a.position + fraction * (b.position - a.position), a.orientation.slerp(fraction, b.orientation)};
}

}  // namespace

std::string_view webxr_name(Joint joint) {
  return joint == Joint::palm ? std::string_view{} : kWebXrNames[static_cast<std::size_t>(index_of(joint)) - 1];
}

Recording Recording::load(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error(path + ": cannot be read");
  return parse(in, path);
}

Recording Recording::parse(std::istream& in, const std::string& name) {
  const auto fail = [&name](std::size_t line, const std::string& column, const std::string& text) {
    throw std::runtime_error(name + ":" + std::to_string(line) + ": column '" + column + "': " + text);
  };
  std::string line;
  if (!std::getline(in, line))
    throw std::runtime_error(name + ":1: expected a header that starts with t_s, got an empty file");
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  // spreadsheets save UTF-8 with it
  if (line.starts_with(kByteOrderMark)) line.erase(0, kByteOrderMark.size());
  std::vector<std::size_t> place(kColumns, kColumns);  // index of each known column in a row
  const std::vector<std::string_view> header = split(line);
  for (std::size_t cell = 0; cell < header.size(); ++cell) {
    std::size_t column = 0;
    while (column < kColumns && column_name(column) != header[cell]) ++column;
    if (column == kColumns)
      fail(1, std::string(header[cell]), "expected t_s or a WebXR joint with .px .py .pz .qx .qy .qz .qw .r");
    if (place[column] != kColumns) fail(1, std::string(header[cell]), "expected once, found twice");
    place[column] = cell;
  }
  for (std::size_t column = 0; column < kColumns; ++column) {
    if (place[column] == kColumns) fail(1, column_name(column), "expected, is missing");
  }

  Recording out;
  std::array<double, kColumns> values{};
  for (std::size_t number = 2; std::getline(in, line); ++number) {
    const std::vector<std::string_view> cells = split(line);
    if (cells.size() == 1 && cells[0].empty()) continue;
    if (cells.size() != header.size()) {
      throw std::runtime_error(name + ":" + std::to_string(number) + ": expected " + std::to_string(header.size()) +
                               " columns, got " + std::to_string(cells.size()));
    }
    for (std::size_t column = 0; column < kColumns; ++column) {
      const std::string_view cell = cells[place[column]];
      const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), values[column]);
      if (error != std::errc{} || end != cell.data() + cell.size() || !std::isfinite(values[column])) {
        fail(number, column_name(column), "expected a finite number, got '" + std::string(cell) + "'");
      }
    }
    if (out.times_.empty()) out.start_ = values[0];
    const double time = values[0] - out.start_;
    if (!out.times_.empty() && time <= out.times_.back())
      fail(number, "t_s", "expected a time after the previous row, got " + std::to_string(values[0]));
    JointFrames frame;
    for (std::size_t j = 0; j < kWebXrNames.size(); ++j) {
      const double* v = values.data() + 1 + kValuesPerJoint * j;
      const Quaternion orientation(v[6], v[3], v[4], v[5]);
      if (std::abs(orientation.norm() - 1) > 0.01) {
        fail(number, column_name(1 + kValuesPerJoint * j + 3),
             "expected a unit quaternion, got one of length " + std::to_string(orientation.norm()));
      }
      if (!(v[7] >= 0 && v[7] < 0.1))
        fail(number, column_name(1 + kValuesPerJoint * j + 7),
             "expected a radius in [0, 0.1] m, got " + std::to_string(v[7]));
      frame[j + 1] = {Vector3(v[0], v[1], v[2]), orientation.normalized()};
      out.radii_[j + 1] += v[7];
    }
    frame[0] = palm_between(frame[static_cast<std::size_t>(index_of(Joint::middle_metacarpal))],
                            frame[static_cast<std::size_t>(index_of(Joint::middle_proximal))]);
    out.times_.push_back(time);
    out.frames_.push_back(frame);
  }
  if (out.frames_.empty()) throw std::runtime_error(name + ": expected at least one row of joints");
  for (double& radius : out.radii_) radius /= static_cast<double>(out.frames_.size());
  out.radii_[0] = out.radii_[static_cast<std::size_t>(index_of(Joint::middle_metacarpal))];
  return out;
}

JointFrames Recording::at(double time) const {
  const double t = std::clamp(time, 0.0, times_.back());
  const auto after = static_cast<std::size_t>(std::upper_bound(times_.begin(), times_.end(), t) - times_.begin());
  if (after == times_.size()) return frames_.back();
  const double fraction = (t - times_[after - 1]) / (times_[after] - times_[after - 1]);
  if (fraction == 0) return frames_[after - 1];  // exactly as recorded
  JointFrames out;
  for (std::size_t j = 0; j < kJointCount; ++j) out[j] = between(frames_[after - 1][j], frames_[after][j], fraction);
  return out;
}

}  // namespace softhand
