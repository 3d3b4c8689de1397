// What the readers and writers of JSON files share: rounding of numbers, and a reader that names the bad field.
// Internal to this folder.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "math/types.hpp"
#include "model/joint_law.hpp"

namespace softhand {

using Json = nlohmann::ordered_json;

inline constexpr const char* kUnits = "m kg s N rad";

inline double to_grid(double value, double step) { return std::round(value / step) * step; }

// The nearest double to a short decimal. It is converted through text, because value/step*step gives
// 0.30000000000000004.
inline double short_decimal(double value, const char* format) {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  const double rounded = std::strtod(text, nullptr);
  return rounded == 0 ? 0.0 : rounded;
}
inline double metres(double value) { return short_decimal(to_grid(value, 1e-7), "%.7f"); }
inline double quantity(double value) { return short_decimal(value, "%.8g"); }
inline double fraction(double value) { return short_decimal(value, "%.6f"); }

template <typename Round>
Json vector_json(const Vector3& v, Round round) {
  return Json::array({round(v.x()), round(v.y()), round(v.z())});
}
inline Json quaternion_json(const Quaternion& q) {
  const double sign = q.w() < 0 ? -1.0 : 1.0;
  return Json::array({quantity(sign * q.x()), quantity(sign * q.y()), quantity(sign * q.z()), quantity(sign * q.w())});
}

// Reads one field after another. Error messages name the bad field.
class FieldReader {
 public:
  FieldReader(const Json& json, std::string file, std::string path)
      : json_(json), file_(std::move(file)), path_(std::move(path)) {}

  [[noreturn]] void fail(const std::string& expected) const {
    throw std::runtime_error(file_ + ": " + path_ + ": expected " + expected);
  }

  FieldReader operator[](const char* key) const {
    if (!json_.is_object()) fail("an object with the field '" + std::string(key) + "'");
    const auto found = json_.find(key);
    const std::string inner = path_.empty() ? key : path_ + "." + key;
    if (found == json_.end()) throw std::runtime_error(file_ + ": " + inner + ": missing");
    return {*found, file_, inner};
  }
  bool has(const char* key) const { return json_.is_object() && json_.contains(key); }
  FieldReader at(std::size_t i) const { return {json_[i], file_, path_ + "[" + std::to_string(i) + "]"}; }
  std::size_t size() const {
    if (!json_.is_array()) fail("an array");
    return json_.size();
  }
  void expect_keys(std::initializer_list<const char*> keys) const {
    if (!json_.is_object()) fail("an object");
    for (auto item = json_.begin(); item != json_.end(); ++item) {
      const std::string& key = item.key();
      if (std::none_of(keys.begin(), keys.end(), [&key](const char* known) { return key == known; })) {
        throw std::runtime_error(file_ + ": " + (path_.empty() ? key : path_ + "." + key) + ": unknown field");
      }
    }
  }
  double number() const {
    if (!json_.is_number()) fail("a number");
    return json_.get<double>();
  }
  std::int32_t index() const {
    if (!json_.is_number_integer()) fail("an integer");
    const auto value = json_.get<std::int64_t>();
    if (value < 0 || value > std::numeric_limits<std::int32_t>::max()) fail("an index >= 0");
    return static_cast<std::int32_t>(value);
  }
  std::string string() const {
    if (!json_.is_string()) fail("a string");
    return json_.get<std::string>();
  }
  Vector3 vector() const {
    if (size() != 3) fail("3 numbers");
    return {at(0).number(), at(1).number(), at(2).number()};
  }
  Quaternion quaternion() const {
    if (size() != 4) fail("a quaternion x y z w");
    const Quaternion q(at(3).number(), at(0).number(), at(1).number(), at(2).number());
    if (!(std::abs(q.norm() - 1.0) < 1e-3)) fail("a unit quaternion x y z w");
    return q.normalized();
  }
  std::array<double, 2> range() const {
    if (size() != 2) fail("a minimum and a maximum");
    return {at(0).number(), at(1).number()};
  }
  /// Number of records in a flat array with `width` items per record.
  std::size_t records(std::size_t width) const {
    const std::size_t items = size();
    if (items % width != 0) fail("a multiple of " + std::to_string(width) + " items, found " + std::to_string(items));
    return items / width;
  }

 private:
  const Json& json_;
  std::string file_;
  std::string path_;
};

/// Reads the fields of a joint's law: kind, pitch, minimum, maximum, friction, load_friction, damping, stiffness, rest,
/// detents. The caller checks the names of the fields, and the law with `check_joint_law`. (object_file.cpp)
JointLaw read_joint_law(const FieldReader& reader);

}  // namespace softhand
