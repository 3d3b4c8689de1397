// Strain of a hand's tissue in the postures between which human hands move: flat, relaxed, fist.
#pragma once

#include <string>
#include <vector>

#include "model/hand_model.hpp"

namespace softhand::human {

/// Flexion from the straight finger, degrees: MCP, PIP and DIP of a finger, MCP and IP of the thumb.
struct Posture {
  const char* name;
  double mcp, pip, dip, thumb_mcp, thumb_ip;
};
/// The fist has the angles of the recorded Quest 3 hand.
inline constexpr Posture kPostures[] = {
    {"flat", 0, 0, 0, 0, 0}, {"relaxed", 40, 35, 15, 10, 10}, {"fist", 82, 100, 60, 40, 50}};

/// Result of one posture. The hand reaches the posture from rest within a second. It holds the posture for another
/// second with a tremor of half a degree.
struct PostureResult {
  std::string posture;
  // Largest principal strain. The skin's strain is in its plane, weighted by area. The strain of tetrahedra is in any
  // direction (tension or compression), weighted by volume.
  double skin_max = 0, skin_p95 = 0, tissue_max = 0, tissue_p95 = 0;  ///< 1
  double beyond_limit = 0;                                            ///< share of tetrahedra above their W_max
  int inverted_most = 0;      ///< most inverted tetrahedra at the end of any step
  double iterations_p50 = 0;  ///< Newton iterations per step while the posture is held
  int iterations_most = 0;
  double missed = 0;  ///< largest angle between a bone and its target at the end, rad
};
std::vector<PostureResult> hold_postures(const HandModel& hand);

}  // namespace softhand::human
