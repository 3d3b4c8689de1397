#include "cli/virtual_rig.hpp"

#include <algorithm>
#include <stdexcept>

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

void keep_newest(std::vector<ObjectCoupling>& couplings, const ObjectCoupling& coupling) {
  const auto known = std::find_if(couplings.begin(), couplings.end(),
                                  [&coupling](const ObjectCoupling& each) { return each.hand == coupling.hand; });
  if (known == couplings.end()) {
    couplings.push_back(coupling);
  } else {
    *known = coupling;
  }
}

}  // namespace

// One hand of the rig with its user, tracker, intermediate layer and glove, and the messages on their way.
struct VirtualRig::Hand final : TrackerSink {
  explicit Hand(VirtualRig& of) : rig(of) {}

  void hand(const Skeleton& sample) override { rig.deliver(*this, polled, sample); }
  void head(const HeadPose&) override {}  // the rig has no headset
  JointFrames user_at(Nanoseconds now) const {
    const double time = user_start + static_cast<double>(now - kStart) * 1e-9;
    return user->at(user_repeats ? std::fmod(time, user->duration()) : time);
  }

  VirtualRig& rig;
  std::size_t place = 0;  // in `hands_`
  HandModel model;
  HandKey key;
  Nanoseconds compute = 0;               // from reading the inputs of a step to publishing its results
  Nanoseconds polled = 0;                // when the tracker was asked last
  HandOptions options;                   // of its process
  std::vector<SoftObject> soft_objects;  // of its process
  std::unique_ptr<TrackerSource> tracker;
  std::unique_ptr<TrackingLoop> tracking;  // null without the intermediate layer
  std::shared_ptr<HandLoop> loop;          // of its process
  int in_loop = 0;                         // number of the hand in it
  std::unique_ptr<DeviceLoop<BoneWrench>> haptic;
  std::shared_ptr<const Motion> user;  // may be null
  double user_start = 0;
  bool user_repeats = false;

  Delayed<Skeleton> tracked_to_tracking;
  Delayed<Skeleton> skeleton_to_hand;
  Delayed<Skeleton> simulated_to_tracking;
  Delayed<Contacts> contacts_to_tracking;
  Delayed<WorldObjects> objects_to_hand;
  Delayed<ObjectCoupling> coupling_to_world;
  std::vector<Delayed<SoftObjectState>> soft_to_world, soft_to_hand;  // by flexible object of its process
  Delayed<BoneWrench> wrench_to_haptic;
  std::vector<Delayed<ObjectCoupling>> coupling_to_hand;  // by the hand that receives it; to itself: not used
  std::vector<ObjectCoupling> other_hands;                // the newest one that this hand has received from each

  Skeleton tracked;   // the newest one
  HandOutput output;  // of the last step
  Outcome outcome;
  WrenchWork work_on_tracked, work_on_user;
  std::uint64_t steps = 0;
  std::vector<StepTiming> timings;
};

// The simulated glove on the hand of a user.
class VirtualRig::Glove final : public HapticLogDriver {
 public:
  explicit Glove(const Hand& hand) : HapticLogDriver({}), hand_(hand) {}
  bool measure(Nanoseconds now, std::span<double> positions) override {
    if (hand_.user == nullptr) return HapticLogDriver::measure(now, positions);
    const JointFrames frames = hand_.user_at(now);
    const auto pose = [&frames](Body body) { return frames[static_cast<std::size_t>(index_of(joint_of(body)))]; };
    std::array<Pose, kFingerCount> distal;
    for (std::size_t f = 0; f < kFingerCount; ++f) distal[f] = pose(distal_of(static_cast<Finger>(f)));
    encoders_.move(pose(Body::carpus), distal);
    return encoders_.read(positions);
  }

 private:
  const Hand& hand_;
  GloveEncoders encoders_;
};

