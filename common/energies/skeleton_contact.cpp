#include "energies/skeleton_contact.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr double kStiffness = 2e5;   // N/m, of each place
constexpr double kClearance = 1e-3;  // m
constexpr double kSpacing = 3e-3;    // m, of the places
constexpr std::size_t kMostBones = std::size_t{2} * kBodyCount;

}  // namespace

std::vector<BoneCapsule> bone_capsules(const HandModel& hand, int first_body) {
  std::vector<BoneCapsule> bones;
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    if (finger_of(body) == Finger::palm) continue;
    const BodyModel& model = hand.bodies[static_cast<std::size_t>(b)];
    const Pose body_from_joint = model.joint_from_body.inverse();
    bones.push_back({finger_of(body), is_metacarpal(body), first_body + b, body_from_joint * model.bone_start,
                     body_from_joint * model.bone_end, std::min(model.bone_start_radius, model.bone_end_radius)});
  }
  return bones;
}

// A place along the axis of bone a that is too near to the axis of bone b.
struct SkeletonContact::Touch {
  const Bone &a, &b;
  Vector3 arm_a, arm_b;  // from the centres of the bodies to the place
  Vector3 normal;        // from the axis of b to the place
  Matrix3 bend;          // second derivative of the distance by the place, 1/m
  double gap;            // g < 0
};

SkeletonContact::SkeletonContact(const std::vector<std::vector<BoneCapsule>>& hands, bool within_hands,
                                 DofLayout layout) {
  std::vector<std::size_t> starts;  // of the hands
  for (const auto& hand : hands) {
    starts.push_back(bones_.size());
    for (const BoneCapsule& bone : hand) {
      const int places = 1 + static_cast<int>(std::ceil((bone.end - bone.begin).norm() / kSpacing));
      bones_.push_back({bone,
                        (bone.end - bone.begin).norm(),
                        places,
                        layout.body_translation_block(bone.body),
                        layout.body_rotation_block(bone.body),
                        {},
                        {},
                        {}});
    }
  }
  if (bones_.size() > kMostBones)
    throw std::invalid_argument(std::to_string(bones_.size()) + " bones, expected at most " +
                                std::to_string(kMostBones));
  const auto hand_of = [&](std::size_t bone) { return std::ranges::upper_bound(starts, bone) - starts.begin(); };
  const auto add_pairs = [&](auto&& touch) {
    for (std::size_t a = 0; a < bones_.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b)
        if (touch(a, b)) pairs_.push_back({a, b});
    }
  };
  if (within_hands) {
    add_pairs([&](std::size_t a, std::size_t b) {
      const BoneCapsule &one = bones_[a].capsule, &other = bones_[b].capsule;
      return hand_of(a) == hand_of(b) && one.finger != other.finger && !(one.is_metacarpal && other.is_metacarpal);
    });
  }
  pairs_within_hands_ = pairs_.size();
  add_pairs([&](std::size_t a, std::size_t b) { return hand_of(a) != hand_of(b); });
}

void SkeletonContact::add_pattern(BlockPattern& pattern) const {
  for (const Bone& bone : bones_) pattern.add(bone.rotation, bone.translation);
  pattern.add_loose(4 * static_cast<int>(pairs_.size()));
}

void SkeletonContact::bind(const BlockMatrix& matrix) {
  for (Bone& bone : bones_) {
    bone.on_translation = matrix.find(bone.translation, bone.translation);
    bone.between_both = matrix.find(bone.rotation, bone.translation);
    bone.on_rotation = matrix.find(bone.rotation, bone.rotation);
  }
}

