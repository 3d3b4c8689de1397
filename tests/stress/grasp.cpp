#include "stress/grasp.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <stdexcept>

#include "messages/convert.hpp"
#include "stress/hand_events.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace softhand::stress {
namespace {

constexpr double kLift = 0.05;     // m
constexpr double kLifted = 0.9;    // share of kLift that counts as lifted
constexpr double kDeviceCap = 20;  // N, G4 for commands to a glove
constexpr double kSlow = 5;        // m/s, limit for the cube in every case

double seconds_since_start(Nanoseconds time) { return static_cast<double>(time - VirtualRig::kStart) * 1e-9; }

std::vector<std::string> scene_overrides(const std::vector<std::string>& more) {
  std::vector<std::string> all{"hand.model=right_400.hand.json", "tracker.position_noise=0",
                               "tracker.rotation_noise=0",       "generator.approach_distance=0.05",
                               "generator.approach_time=0.4",    "generator.close_time=0.4",
                               "generator.settle_time=0.2",      "generator.lift_time=0.4",
                               "generator.lift_height=0.05",     "generator.hold_time=600"};
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

// The motions are cached, because solving for a grip takes longer than simulating it.
std::shared_ptr<const Motion> motion_of(const Scene& scene) {
  static std::mutex mutex;
  static std::map<std::string, std::shared_ptr<const Motion>> known;
  const std::lock_guard lock(mutex);
  std::string key;
  for (const AppliedOverride& o : scene.overrides) {
    if (o.key.rfind("generator.", 0) == 0) key += o.key + "=" + o.after + ";";
  }
  std::shared_ptr<const Motion>& motion = known[key];
  if (!motion) motion = make_scene_motion(scene, load_scene_hand(scene));
  return motion;
}

class FaultyTracker final : public TrackerSource {
 public:
  FaultyTracker(std::unique_ptr<ReplayTracker> source, const Grasp& setting)
      : source_(std::move(source)), setting_(setting) {}
  void poll(Nanoseconds now, TrackerSink& out) override {
    Skeleton sample;
    if (source_->sample(now, sample)) {
      std::deque<Skeleton> more{sample};
      if (setting_.tracker) setting_.tracker(seconds_since_start(now), more);
      waiting_.insert(waiting_.end(), more.begin(), more.end());
    }
    if (waiting_.empty()) return;
    out.hand(waiting_.front());
    waiting_.pop_front();
  }

 private:
  std::unique_ptr<ReplayTracker> source_;
  const Grasp& setting_;
  std::deque<Skeleton> waiting_;
};

class Witness final : public RigWitness {
 public:
  Witness(const Grasp& setting, Grasped& result, HandWatch& watch)
      : setting_(setting), result_(result), watch_(watch) {}
  void published(RigLoop, const Skeleton& skeleton) override {
    if (!stress::all_finite(skeleton)) watch_.count_nonfinite();
    if (result_.first_stale < 0 && skeleton.confidence == 0)
      result_.first_stale = seconds_since_start(skeleton.stamp.sample_time);
  }
  void published(RigLoop, const BoneWrench& wrench) override {
    if (!stress::all_finite(wrench)) watch_.count_nonfinite();
    std::array<double, kBodyCount> forces;
    for (std::size_t b = 0; b < kBodyCount; ++b) forces[b] = to_vector(wrench.bones[b].coupling_force).norm();
    watch_.count_load(forces);
  }
  void published(RigLoop, const WorldObjects& objects) override {
    if (!stress::all_finite(objects)) watch_.count_nonfinite();
    for (const ObjectState& object : objects.objects) {
      if (object.object != kCube) continue;
      result_.world.push_back({seconds_since_start(objects.stamp.sample_time),
                               to_pose(object.position, object.orientation), to_vector(object.linear_velocity).norm()});
    }
  }
  void published(RigLoop, const DeviceState& state) override {
    if (!stress::all_finite(state)) watch_.count_nonfinite();
    for (const double command : state.commands)
      result_.largest_command = std::max(result_.largest_command, std::abs(command));
  }
  void published(RigLoop, const HandOutput& output) override {
    if (!stress::all_finite(output.simulated) || !stress::all_finite(output.contacts) ||
        !stress::all_finite(output.coupling) || !stress::all_finite(output.surface)) {
      watch_.count_nonfinite();
    }
  }
  bool runs(RigLoop loop, Nanoseconds now) override {
    return !setting_.runs || setting_.runs(loop, seconds_since_start(now));
  }
  Nanoseconds delay(RigLoop from, Nanoseconds now) override {
    return setting_.delay ? static_cast<Nanoseconds>(std::llround(1e9 * setting_.delay(from, seconds_since_start(now))))
                          : 0;
  }

 private:
  const Grasp& setting_;
  Grasped& result_;
  HandWatch& watch_;
};

// Calls `use` for the samples between two times.
template <typename Use>
void within(const std::vector<ObjectSample>& samples, double from, double to, Use&& use) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (samples[i].time >= from && samples[i].time <= to) use(i, samples[i]);
  }
}

}  // namespace

