// Traction on the skin of one finger, for tests of tactile devices.
#pragma once

#include "messages/messages.hpp"

namespace softhand::testing {

inline Body bone_of(Finger finger) { return finger == Finger::palm ? Body::carpus : distal_of(finger); }

/// Presses the middle of the finger's pad, or the palm, with `newton`. `slip`: m/s of the skin towards the fingertip,
/// against a friction of half the pressure. Replaces what pressed there before.
inline void press(SkinTraction& traction, Finger finger, double newton, double slip = 0) {
  constexpr float area = 1e-5f;
  const auto bone = static_cast<std::uint32_t>(index_of(bone_of(finger)));
  SkinTraction others;
  for (const SkinRegion& region : traction.regions)
    if (region.body != bone) others.regions.push_back(region);
  traction.regions = others.regions;
  if (newton == 0) return;
  SkinRegion region;
  region.region = bone;
  region.body = bone;
  region.object = 7;
  region.place = {0, -0.008f, -0.009f};
  region.normal = {0, -1, 0};
  region.area = area;
  region.pressure = static_cast<float>(newton) / area;
  if (slip > 0) region.shear = {0, 0, 0.5f * region.pressure};
  region.slip_velocity = {0, 0, static_cast<float>(-slip)};
  traction.regions.push_back(region);
}

}  // namespace softhand::testing
