// What a hand's tissue bears in the postures between which people's hands move: flat, relaxed, fist.
#pragma once

#include <string>
#include <vector>

#include "model/hand_model.hpp"

namespace softhand::human {

/// Flexion from the straight finger, degrees: a finger's MCP, PIP and DIP, the thumb's MCP and IP.
struct Posture {
  const char* name;
  double mcp, pip, dip, thumb_mcp, thumb_ip;
};
/// The fist is that of the recorded Quest 3 hand.
inline constexpr Posture kPostures[] = {
    {"flat", 0, 0, 0, 0, 0}, {"relaxed", 40, 35, 15, 10, 10}, {"fist", 82, 100, 60, 40, 50}};

/// The hand in a posture that it reached from rest within a second, and held for another with a tremor of half a
/// degree.
struct PostureResult {
  std::string posture;
  // Largest principal strain: of the skin in its plane, by its area, and of tetrahedra in any direction (tension or
  // compression), by their volume.
  double skin_max = 0, skin_p95 = 0, tissue_max = 0, tissue_p95 = 0;  ///< 1
  double beyond_limit = 0;                                            ///< share of tetrahedra above their W_max
  int inverted_most = 0;      ///< most tetrahedra inside out at the end of any step
  double iterations_p50 = 0;  ///< Newton iterations of a step while the posture is held
  int iterations_most = 0;
  double missed = 0;  ///< rad, largest angle between a bone and its target at the end
};
std::vector<PostureResult> hold_postures(const HandModel& hand);

}  // namespace softhand::human
