// A grounded haptic device with three motors. They move one point, its cursor. The options say which bone of the hand
// the cursor holds, where the device stands in the world, and how hard it may push.
//
// The frame of the device has x to the right, y up and z to the user. Drivers convert the axes of their device.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "device/curl_lifter.hpp"
#include "device/device_loop.hpp"

namespace softhand {

struct GroundedPointOptions {
  std::string holds = "index_distal";
  std::array<double, 3> base_position{0, 0, 0};
  std::array<double, 4> base_orientation{0, 0, 0, 1};
  double scale = 1;
  double maximum_force = 3;
  double slew = 500;
  double stiffness = 400;
  double damping = 3;
};
void describe(OptionVisitor& v, GroundedPointOptions& o);

class GroundedPoint {
 public:
  /// Throws std::invalid_argument if base_orientation is zero.
  GroundedPoint(const GroundedPointOptions& options, const HandModel& hand);

  DeviceLimits limits() const;
  /// The force on the held bone, or on all bones of the hand, in the frame of the device, N. With a scale the force is
  /// multiplied too: then the device does the work that the simulated hand does. Linear in the coupling forces.
  void command(const BoneWrench& input, std::span<double> requested) const;
  /// The open hand whose held bone is at the cursor, in the world. `cursor` is in the frame of the device, m. Only the
  /// held joint is tracked, the others are inferred. Fills joints, flags, radii, side, frame and confidence. Does not
  /// allocate.
  void lift(const Vector3& cursor, Skeleton& out) const;

 private:
  GroundedPointOptions options_;
  std::optional<Body> bone_;  // none: the whole hand
  Joint held_;
  Quaternion orientation_;  // of the device in the world
  CurlLifter lifter_;
};

}  // namespace softhand
