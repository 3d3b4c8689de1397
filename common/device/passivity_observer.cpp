#include "device/passivity_observer.hpp"

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {

void PassivityObserver::add(const BoneWrench& wrench) {
  if (any_ && last_.simulated_valid != 0 && share_ > 0) {
    double given = 0;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const BoneSample& from = last_.bones[b];
      const BoneSample& to = wrench.bones[b];
      if (!all_finite(to.tracked_position) || !all_finite(to.tracked_orientation) || !all_finite(from.coupling_force) || !all_finite(from.coupling_torque)) continue;
      const Pose before = to_pose(from.tracked_position, from.tracked_orientation);
      const Pose now = to_pose(to.tracked_position, to.tracked_orientation);
      const Vector3 moved = now.position - before.position;
      if (!(moved.norm() <= kTeleport)) continue;
      given += to_vector(from.coupling_force).dot(moved) + to_vector(from.coupling_torque).dot(rotation_log(now.orientation * before.orientation.conjugate()));
    }
    energy_ -= share_ * given;
  }
  last_ = wrench;
  any_ = true;
}

}  // namespace softhand