VirtualRig::VirtualRig(const Scene& scene, const HandModel& hand, std::unique_ptr<TrackerSource> tracker,
                       RigWitness* witness)
    : options_(scene.options),
      witness_(witness),
      transport_(nanoseconds(1e-3 * scene.options.simulate.transport_ms)),
      world_(std::make_unique<WorldLoop>(options_.world, options_.objects, 1.0 / options_.hand.rate_hz, options_.joints,
                                         scene.soft_objects)) {
  for (const ObjectDescription& description : world_->descriptions()) {
    const bool has_file = !description.shape.file.empty();
    file_shapes_.push_back(has_file ? load_shape(description.shape.file[0], object_folders(scene)) : nullptr);
  }
  descriptions_heard_ = world_->descriptions_version();
  add_hand(scene, hand, std::move(tracker));
  add_loop(RigLoop::world, options_.world.rate_hz, 0.63, [this](Nanoseconds now) { step_world(now); });
}

VirtualRig::~VirtualRig() = default;

// The phases differ so that no two loops tick at the same time.
void VirtualRig::add_loop(RigLoop name, double rate_hz, double phase, std::function<void(Nanoseconds)> step) {
  loops_.push_back({nanoseconds(1.0 / rate_hz), kStart + nanoseconds(phase / rate_hz), name, std::move(step)});
}

void VirtualRig::add_hand(const Scene& scene, const HandModel& model, std::unique_ptr<TrackerSource> tracker) {
  const SceneOptions& options = scene.options;
  const HandKey key{static_cast<std::uint32_t>(options.user), model.side == Side::right ? 1u : 0u};
  for (const auto& other : hands_)
    if (other->key == key) throw std::invalid_argument("two hands of the rig have the same user and side");
  const double shift = options.simulate.hand_phase * static_cast<double>(hands_.size());
  Hand& hand = *hands_.emplace_back(std::make_unique<Hand>(*this));
  hand.place = hands_.size() - 1;
  hand.model = model;
  hand.key = key;
  hand.compute = nanoseconds(options.simulate.hand_compute_fraction / options.hand.rate_hz);
  hand.tracker = std::move(tracker);
  if (!options.hand.direct)
    hand.tracking = std::make_unique<TrackingLoop>(options.tracking, options.hand.rate_hz, model, key);
  const bool joins = options_.one_process && hand.place > 0;
  make_hand_loop(joins ? *hands_.front() : hand, scene);
  hand.haptic = std::make_unique<DeviceLoop<BoneWrench>>(options.haptic.loop, std::make_unique<Glove>(hand), 1, 0);
  for (const auto& each : hands_) each->coupling_to_hand.resize(hands_.size());

  // The loop only polls. The source delivers at its own rate.
  add_loop(RigLoop::tracker, 1000, shift, [&hand](Nanoseconds now) {
    hand.polled = now;
    hand.tracker->poll(now, hand);
  });
  if (hand.tracking)
    add_loop(RigLoop::tracking, options.tracking.rate_hz, 0.31 + shift,
             [this, &hand](Nanoseconds now) { step_tracking(hand, now); });
  if (!joins)
    add_loop(RigLoop::hand, options.hand.rate_hz, 0.47 + shift,
             [this, &hand](Nanoseconds now) { step_hand(hand, now); });
  add_loop(RigLoop::haptic, options.haptic.loop.rate_hz, 0.79 + shift,
           [this, &hand](Nanoseconds now) { step_haptic(hand, now); });
}

