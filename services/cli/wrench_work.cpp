#include "cli/wrench_work.hpp"

#include <cmath>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {

void WrenchWork::add(const BoneWrench& wrench, const BonePoses& poses) {
  if (any_ && last_.simulated_valid != 0) {
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Vector3 moved = poses[b].position - poses_[b].position;
      if (!(moved.norm() <= kJump)) continue;
      const Vector3 turned = rotation_log(poses[b].orientation * poses_[b].orientation.conjugate());
      const double work =
          to_vector(last_.bones[b].coupling_force).dot(moved) + to_vector(last_.bones[b].coupling_torque).dot(turned);
      if (std::isfinite(work)) joules_ += work;
    }
  }
  last_ = wrench;
  poses_ = poses;
  any_ = true;
}

}  // namespace softhand
