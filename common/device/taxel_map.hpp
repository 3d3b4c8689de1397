// The taxels of a tactile device: the places on the skin of a hand on which it acts. A map turns the traction of the
// simulated skin into what each taxel feels.
//
// A region of the skin goes to the taxels of the same part of the hand (a digit, or the palm with the metacarpals) that
// reach it. They share it by their distances. So the forces on the taxels sum to the forces on the regions that any
// taxel reaches. Distances count from bone to bone in the rest pose of the hand.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "messages/messages.hpp"
#include "model/hand_model.hpp"

namespace softhand {

/// Vectors are in the frame of the bone's joint.
struct Taxel {
  Body body = Body::carpus;
  Vector3 place = Vector3::Zero();      ///< on the skin, m
  Vector3 normal = -Vector3::UnitY();   ///< unit, outward of the skin
  Vector3 tangent = -Vector3::UnitZ();  ///< unit, across the normal; the second axis is normal x tangent
  double reach = 0;                     ///< m, > 0: it takes skin that is less far from its place
};

// Layouts. Places are on the round surface around a bone, with the radii of the hand's joints. The first axis points to
// the fingertips, the second one along +X of the joint.

/// One taxel for all of each digit, thumb first, and then one for the palm with the metacarpals: the first `count`.
std::vector<Taxel> digit_taxels(const HandModel& hand, std::size_t count);
/// `rows` along the finger from proximal, `columns` around it, row by row. The middle is that of the finger's pad.
/// `pitch`: m.
std::vector<Taxel> fingertip_grid(const HandModel& hand, Finger finger, int rows, int columns, double pitch);
/// `count` taxels around the middle of the distal phalanx. The first one is on the pad, the next ones towards +X.
std::vector<Taxel> fingertip_ring(const HandModel& hand, Finger finger, int count);
/// `rows` from the wrist to the fingers, `columns` towards +X, row by row. The middle is below the palm joint. `pitch`:
/// m.
std::vector<Taxel> palm_grid(const HandModel& hand, int rows, int columns, double pitch);

/// What a taxel feels.
struct TaxelTouch {
  /// On the skin, N: shear along the two axes, then the part along the normal, which is negative if the skin is
  /// pressed.
  std::array<double, 3> force{};
  /// Sum of the normal forces, N. Skin that is squeezed from two sides is pressed, although their sum is no force.
  double press = 0;
  std::array<double, 2> slip{};  ///< m/s of the skin over the object, along the two axes, mean by pressure
  double area = 0;               ///< m^2 of skin that touches
  double area_rate = 0;          ///< m^2/s; positive: the contact grows
  std::uint32_t object = 0;      ///< id of the object that presses most; 0: none, or the hand's own skin

  double pressure() const { return area > 0 ? press / area : 0; }     ///< Pa
  double slip_speed() const { return std::hypot(slip[0], slip[1]); }  ///< m/s
};

class TaxelMap {
 public:
  /// Throws std::invalid_argument for a taxel with a reach that is not > 0, or with axes that are not orthonormal.
  TaxelMap(const HandModel& hand, const std::vector<Taxel>& taxels);

  /// By taxel. Valid until the next call. Real-time.
  std::span<const TaxelTouch> feel(const SkinTraction& input);
  /// Number of regions since construction that had a bone or a number that cannot be used. They are left out.
  std::uint64_t refused() const { return refused_; }

 private:
  struct Place {
    int part = 0;
    Vector3 place = Vector3::Zero();  // in the rest frame
    Matrix3 axes;                     // rows: tangent, normal x tangent, normal, in the rest frame
    double reach = 0;
  };
  struct Sum {
    Vector3 force = Vector3::Zero(), slip = Vector3::Zero();
    double press = 0, area = 0, area_rate = 0;
    double largest = 0;  // press by `object`, N
    std::uint32_t object = 0;
  };
  bool add(const SkinRegion& region);

  std::array<Pose, kBodyCount> rest_;  // of the joint of each bone
  std::vector<Place> places_;
  std::vector<double> shares_;
  std::vector<Sum> sums_;
  std::vector<TaxelTouch> touches_;
  std::uint64_t refused_ = 0;
};

}  // namespace softhand