// Makes the loop of the hand's process. If another hand joined the first one, the loop of both replaces its own.
void VirtualRig::make_hand_loop(Hand& first, const Scene& scene) {
  std::vector<KeyedHand> hands;
  for (std::size_t h = first.place; h < hands_.size(); ++h) hands.push_back({hands_[h]->model, hands_[h]->key});
  if (hands.size() == 1) {
    first.soft_objects = scene.soft_objects;
    first.soft_to_world.resize(scene.soft_objects.size());
    first.soft_to_hand.resize(scene.soft_objects.size());
    first.options = scene.options.hand;
  }
  const auto loop = std::make_shared<HandLoop>(hands, first.options, object_spring(options_.world), first.soft_objects);
  for (std::size_t i = 0; i < file_shapes_.size(); ++i)
    loop->describe_object(world_->descriptions()[i], file_shapes_[i]);
  for (const ObjectJointDescription& joint : world_->joint_descriptions()) loop->describe_joint(joint);
  for (std::size_t h = 0; h < hands.size(); ++h) {
    hands_[first.place + h]->loop = loop;
    hands_[first.place + h]->in_loop = static_cast<int>(h);
  }
}

void VirtualRig::add_other_hands(const Scene& first, const std::vector<std::string>& overrides) {
  for (std::size_t i = 1; i < first.hands.size(); ++i) {
    std::vector<std::string> settings = overrides;
    settings.push_back("plays=" + first.hands[i]);
    const Scene scene = read_scene(first.path, settings);
    const HandModel hand = load_scene_hand(scene);
    const std::shared_ptr<const Motion> motion = make_scene_motion(scene, hand);
    const ReplayOptions& options = scene.options.tracker;
    add_hand(scene, hand, std::make_unique<ReplayTracker>(motion, options, hand_key(scene)));
    set_user(motion, options.start_time, options.repeat, i);
  }
}

void VirtualRig::set_user(std::shared_ptr<const Motion> motion, double start_time, bool repeat, std::size_t hand) {
  hands_[hand]->user = std::move(motion);
  hands_[hand]->user_start = start_time;
  hands_[hand]->user_repeats = repeat;
}

const Outcome& VirtualRig::outcome(std::size_t hand) const { return hands_[hand]->outcome; }
const HandLoop& VirtualRig::hand(std::size_t hand) const { return *hands_[hand]->loop; }
int VirtualRig::number_in_loop(std::size_t hand) const { return hands_[hand]->in_loop; }
const TrackingLoop* VirtualRig::tracking(std::size_t hand) const { return hands_[hand]->tracking.get(); }
const DeviceLoop<BoneWrench>& VirtualRig::haptic(std::size_t hand) const { return *hands_[hand]->haptic; }
double VirtualRig::work_on_tracked(std::size_t hand) const { return hands_[hand]->work_on_tracked.joules(); }
double VirtualRig::work_on_user(std::size_t hand) const { return hands_[hand]->work_on_user.joules(); }
std::uint64_t VirtualRig::steps_of_hand(std::size_t hand) const { return hands_[hand]->steps; }
const std::vector<StepTiming>& VirtualRig::hand_timings(std::size_t hand) const { return hands_[hand]->timings; }

void VirtualRig::run(double seconds, const std::function<void(const HandStepView&)>& after_hand_step) {
  after_hand_step_ = after_hand_step;
  const Nanoseconds end = kStart + nanoseconds(seconds);
  for (;;) {
    // If two loops tick at the same time, the one that was added first runs first.
    Loop& next =
        *std::min_element(loops_.begin(), loops_.end(), [](const Loop& a, const Loop& b) { return a.next < b.next; });
    if (next.next >= end) break;
    const Nanoseconds now = next.next;
    next.next += next.period;
    if (witness_ == nullptr || witness_->runs(next.name, now)) next.step(now);
  }
}

void VirtualRig::describe_object(const ObjectDescription& description) {
  for (const auto& hand : hands_)
    if (hand->in_loop == 0) hand->loop->describe_object(description);
}