template <typename Found>
void SkeletonContact::for_each_touch(const State& state, Found&& found) const {
  struct Placed {
    Vector3 begin, end;
  };
  std::array<Placed, kMostBones> placed;
  for (std::size_t i = 0; i < bones_.size(); ++i)
    placed[i] = {bones_[i].capsule.begin_in(state), bones_[i].capsule.end_in(state)};
  const auto from = [&](std::size_t first, std::size_t second, double reach) {
    const Bone &a = bones_[first], &b = bones_[second];
    const auto centre = [&](const Bone& bone) {
      return state.body_poses[static_cast<std::size_t>(bone.capsule.body)].position;
    };
    const Vector3& begin = placed[second].begin;
    const Vector3 axis = b.length > 0 ? Vector3((placed[second].end - begin) / b.length) : Vector3::UnitZ();
    for (int i = 0; i < a.places; ++i) {
      const double share = a.places > 1 ? static_cast<double>(i) / (a.places - 1) : 0.0;
      const Vector3 place = (1 - share) * placed[first].begin + share * placed[first].end;
      const double height = axis.dot(place - begin);
      const Vector3 offset = place - begin - std::clamp(height, 0.0, b.length) * axis;
      const double distance = offset.norm();
      if (distance >= reach) continue;
      const Vector3 normal = distance > 0 ? Vector3(offset / distance) : axis.unitOrthogonal();
      Matrix3 bend = Matrix3::Identity() - normal * normal.transpose();
      if (height > 0 && height < b.length) bend -= axis * axis.transpose();
      found(
          Touch{a, b, place - centre(a), place - centre(b), normal, bend / std::max(distance, 1e-9), distance - reach});
    }
  };
  const std::size_t count = hands_pass_ ? pairs_within_hands_ : pairs_.size();
  for (std::size_t p = 0; p < count; ++p) {
    const auto [a, b] = pairs_[p];
    const double reach = bones_[a].capsule.radius + bones_[b].capsule.radius + kClearance;
    const double far = bones_[a].length + bones_[b].length + 2 * reach;
    const Vector3 twice_apart = placed[a].begin + placed[a].end - placed[b].begin - placed[b].end;
    if (twice_apart.squaredNorm() >= far * far) continue;
    from(a, b, reach);
    from(b, a, reach);
  }
}

double SkeletonContact::value(const State& state) const {
  double energy = 0;
  for_each_touch(state, [&](const Touch& touch) { energy += 0.5 * kStiffness * touch.gap * touch.gap; });
  return energy;
}

double SkeletonContact::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for_each_touch(state, [&](const Touch& touch) {
    energy += 0.5 * kStiffness * touch.gap * touch.gap;
    const Vector3 force = kStiffness * touch.gap * touch.normal;
    gradient.segment<3>(3 * touch.a.translation) += force;
    gradient.segment<3>(3 * touch.a.rotation) += touch.arm_a.cross(force);
    gradient.segment<3>(3 * touch.b.translation) -= force;
    gradient.segment<3>(3 * touch.b.rotation) -= touch.arm_b.cross(force);
  });
  return energy;
}

// U depends on z = R_b^T (p - x_b), and its second derivative is that of U by z between the derivatives of z, plus the
// force times the second derivatives of z.
void SkeletonContact::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for_each_touch(state, [&](const Touch& touch) {
    Matrix3 stiffness = kStiffness * touch.normal * touch.normal.transpose();
    Vector3 force = Vector3::Zero();
    if (curvature == Curvature::exact) {
      force = kStiffness * touch.gap * touch.normal;
      stiffness += kStiffness * touch.gap * touch.bend;
    }
    const Matrix3 of_a = -skew(touch.arm_a), of_b = skew(touch.arm_b), turned = skew(force);
    const auto turns_twice = [&](const Vector3& arm) {
      return Matrix3(0.5 * (arm * force.transpose() + force * arm.transpose()) - force.dot(arm) * Matrix3::Identity());
    };
    hessian.add(touch.a.on_translation, stiffness);
    hessian.add(touch.a.between_both, of_a.transpose() * stiffness);
    hessian.add(touch.a.on_rotation, of_a.transpose() * stiffness * of_a + turns_twice(touch.arm_a));
    hessian.add(touch.b.on_translation, stiffness);
    hessian.add(touch.b.between_both, -of_b.transpose() * stiffness - turned);
    hessian.add(touch.b.on_rotation, of_b.transpose() * stiffness * of_b + turns_twice(touch.arm_b));
    const auto add_between = [&](int of_first, int of_second, const Matrix3& block) {
      const BlockSlot slot = hessian.pair(of_first, of_second);
      if (slot.index >= 0) hessian.add(slot, block);
    };
    add_between(touch.a.translation, touch.b.translation, -stiffness);
    add_between(touch.a.rotation, touch.b.translation, -of_a.transpose() * stiffness);
    add_between(touch.b.rotation, touch.a.translation, of_b.transpose() * stiffness + turned);
    add_between(touch.b.rotation, touch.a.rotation, (of_b.transpose() * stiffness + turned) * of_a);
  });
}

}  // namespace softhand
