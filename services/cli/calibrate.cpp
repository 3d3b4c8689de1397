#include <fmt/format.h>
#include <sys/stat.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <thread>

#include "bus/bus.hpp"
#include "cli/commands.hpp"
#include "device/hand_measurement.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "scene_file.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
constexpr Seconds kLongestWait{10};        // for the first sample
constexpr Seconds kRefresh{1};             // of the prompt, for pages that were opened meanwhile
constexpr Seconds kResult{6};              // how long the page shows the result
constexpr double kSettling = 0.4;          // part of a step in which the user changes the posture
constexpr std::size_t kFewestOfAHand = 5;  // samples in the first step; a hand with fewer passed by chance

constexpr std::array<const char*, 2> kSides{"left", "right"};

// Says what to do, in the terminal and on the viewer's page.
class Prompter {
 public:
  explicit Prompter(const bus::Participant& participant)
      : participant_(participant), messages_(participant, bus::topics::message) {}

  void show(std::string text, Seconds time) {
    text_ = std::move(text);
    until_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(time);
    fmt::print("{} ({:.1f} s)\n", text_, time.count());
    std::fflush(stdout);
    send();
  }
  void refresh() {
    if (Clock::now() - sent_ >= kRefresh) send();
  }

 private:
  void send() {
    sent_ = Clock::now();
    Message message;
    set_text(message.module, "viewer");
    set_text(message.key, "prompt");
    set_text(message.value, fmt::format("{:.1f} {}", std::max(0.0, Seconds(until_ - sent_).count()), text_));
    message.id = make_epoch();
    message.stamp.sequence = ++sequence_;
    message.stamp.epoch = participant_.epoch();
    message.stamp.clock_id = clock_id();
    message.stamp.publish_time = message.stamp.sample_time = now();
    messages_.write(message);
  }

  const bus::Participant& participant_;
  bus::Writer<Message> messages_;
  std::string text_;
  Clock::time_point until_{}, sent_{};
  std::uint64_t sequence_ = 0;
};

class Calibrator {
 public:
  explicit Calibrator(const CalibrateArguments& arguments)
      : user_(arguments.user), step_(arguments.seconds / kPostureCount) {}

  int run() {
    prompter_.show("Show your hands to the tracker", kLongestWait);
    if (!listen(kLongestWait, [](const Skeleton&) { return true; }))
      throw std::runtime_error(fmt::format("no hand of user {} within {:.0f} s; `softhand trackers` lists the trackers",
                                           user_, kLongestWait.count()));
    for (std::size_t step = 0; step < kPostureCount; ++step) {
      const auto posture = static_cast<Posture>(step);
      prompter_.show(fmt::format("{}/{} {}", step + 1, kPostureCount, kPosturePrompts[step]), step_);
      const auto from = Clock::now() + std::chrono::duration_cast<Clock::duration>(kSettling * step_);
      listen(step_, [&](const Skeleton& sample) {
        if (Clock::now() >= from && hands_[sample.hand.side]) hands_[sample.hand.side]->add(posture, sample);
        return false;
      });
      end_step(posture);
    }
    for (std::size_t side = 0; side < hands_.size(); ++side) attempt(side, [&] { save(side); });
    prompter_.show(refused_ == 0 ? "Done: restart the rig to use your hand" : "Refused: the terminal says why",
                   kResult);
    return refused_ == 0 ? 0 : 1;
  }

 private:
  // Passes on samples until `is_last` returns true, which is returned, or the time is over.
  template <typename IsLast>
  bool listen(Seconds time, IsLast&& is_last) {
    bool ended = false;
    for (const auto end = Clock::now() + time; !ended && Clock::now() < end;) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      prompter_.refresh();
      samples_.take_all([&](const Skeleton& sample) {
        if (sample.hand.user == user_ && sample.hand.side < hands_.size()) ended = is_last(sample) || ended;
      });
    }
    return ended;
  }

  void end_step(Posture posture) {
    for (std::size_t side = 0; side < hands_.size(); ++side) {
      if (posture == Posture::flat && hands_[side]->samples(posture) < kFewestOfAHand) hands_[side].reset();
      attempt(side, [&] { hands_[side]->check(posture); });
    }
    if (hands_[0] || hands_[1]) return;
    prompter_.show("Refused: the terminal says why", kResult);
    throw std::runtime_error(
        refused_ > 0
            ? "nothing was saved"
            : "step 1 of 4 (flat hand): no hand was seen. Hold it where the tracker sees all of it, and start again");
  }

  // A hand that is refused is left out from then on.
  template <typename Part>
  void attempt(std::size_t side, Part&& part) {
    if (!hands_[side]) return;
    try {
      part();
    } catch (const std::exception& problem) {
      fmt::print(stderr, "softhand calibrate: the {} hand is refused: {}\n", kSides[side], problem.what());
      hands_[side].reset();
      ++refused_;
    }
  }

  void save(std::size_t side) {
    const UserHand user = hands_[side]->measure(static_cast<Side>(side));
    // A process that starts later must be able to use it, whatever hand its scene has.
    for (const char* const size : kHandSizes) {
      HandModel hand = load_hand((fs::path(SOFTHAND_CONFIG_DIR) / "hands" / size).string());
      if (hand.side != static_cast<Side>(side)) hand = mirrored(hand);
      fitted(hand, user);
    }
    const fs::path path = user_hand_path({user_, static_cast<std::uint32_t>(side)});
    if (path.empty()) throw std::runtime_error("neither XDG_DATA_HOME nor HOME is an absolute path");
    umask(S_IRWXG | S_IRWXO);  // as the XDG specification says
    fs::create_directories(path.parent_path());
    const fs::path fresh = path.string() + ".new";
    std::ofstream file(fresh);
    file << user_hand_text(user) << std::flush;
    if (!file) throw std::runtime_error("cannot write " + fresh.string());
    fs::rename(fresh, path);
    fmt::print("the {} hand of user {} is in {}\n", kSides[side], user_, path.string());
  }

  std::uint32_t user_;
  Seconds step_;
  bus::Participant participant_{"softhand calibrate"};
  bus::Reader<Skeleton> samples_{participant_, bus::topics::tracked_skeleton};
  Prompter prompter_{participant_};
  std::array<std::optional<HandMeasurement>, 2> hands_{HandMeasurement{}, HandMeasurement{}};
  int refused_ = 0;
};

}  // namespace

int run_calibrate(const CalibrateArguments& arguments) { return Calibrator(arguments).run(); }

}  // namespace softhand