void VirtualRig::send(const Message& message) {
  for (const auto& hand : hands_) {
    if (hand->tracking) hand->tracking->answer(message, "tracking");
    if (hand->in_loop == 0) hand->loop->answer(message, "hand");
  }
  world_->answer(message);
  for (const auto& hand : hands_) {
    if (hand->in_loop > 0) continue;
    for (std::size_t i = 0; i < world_->descriptions().size(); ++i) {
      ObjectDescription description = world_->descriptions()[i];
      if (description.stamp.sequence <= descriptions_heard_) continue;
      description.stamp.sample_time = world_->objects().stamp.sample_time + 1;  // the world's next step
      hand->loop->describe_object(description, file_shapes_[i]);
    }
    for (const ObjectJointDescription& joint : world_->joint_descriptions())
      if (joint.stamp.sequence > descriptions_heard_) hand->loop->describe_joint(joint);
  }
  descriptions_heard_ = world_->descriptions_version();
}

void VirtualRig::deliver(Hand& hand, Nanoseconds now, const Skeleton& sample) {
  Skeleton& skeleton = hand.tracked;
  skeleton = sample;
  skeleton.stamp.publish_time = now;
  skeleton.stamp.epoch = 1;
  skeleton.stamp.chain.tracker_sample = skeleton.stamp.sample_time;
  hand.outcome.on_tracked(skeleton);
  add_bits(hasher_, skeleton.joints);
  send(hand.tracking ? hand.tracked_to_tracking : hand.skeleton_to_hand, RigLoop::tracker, now, skeleton);
}

void VirtualRig::step_tracking(Hand& hand, Nanoseconds now) {
  TrackingInput input;
  input.tracked = hand.tracked_to_tracking.receive(now);
  input.simulated = hand.simulated_to_tracking.receive(now);
  input.contacts = hand.contacts_to_tracking.receive(now);
  const TrackingOutput& output = hand.tracking->step(now, input);
  if (!output.valid) return;
  add_bits(hasher_, output.intermediate.joints);
  Skeleton intermediate = output.intermediate;
  intermediate.stamp.publish_time = now;
  tell(RigLoop::tracking, intermediate);
  send(hand.skeleton_to_hand, RigLoop::tracking, now, intermediate);
  BoneWrench wrench = output.wrench;
  wrench.stamp.publish_time = now;
  hand.outcome.on_bone_wrench(wrench);
  tell(RigLoop::tracking, wrench);
  send(hand.wrench_to_haptic, RigLoop::tracking, now, wrench);
}

void VirtualRig::step_hand(Hand& first, Nanoseconds now) {
  HandLoop& loop = *first.loop;
  HandInput input;
  input.skeleton = first.skeleton_to_hand.receive(now);
  if (loop.hand_count() > 1) input.second_skeleton = hands_[first.place + 1]->skeleton_to_hand.receive(now);
  input.world = first.objects_to_hand.receive(now);
  for (const auto& other : hands_) {
    if (other->loop == first.loop) continue;
    if (const ObjectCoupling* coupling = other->coupling_to_hand[first.place].receive(now))
      keep_newest(first.other_hands, *coupling);
  }
  input.other_hands = first.other_hands;
  soft_states_.clear();
  for (auto& copy : first.soft_to_hand)
    if (const SoftObjectState* newest = copy.receive(now)) soft_states_.push_back(*newest);
  input.soft_objects = soft_states_;
  loop.step(now, input, {});
  if (!loop.plays()) return;
  add_state(hasher_, loop.simulation().state());
  // The results of a step are published when the step is done. That is most of a period after its inputs were read.
  const Nanoseconds done = now + first.compute;
  ObjectCoupling coupling = loop.output().coupling;
  coupling.stamp.publish_time = done;
  for (int h = 0; h < loop.hand_count(); ++h) {
    Hand& hand = *hands_[first.place + static_cast<std::size_t>(h)];
    hand.output = loop.output(h);
    if (hand.output.valid) publish(hand, done, coupling);
  }
  send(first.coupling_to_world, RigLoop::hand, done, coupling);
  for (std::size_t i = 0; i < first.soft_to_world.size(); ++i)
    send(first.soft_to_world[i], RigLoop::hand, done, loop.output().soft_objects[i]);
  for (std::size_t other = 0; other < hands_.size(); ++other)
    if (hands_[other]->loop != first.loop) send(first.coupling_to_hand[other], RigLoop::hand, done, coupling);
  for (int h = 0; h < loop.hand_count() && after_hand_step_; ++h) {
    const Hand& hand = *hands_[first.place + static_cast<std::size_t>(h)];
    if (hand.output.valid)
      after_hand_step_(
          {now, hand.place, &hand.output, &coupling, &loop.simulation(), h, &world_->objects(), &hand.tracked});
  }
}

