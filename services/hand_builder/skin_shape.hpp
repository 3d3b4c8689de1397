// The skin as an implicit surface.
#pragma once

#include <vector>

#include "hand_builder/anatomy.hpp"

namespace softhand::builder {

/// A closed surface as the zero set of a function that is negative inside. |gradient| is about 1 at most (1.3 is
/// tested).
class SkinShape {
 public:
  virtual ~SkinShape() = default;
  /// Metres, negative inside. Near the surface this is the distance to it.
  virtual double distance(const Vector3& point) const = 0;
  /// A box that contains the surface: low and high corner.
  virtual std::array<Vector3, 2> bounds() const = 0;

  /// Unit outward normal of the level set through `point`.
  Vector3 normal(const Vector3& point) const;
  /// The point moved along the gradient onto the level set `distance == level`.
  Vector3 project(Vector3 point, double level = 0) const;
};

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
  using Digit = std::vector<Cone>;  // proximal to distal
  std::vector<Cone> palm_;
  std::vector<Cone> forearm_;
  std::array<Digit, kFingerCount> digits_;
  double palm_blend_ = 0, chain_blend_ = 0, web_blend_ = 0, root_blend_ = 0;  // metres
  double stump_ = 0;                                                          // m, z of the cut through the forearm
  Vector3 low_, high_;
};

}  // namespace softhand::builder
