#include "service/tracker_service.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

#include "device/answer.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

constexpr double kPollRate = 1000;  // Hz
constexpr std::chrono::milliseconds kAnnouncePeriod{10};

}  // namespace

TrackerFace::TrackerFace(const Service& service, Pacing pacing, const TrackerArguments& arguments, std::uint32_t user)
    : service_(service),
      pacing_(pacing),
      user_(arguments.user.value_or(user)),
      source_(arguments.source),
      hands_(service.participant(), bus::topics::tracked_skeleton, strength_of(arguments.strength, Health::opening)),
      heads_(service.participant(), bus::topics::head_pose),
      strength_(arguments.strength),
      wanted_strength_(strength_of(arguments.strength, Health::opening)) {
  announcer_ = std::thread([this, announced = wanted_strength_.load()]() mutable {
    become_ordinary();
    while (!stop_) {
      std::this_thread::sleep_for(kAnnouncePeriod);
      const int wanted = wanted_strength_;
      if (wanted != announced) hands_.set_strength(wanted);
      announced = wanted;
    }
  });
}

TrackerFace::~TrackerFace() {
  stop_ = true;
  announcer_.join();
}

void TrackerFace::poll(TrackerSource& source, Nanoseconds now) {
  now_ = now;
  // A played motion continues without subscribers. Its samples are made only for subscribers.
  const bool is_read = hands_.has_readers();
  if (pacing_ == Pacing::simulated && started_ && !is_read) return;
  started_ = true;
  source.poll(now, *this);
  health_now_ = health_.update(now, source.state());
  wanted_strength_ = strength_of(strength_, health_now_);
}

std::optional<MessageReply> TrackerFace::answer(const Message& message, const std::string& module) {
  if (!is_addressed(message, module) || get_text(message.key) != "strength") return std::nullopt;
  const auto value = parse_number(get_text(message.value));
  if (!value || *value < 0 || *value > kMostStrength || *value != std::floor(*value))
    return reply_to(message, module, kReplyRefused, "strength: expected a whole number from 0 to 999");
  strength_ = static_cast<int>(*value);
  return reply_to(message, module, kReplyApplied, "strength set");
}

void TrackerFace::restart(TrackerSource& source, Nanoseconds begin) {
  source.restart(begin);
  started_ = true;
  // The sequence starts again. Subscribers must see a new epoch, as after a restart of the process.
  ++restarts_;
}

void TrackerFace::hand(const Skeleton& sample) {
  arrived(sample.stamp.sample_time, sample.confidence);
  confidence_ = sample.confidence;
  if (sample.confidence == 0) return;
  hand_ = sample;
  hand_.hand.user = user_;
  hand_.source = source_;
  stamp(hand_.stamp);
  hands_.write(hand_);
  ++published_;
}

void TrackerFace::head(const HeadPose& sample) {
  arrived(sample.stamp.sample_time, 1);
  if (sample.valid == 0) return;
  head_ = sample;
  head_.user = user_;
  stamp(head_.stamp);
  heads_.write(head_);
}

void TrackerFace::fill_status(const TrackerSource& source, LoopStatus& status, Nanoseconds now) const {
  status.input_age_ms = age_ms_of(newest_, now);
  add_counter(status, "health", static_cast<double>(health_now_));
  add_counter(status, "published", static_cast<double>(published_));
  add_counter(status, "user", user_);
  add_counter(status, "strength", strength_);
  add_counter(status, "confidence", confidence_);
  source.fill_status(status);
}

void TrackerFace::arrived(Nanoseconds sample_time, double confidence) {
  newest_ = sample_time;
  health_.sample(now_, confidence);
}

// The stamps of a device are real times, and those of a played motion are simulated times.
void TrackerFace::stamp(Stamp& stamp) const {
  const Nanoseconds time = stamp.sample_time;
  const bool is_real = pacing_ == Pacing::real;
  stamp.chain.tracker_sample = is_real ? time : service_.clock().when(time);
  if (is_real) stamp.sample_time = service_.clock().at(time);
  service_.stamp(stamp);
  stamp.epoch += restarts_;
  stamp.chain.tracked_published = stamp.publish_time;
}

int run_tracker(int argc, char** argv, const TrackerProgram& program) {
  return guarded_main("softhand-tracker-" + program.name, [&] {
    const TrackerArguments arguments = parse_tracker_arguments(argc, argv, program.about);
    const Scene scene = read_own_scene(arguments.config, arguments.overrides);
    Service service(arguments, kPollRate, program.pacing);
    const std::unique_ptr<TrackerSource> source = program.make_source(scene, service.participant());
    TrackerFace face(service, program.pacing, arguments, hand_key(scene).user);

    const bool is_played = program.pacing == Pacing::simulated;
    const auto answer = [&](const Message& message) {
      if (const auto reply = face.answer(message, arguments.module)) return *reply;
      if (!is_addressed(message, arguments.module))
        return reply_to(message, arguments.module, kReplyIgnored, "not for this module");
      if (!is_played || get_text(message.key) != "restart") {
        return reply_to(message, arguments.module, kReplyIgnored,
                        is_played ? "unknown key; known: strength, restart" : "unknown key; known: strength");
      }
      face.restart(*source, service.clock().at(now()));
      return reply_to(message, arguments.module, kReplyApplied, "the motion starts again");
    };
    const auto fill_status = [&](LoopStatus& status, Nanoseconds now) { face.fill_status(*source, status, now); };
    Service::Callbacks callbacks{
        .step = [&](Nanoseconds now) { face.poll(*source, now); }, .answer = answer, .fill_status = fill_status};
    // A message can be late. The motions of all trackers begin at the reset's own time nevertheless.
    if (is_played) callbacks.reset = [&](Nanoseconds begin) { face.restart(*source, begin); };
    service.run(callbacks);
  });
}

}  // namespace softhand