void VirtualRig::publish(Hand& hand, Nanoseconds done, const ObjectCoupling& coupling) {
  HandOutput& output = hand.output;
  ++hand.steps;
  hand.timings.push_back(output.report.timing);
  output.simulated.stamp.publish_time = output.coupling.stamp.publish_time = output.contacts.stamp.publish_time = done;
  output.bone_wrench.stamp.publish_time = done;
  hand.outcome.on_simulated(output.simulated);
  hand.outcome.on_contacts(output.contacts);
  if (hand.in_loop == 0) hand.outcome.on_coupling(coupling);
  tell(RigLoop::hand, output);
  if (hand.tracking) {
    send(hand.simulated_to_tracking, RigLoop::hand, done, output.simulated);
    send(hand.contacts_to_tracking, RigLoop::hand, done, output.contacts);
  } else {
    hand.outcome.on_bone_wrench(output.bone_wrench);
    output.bone_wrench.stamp.chain.simulated_published = output.bone_wrench.stamp.chain.wrench_published = done;
    send(hand.wrench_to_haptic, RigLoop::hand, done, output.bone_wrench);
  }
}

void VirtualRig::step_world(Nanoseconds now) {
  for (const auto& hand : hands_)
    if (const ObjectCoupling* coupling = hand->coupling_to_world.receive(now)) keep_newest(couplings_, *coupling);
  soft_states_.clear();
  for (const auto& hand : hands_) {
    for (auto& state : hand->soft_to_world)
      if (const SoftObjectState* newest = state.receive(now)) soft_states_.push_back(*newest);
  }
  const WorldOutput& output = world_->step(now, {couplings_, soft_states_});
  WorldObjects objects = output.objects;
  objects.stamp.publish_time = now;
  for (const ObjectState& object : objects.objects) {
    add_bits(hasher_, object.position);
    add_bits(hasher_, object.orientation);
    add_bits(hasher_, object.linear_velocity);
    add_bits(hasher_, object.angular_velocity);
  }
  for (std::size_t i = 0; i < output.soft_count; ++i) {
    const SoftObjectState& copy = output.soft_objects[i];
    for (const auto& hand : hands_) {
      const std::size_t number = copy.object - kFirstSoftObject;
      if (number < hand->soft_to_hand.size()) send(hand->soft_to_hand[number], RigLoop::world, now, copy);
    }
  }
  tell(RigLoop::world, objects);
  for (const auto& hand : hands_) {
    hand->outcome.on_objects(objects);
    send(hand->objects_to_hand, RigLoop::world, now, objects);
  }
}

void VirtualRig::step_haptic(Hand& hand, Nanoseconds now) {
  const BoneWrench* wrench = hand.wrench_to_haptic.receive(now);
  if (wrench != nullptr) {
    BonePoses poses;
    for (std::size_t b = 0; b < kBodyCount; ++b)
      poses[b] = to_pose(wrench->bones[b].tracked_position, wrench->bones[b].tracked_orientation);
    hand.work_on_tracked.add(*wrench, poses);
    if (hand.user != nullptr) {
      const JointFrames frames = hand.user_at(now);
      for (std::size_t b = 0; b < kBodyCount; ++b)
        poses[b] = frames[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(b))))];
      hand.work_on_user.add(*wrench, poses);
    }
  }
  DeviceState state = hand.haptic->step(now, wrench);
  state.stamp.publish_time = now;
  hand.outcome.on_device(state);
  tell(RigLoop::haptic, state);
}

}  // namespace softhand