double Grasped::slip(double from, double to) const {
  double most = 0;
  std::array<Vector3, 2> first;
  bool any = false;
  within(twin, from, to, [&](std::size_t i, const ObjectSample& sample) {
    for (std::size_t k = 0; k < 2; ++k) {
      const Vector3 local = pads[i][k].inverse() * sample.pose.position;
      if (!any) first[k] = local;
      most = std::max(most, (local - first[k]).norm());
    }
    any = true;
  });
  return any ? most : std::nan("");
}

double Grasped::jitter(double from, double to) const {
  Vector3 mean = Vector3::Zero();
  double squares = 0, count = 0;
  within(twin, from, to, [&](std::size_t, const ObjectSample& sample) { mean += sample.pose.position, ++count; });
  mean /= count;
  within(twin, from, to,
         [&](std::size_t, const ObjectSample& sample) { squares += (sample.pose.position - mean).squaredNorm(); });
  return std::sqrt(squares / count);
}

double Grasped::drift(double from, double to) const {
  double count = 0, mean_time = 0, spread = 0;
  Vector3 mean = Vector3::Zero(), slope = Vector3::Zero();
  within(twin, from, to, [&](std::size_t, const ObjectSample& sample) {
    mean += sample.pose.position, mean_time += sample.time, ++count;
  });
  mean /= count;
  mean_time /= count;
  within(twin, from, to, [&](std::size_t, const ObjectSample& sample) {
    slope += (sample.time - mean_time) * (sample.pose.position - mean);
    spread += (sample.time - mean_time) * (sample.time - mean_time);
  });
  return (slope / spread).norm();
}

double Grasped::fastest(double from) const {
  double most = 0;
  within(world, from, 1e9, [&](std::size_t, const ObjectSample& sample) { most = std::max(most, sample.speed); });
  return most;
}

void Grasped::demand_slow_cube() { findings.demand("slow object", "speed of the cube", fastest(0), kSlow, "m/s"); }

Grasped grasp(const Grasp& setting) {
  Grasped result;
  std::unique_ptr<VirtualRig> rig;
  HandWatch watch;
  watch.count_anchoring_as_work(setting.overlaps);
  watch.exempt_penetration(setting.overlaps);
  Witness witness(setting, result, watch);
  try {
    const Scene scene =
        read_scene(SOFTHAND_SOURCE_DIR "/config/scenes/pinch_lift.toml", scene_overrides(setting.overrides));
    HandModel hand = shipped_hand();
    if (setting.hand) {
      setting.hand(hand);
      validate(hand, "hand");
    }
    rig = std::make_unique<VirtualRig>(
        scene, hand,
        std::make_unique<FaultyTracker>(
            std::make_unique<ReplayTracker>(motion_of(scene), scene.options.tracker, hand_key(scene)), setting),
        &witness);
  } catch (const ConfigError& error) {
    result.findings.refusal = error.what();
    return result;
  } catch (const std::invalid_argument& error) {
    result.findings.refusal = error.what();
    return result;
  }
  rig->run(setting.seconds, [&](const HandStepView& view) {
    const double time = seconds_since_start(view.time);
    watch.after_step(*view.simulation, view.output->report, 1 / rig->hand().options().rate_hz);
    for (const ObjectTwin& twin : view.output->coupling.twins) {
      if (twin.object != kCube) continue;
      result.twin.push_back({time, to_pose(twin.position, twin.orientation), to_vector(twin.linear_velocity).norm()});
      result.pads.push_back(
          {view.simulation->joint_pose(Joint::thumb_distal), view.simulation->joint_pose(Joint::index_distal)});
      double most = 0;
      for (const FingerContact& finger : view.output->contacts.fingers)
        most = std::max(most, to_vector(finger.force).norm());
      result.pad_forces.push_back(most);
    }
    if (setting.at_step) setting.at_step(*rig, time);
  });
  if (rig->tracking() != nullptr) result.tracking = rig->tracking()->input().counters();
  result.unconverged = watch.unconverged();
  result.hash = rig->state_hash();
  result.state = rig->hand().simulation().state();
  watch.judge(rig->hand().simulation(), result.findings);
  result.findings.demand("G4", "command to the glove", result.largest_command, kDeviceCap * (1 + 1e-9), "N",
                         Class::over_force);
  LoopStatus status;
  rig->hand().fill_status(status, VirtualRig::kStart + static_cast<Nanoseconds>(setting.seconds * 1e9));
  const bool reports = std::isfinite(status.residual) && std::isfinite(status.input_age_ms) &&
                       status.input_age_ms >= 0 && !status.counters.empty();
  result.findings.demand("G8", "status without input age, residual or counters", reports ? 0 : 1, 0, "1");
  if (setting.held) {
    const double height =
        result.world.empty() ? 0 : result.world.back().pose.position.y() - result.world.front().pose.position.y();
    result.findings.demand_at_least("held", "height of the cube above its start at the end", height * 1e3,
                                    kLifted * kLift * 1e3, "mm");
  }
  return result;
}

Findings refused(const Grasp& setting) {
  Findings findings = grasp_findings(setting);
  if (findings.refusal.empty()) findings.demand("refused at load", "loaded", 1, 0, "1");
  findings.refusal_is_right = true;
  return findings;
}

void tell_world(VirtualRig& rig, const char* key, const char* value) {
  Message message;
  message.id = 1;
  set_text(message.module, "world");
  set_text(message.key, key);
  set_text(message.value, value);
  rig.send(message);
}

}  // namespace softhand::stress
