#include "cli/virtual_rig.hpp"

#include <algorithm>

#include "hand/object_shapes.hpp"
#include "haptics/log/haptic_log_driver.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

Nanoseconds nanoseconds(double seconds) { return static_cast<Nanoseconds>(std::llround(seconds * 1e9)); }

template <typename T>
void add_bits(Sha256& hasher, const T& value) {
  static_assert(std::is_trivially_copyable_v<T>);
  hasher.add(std::as_bytes(std::span(&value, 1)));
}

void add_state(Sha256& hasher, const State& state) {
  hasher.add(
      std::as_bytes(std::span(state.node_positions.data(), static_cast<std::size_t>(state.node_positions.size()))));
  hasher.add(
      std::as_bytes(std::span(state.node_velocities.data(), static_cast<std::size_t>(state.node_velocities.size()))));
  const auto add = [&hasher](const auto& coefficients) {
    hasher.add(std::as_bytes(std::span(coefficients.data(), static_cast<std::size_t>(coefficients.size()))));
  };
  for (const Pose& pose : state.body_poses) {
    add(pose.position);
    add(pose.orientation.coeffs());
  }
  for (const Twist& twist : state.body_velocities) {
    add(twist.linear);
    add(twist.angular);
  }
}

}  // namespace

// The simulated glove on the hand of the rig's user.
class VirtualRig::Glove final : public HapticLogDriver {
 public:
  explicit Glove(const VirtualRig& rig) : HapticLogDriver({}), rig_(rig) {}
  bool measure(Nanoseconds now, std::span<double> positions) override {
    if (rig_.user_ == nullptr) return HapticLogDriver::measure(now, positions);
    const JointFrames frames = rig_.user_at(now);
    const auto pose = [&frames](Body body) { return frames[static_cast<std::size_t>(index_of(joint_of(body)))]; };
    std::array<Pose, kFingerCount> distal;
    for (std::size_t f = 0; f < kFingerCount; ++f) distal[f] = pose(distal_of(static_cast<Finger>(f)));
    encoders_.move(pose(Body::carpus), distal);
    return encoders_.read(positions);
  }

 private:
  const VirtualRig& rig_;
  GloveEncoders encoders_;
};

VirtualRig::VirtualRig(const Scene& scene, const HandModel& hand, std::unique_ptr<TrackerSource> tracker,
                       RigWitness* witness)
    : options_(scene.options),
      tracker_(std::move(tracker)),
      witness_(witness),
      transport_(nanoseconds(1e-3 * scene.options.simulate.transport_ms)),
      hand_compute_(nanoseconds(scene.options.simulate.hand_compute_fraction / scene.options.hand.rate_hz)) {
  const HandKey key{static_cast<std::uint32_t>(options_.user), hand.side == Side::right ? 1u : 0u};
  const bool layered = !options_.hand.direct;
  if (layered) tracking_ = std::make_unique<TrackingLoop>(options_.tracking, options_.hand.rate_hz, hand, key);
  world_ = std::make_unique<WorldLoop>(options_.world, options_.objects, 1.0 / options_.hand.rate_hz, options_.joints);
  hand_ = std::make_unique<HandLoop>(hand, options_.hand, key, object_spring(options_.world), scene.soft_objects);
  for (const ObjectDescription& description : world_->descriptions()) {
    const bool has_file = !description.shape.file.empty();
    file_shapes_.push_back(has_file ? load_shape(description.shape.file[0], object_folders(scene)) : nullptr);
    hand_->describe_object(description, file_shapes_.back());
  }
  for (const ObjectJointDescription& joint : world_->joint_descriptions()) hand_->describe_joint(joint);
  descriptions_heard_ = world_->descriptions_version();
  haptic_ = std::make_unique<DeviceLoop<BoneWrench>>(options_.haptic.loop, std::make_unique<Glove>(*this), 1, 0);

  // The phases differ so that no two loops tick at the same time. If two do, the loop that is added first runs first.
  const auto add = [this](RigLoop name, double rate_hz, double phase, void (VirtualRig::*step)(Nanoseconds)) {
    const Nanoseconds period = nanoseconds(1.0 / rate_hz);
    loops_.push_back({period, kStart + nanoseconds(phase / rate_hz), name, step});
  };
  add(RigLoop::tracker, 1000, 0.0, &VirtualRig::step_tracker);  // the loop only polls; the source delivers at its own
                                                                // rate
  if (layered) add(RigLoop::tracking, options_.tracking.rate_hz, 0.31, &VirtualRig::step_tracking);
  add(RigLoop::hand, options_.hand.rate_hz, 0.47, &VirtualRig::step_hand);
  add(RigLoop::world, options_.world.rate_hz, 0.63, &VirtualRig::step_world);
  add(RigLoop::haptic, options_.haptic.loop.rate_hz, 0.79, &VirtualRig::step_haptic);
}

