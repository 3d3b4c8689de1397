// Section [tracker_landmarks] of a scene.
#pragma once

#include <array>

#include "web/listening.hpp"

namespace softhand {

struct LandmarksOptions {
  web::Listening listening{.port = 8092};
  std::array<double, 3> camera_position{0, 0.15, -0.5};
  std::array<double, 4> camera_orientation{0, 1, 0, 0};
  double field_of_view = 1.05;
  double distance = 0.5;
  bool mirrored = false;
  double least_score = 0.5;
};

inline void describe(OptionVisitor& v, LandmarksOptions& o) {
  describe(v, o.listening);
  v.numbers("camera_position", o.camera_position.data(), 3, "m", {-1000, 1000}, "Position of the camera in the world.");
  v.numbers(
      "camera_orientation", o.camera_orientation.data(), 4, "1", {-1, 1},
      "Orientation of the camera, xyzw. It looks along its -Z with +Y up. The default looks along the world's +Z, "
      "towards the user.");
  v.number("field_of_view", o.field_of_view, "rad", {0.1, 3},
           "Horizontal field of view of the whole picture. Together with the size of the palm it gives the distance "
           "of the hand.");
  v.number("distance", o.distance, "m", {0.05, 10},
           "World landmarks do not contain the place of the hand. Their origin is put at this distance in front of "
           "the camera.");
  v.flag("mirrored", o.mirrored, "The picture is mirrored left to right, as in video calls.");
  v.number("least_score", o.least_score, "1", {0, 1},
           "A message with a lower score counts as a hand that is not seen.");
}

}  // namespace softhand
