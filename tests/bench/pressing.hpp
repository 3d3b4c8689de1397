// A hand that presses on some of several objects. It shows how the cost of a step depends on the touched objects.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <set>
#include <span>
#include <string>

#include "hand/hand_loop.hpp"
#include "messages/convert.hpp"

namespace softhand::bench {

/// A resting hand. Its five fingertips sink a millimetre into heavy balls, among other balls that the hand does not
/// touch.
class Pressing {
 public:
  /// The hand sways up and down in this many steps.
  static constexpr int kStepsPerSway = 90;

  /// `clearance`: distance from the hand's highest node up to the untouched balls, m. `slots`: for movable objects.
  Pressing(int touched, int untouched, double clearance = 0.02, const std::string& hand_file = "right_1450.hand.json",
           HandOptions options = {}, int slots = 8)
      : hand_(load_hand(SOFTHAND_SOURCE_DIR "/config/hands/" + hand_file)) {
    options.mirrored_objects = slots;
    loop_ = std::make_unique<HandLoop>(hand_, options, HandKey{});
    constexpr std::array<Joint, 5> tips{Joint::thumb_tip, Joint::index_tip, Joint::middle_tip, Joint::ring_tip,
                                        Joint::little_tip};
    constexpr double kRadius = 0.01, kDepth = 0.001;
    Vector3 low = Vector3::Constant(1), high = Vector3::Constant(-1);
    for (const Vector3& node : hand_.nodes) {
      low = low.cwiseMin(node);
      high = high.cwiseMax(node);
    }
    for (int k = 0; k < untouched; ++k) {
      // A grid above the hand.
      const double u = (k % 10 + 0.5) / 10, v = (k / 10 + 0.5) / 10;
      add(Vector3(low.x() + u * (high.x() - low.x()), high.y() + clearance + kRadius,
                  low.z() + v * (high.z() - low.z())),
          kRadius);
    }
    for (int k = 0; k < touched; ++k) {
      const Vector3 tip =
          hand_.rest_joints[static_cast<std::size_t>(index_of(tips[static_cast<std::size_t>(k)]))].position;
      // The ball is under the lowest contact point of the tip.
      Vector3 lowest = tip;
      for (const SkinPoint& point : hand_.contact_points) {
        const Vector3 place = hand_.position_of(point);
        if ((place - tip).norm() < 0.01 && place.y() < lowest.y()) lowest = place;
      }
      add(lowest + Vector3(0, kDepth - kRadius, 0), kRadius);
    }
  }

  /// Runs one step of the whole loop, from inputs to outputs, through `measure(step)`. Returns the result of `measure`.
  template <typename Measure>
  auto step(Measure&& measure) {
    now_ += 11'111'111;
    ++skeleton_->stamp.sequence;
    skeleton_->stamp.sample_time = world_->stamp.sample_time = now_;
    const double sway = 5e-4 * std::sin(2e-9 * std::numbers::pi * static_cast<double>(now_));
    for (std::size_t j = 0; j < kJointCount; ++j) {
      const Pose pose = Pose{Vector3(0, sway, 0), Quaternion::Identity()} * hand_.rest_joints[j];
      skeleton_->joints[j].position = to_wire(pose.position);
      skeleton_->joints[j].orientation = to_wire(pose.orientation);
      skeleton_->joints[j].flags = kJointValid | kJointTracked;
    }
    const HandInput input{skeleton_.get(), nullptr, world_.get(), other_hands_};
    return measure([&] { output_ = &loop_->step(now_, input, {.traction = false}); });
  }
  /// The newest coupling of each other hand in all further steps. The span must stay valid.
  void hear(std::span<const ObjectCoupling> other_hands) { other_hands_ = other_hands; }
  /// Of the last step.
  const ObjectCoupling& coupling() const { return output_->coupling; }
  /// Steps until the tissue is at rest around the touched balls.
  void settle(int steps = 30) {
    for (int i = 0; i < steps; ++i) step([](auto&& work) { work(); });
  }
  int touched_objects() const {
    std::set<std::uint32_t> objects;
    for (const Contact& contact : output_->contacts.contacts) objects.insert(contact.object);
    return static_cast<int>(objects.size());
  }
  int contacts() const { return static_cast<int>(output_->contacts.contacts.size()); }
  const HandLoop& hand() const { return *loop_; }
  const HandSimulation& simulation() const { return loop_->simulation(); }
  /// Number of objects in slots.
  int mirrored_objects() const {
    int count = 0;
    for (int slot = 0; slot < simulation().slot_count(); ++slot)
      count += simulation().slot_mode(slot) != SlotMode::empty;
    return count;
  }
  int iterations() const { return output_->report.iterations; }
  double contact_seconds() const { return output_->report.timing.begin + output_->report.timing.end; }

 private:
  void add(const Vector3& position, double radius) {
    ObjectDescription description;
    description.object = ++objects_;
    description.mass = 1000;  // so heavy that it does not move
    description.inertia = {0.4 * 1000 * radius * radius, 0.4 * 1000 * radius * radius, 0.4 * 1000 * radius * radius};
    description.friction = 0.8;
    description.shape.kind = static_cast<std::uint32_t>(ShapeKind::sphere);
    description.shape.size = {radius, 0, 0};
    loop_->describe_object(description);
    ObjectState state;
    state.object = description.object;
    state.position = to_wire(position);
    world_->objects.push_back(state);
  }

  HandModel hand_;
  std::unique_ptr<HandLoop> loop_;
  std::unique_ptr<Skeleton> skeleton_ = std::make_unique<Skeleton>();
  std::unique_ptr<WorldObjects> world_ = std::make_unique<WorldObjects>();
  std::span<const ObjectCoupling> other_hands_;
  const HandOutput* output_ = nullptr;
  Nanoseconds now_ = 1'000'000'000;
  std::uint32_t objects_ = 0;
};

}  // namespace softhand::bench
