// The skin of a hand as a function of its bones.
#pragma once

#include <array>
#include <vector>

#include "hand_builder/anatomy.hpp"
#include "hand_builder/skin_shape.hpp"

namespace softhand::builder {

/// Smooth union of rounded cones along the bones, palm, thenar and hypothenar masses, webs and a short forearm stump.
class ParametricSkin : public SkinShape {
 public:
  explicit ParametricSkin(const RestSkeleton& rest);
  double distance(const Vector3& point) const override;
  std::array<Vector3, 2> bounds() const override { return {low_, high_}; }

 private:
  struct Cone {
    Vector3 a, b;
    double radius_a, radius_b;
  };
  struct Digit {
    std::vector<Cone> phalanges;  // proximal to distal
    Cone cushion;                 // of the pulp, under the distal bone
    // The pad is flat: a large sphere cuts distal phalanx and cushion.
    Vector3 pad_centre;
    double pad_radius = 0;
  };
  std::vector<Cone> palm_;
  std::vector<Cone> forearm_;
  std::array<Digit, kFingerCount> digits_;
  double palm_blend_ = 0, chain_blend_ = 0, web_blend_ = 0, root_blend_ = 0;  // metres
  double stump_ = 0;                                                          // m, z of the cut through the forearm
  Vector3 low_, high_;
};

}  // namespace softhand::builder