VirtualRig::~VirtualRig() = default;

void VirtualRig::set_user(std::shared_ptr<const Motion> motion, double start_time, bool repeat) {
  user_ = std::move(motion);
  user_start_ = start_time;
  user_repeats_ = repeat;
}

JointFrames VirtualRig::user_at(Nanoseconds now) const {
  const double time = user_start_ + static_cast<double>(now - kStart) * 1e-9;
  return user_->at(user_repeats_ ? std::fmod(time, user_->duration()) : time);
}

void VirtualRig::run(double seconds, const std::function<void(const HandStepView&)>& after_hand_step) {
  after_hand_step_ = after_hand_step;
  const Nanoseconds end = kStart + nanoseconds(seconds);
  for (;;) {
    Loop& next =
        *std::min_element(loops_.begin(), loops_.end(), [](const Loop& a, const Loop& b) { return a.next < b.next; });
    if (next.next >= end) break;
    const Nanoseconds now = next.next;
    next.next += next.period;
    if (witness_ == nullptr || witness_->runs(next.name, now)) (this->*next.step)(now);
  }
}

void VirtualRig::send(const Message& message) {
  if (tracking_) tracking_->answer(message, "tracking");
  hand_->answer(message, "hand");
  world_->answer(message);
  for (std::size_t i = 0; i < world_->descriptions().size(); ++i) {
    ObjectDescription description = world_->descriptions()[i];
    if (description.stamp.sequence <= descriptions_heard_) continue;
    description.stamp.sample_time = world_->objects().stamp.sample_time + 1;  // the world's next step
    hand_->describe_object(description, file_shapes_[i]);
  }
  for (const ObjectJointDescription& joint : world_->joint_descriptions())
    if (joint.stamp.sequence > descriptions_heard_) hand_->describe_joint(joint);
  descriptions_heard_ = world_->descriptions_version();
}

void VirtualRig::step_tracker(Nanoseconds now) {
  sink_.now = now;
  tracker_->poll(now, sink_);
}

void VirtualRig::deliver(const Skeleton& sample) {
  const Nanoseconds now = sink_.now;
  Skeleton& skeleton = tracked_;
  skeleton = sample;
  skeleton.stamp.publish_time = now;
  skeleton.stamp.epoch = 1;
  skeleton.stamp.chain.tracker_sample = skeleton.stamp.sample_time;
  outcome_.on_tracked(skeleton);
  add_bits(hasher_, skeleton.joints);
  send(tracking_ ? tracked_to_tracking_ : skeleton_to_hand_, RigLoop::tracker, now, skeleton);
}

