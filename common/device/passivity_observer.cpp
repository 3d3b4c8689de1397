#include "device/passivity_observer.hpp"

#include <cmath>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {

void PassivityObserver::add(const BoneWrench& wrench) {
  if (any_ && last_.simulated_valid != 0 && share_ > 0) {
    double given = 0;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const BoneSample& from = last_.bones[b];
      const BoneSample& to = wrench.bones[b];
      const Pose before = to_pose(from.tracked_position, from.tracked_orientation);
      const Pose now = to_pose(to.tracked_position, to.tracked_orientation);
      const Vector3 moved = now.position - before.position;
      if (!(moved.norm() <= kTeleport)) continue;
      const double work =
          to_vector(from.coupling_force).dot(moved) +
          to_vector(from.coupling_torque).dot(rotation_log(now.orientation * before.orientation.conjugate()));
      // NaN or an orientation of zeros in one message: without this check, NaN would stay in the sum for ever.
      if (std::isfinite(work)) given += work;
    }
    energy_ -= share_ * given;
  }
  last_ = wrench;
  any_ = true;
}

}  // namespace softhand