void VirtualRig::step_tracking(Nanoseconds now) {
  TrackingInput input;
  input.tracked = tracked_to_tracking_.receive(now);
  input.simulated = simulated_to_tracking_.receive(now);
  input.contacts = contacts_to_tracking_.receive(now);
  const TrackingOutput& output = tracking_->step(now, input);
  if (!output.valid) return;
  add_bits(hasher_, output.intermediate.joints);
  Skeleton intermediate = output.intermediate;
  intermediate.stamp.publish_time = now;
  tell(RigLoop::tracking, intermediate);
  send(skeleton_to_hand_, RigLoop::tracking, now, intermediate);
  BoneWrench wrench = output.wrench;
  wrench.stamp.publish_time = now;
  outcome_.on_bone_wrench(wrench);
  tell(RigLoop::tracking, wrench);
  send(wrench_to_haptic_, RigLoop::tracking, now, wrench);
}

void VirtualRig::step_hand(Nanoseconds now) {
  HandInput input;
  input.skeleton = skeleton_to_hand_.receive(now);
  input.world = objects_to_hand_.receive(now);
  HandOutput output = hand_->step(now, input, {});
  if (!output.valid) return;
  ++hand_steps_;
  hand_timings_.push_back(output.report.timing);
  add_state(hasher_, hand_->simulation().state());
  // The results of a step are published when the step is done. That is most of a period after its inputs were read.
  const Nanoseconds done = now + hand_compute_;
  output.simulated.stamp.publish_time = output.coupling.stamp.publish_time = output.contacts.stamp.publish_time = done;
  output.bone_wrench.stamp.publish_time = done;
  outcome_.on_simulated(output.simulated);
  outcome_.on_contacts(output.contacts);
  outcome_.on_coupling(output.coupling);
  tell(RigLoop::hand, output);
  if (tracking_) {
    send(simulated_to_tracking_, RigLoop::hand, done, output.simulated);
    send(contacts_to_tracking_, RigLoop::hand, done, output.contacts);
  } else {
    outcome_.on_bone_wrench(output.bone_wrench);
    output.bone_wrench.stamp.chain.simulated_published = output.bone_wrench.stamp.chain.wrench_published = done;
    send(wrench_to_haptic_, RigLoop::hand, done, output.bone_wrench);
  }
  send(coupling_to_world_, RigLoop::hand, done, output.coupling);
  if (after_hand_step_) after_hand_step_({now, &output, &hand_->simulation(), &world_->objects(), &tracked_});
}

void VirtualRig::step_world(Nanoseconds now) {
  if (const ObjectCoupling* coupling = coupling_to_world_.receive(now)) {
    coupling_ = *coupling;
    coupling_heard_ = true;
  }
  WorldInput input;
  if (coupling_heard_) input.couplings = std::span(&coupling_, 1);
  WorldObjects objects = world_->step(now, input).objects;
  objects.stamp.publish_time = now;
  for (const ObjectState& object : objects.objects) {
    add_bits(hasher_, object.position);
    add_bits(hasher_, object.orientation);
    add_bits(hasher_, object.linear_velocity);
    add_bits(hasher_, object.angular_velocity);
  }
  outcome_.on_objects(objects);
  tell(RigLoop::world, objects);
  send(objects_to_hand_, RigLoop::world, now, objects);
}

void VirtualRig::step_haptic(Nanoseconds now) {
  const BoneWrench* wrench = wrench_to_haptic_.receive(now);
  if (wrench != nullptr) {
    BonePoses poses;
    for (std::size_t b = 0; b < kBodyCount; ++b)
      poses[b] = to_pose(wrench->bones[b].tracked_position, wrench->bones[b].tracked_orientation);
    work_on_tracked_.add(*wrench, poses);
    if (user_ != nullptr) {
      const JointFrames frames = user_at(now);
      for (std::size_t b = 0; b < kBodyCount; ++b)
        poses[b] = frames[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(b))))];
      work_on_user_.add(*wrench, poses);
    }
  }
  DeviceState state = haptic_->step(now, wrench);
  state.stamp.publish_time = now;
  outcome_.on_device(state);
  tell(RigLoop::haptic, state);
}

}  // namespace softhand
