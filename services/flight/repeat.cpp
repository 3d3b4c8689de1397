#include "flight/repeat.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "flight/hand_flight.hpp"
#include "flight/tracking_flight.hpp"
#include "flight/world_flight.hpp"
#include "hand/object_shapes.hpp"
#include "math/instruction_set.hpp"
#include "runtime/record_file.hpp"

namespace softhand {
namespace {

using Print = std::function<void(const std::string&)>;

/// Repeats the records of one loop.
template <typename Loop>
class Repetition {
 public:
  using Traits = FlightTraits<Loop>;
  using MakeLoop = std::function<std::unique_ptr<Loop>()>;
  Repetition(MakeLoop make_loop, const RepeatOptions& options, bool within_tolerance, const Print& print)
      : make_loop_(std::move(make_loop)), options_(options), within_tolerance_(within_tolerance), print_(print) {}

  void take(Nanoseconds now, std::span<const std::byte> payload) {
    ByteReader in(payload);
    const auto kind = in.take<std::uint8_t>();
    if (kind == kFlightSnapshot) return begin(now, in);
    if (!loop_) throw std::runtime_error("the flight file does not begin with a snapshot");
    switch (kind) {
      case kFlightResult:
        return compare(now, in);
      case kFlightMessage: {
        const auto message = in.take<Message>();
        loop_->answer(message, in.take<std::string>());
        if (!options_.brief)
          print_(fmt::format("{}  message {} {}", seconds(now), get_text(message.key), get_text(message.value)));
        return;
      }
      case kFlightReset:
        loop_->reset(in.take<Nanoseconds>());
        if (!options_.brief) print_(fmt::format("{}  reset", seconds(now)));
        return;
      case kFlightStep:
        repeater_.step(*loop_, now, in);
        ++result_.steps;
        return;
      default:
        return repeater_.describe(*loop_, kind, in);
    }
  }
  RepeatResult& result() { return result_; }

 private:
  std::string seconds(Nanoseconds now) {
    if (start_ == 0) start_ = now;
    return fmt::format("{:10.4f} s", static_cast<double>(now - start_) * 1e-9);
  }

  // The snapshot is the state of the run that is repeated, as far as no record is missing.
  void begin(Nanoseconds now, ByteReader& in) {
    const bool continues = in.take<bool>();
    const std::span<const std::byte> bytes = in.rest();
    ++result_.snapshots;
    std::string equal = "no state before it";
    if (loop_ && continues && !within_tolerance_) {
      memory_.resize(bytes.size() + 1);
      ByteWriter out(memory_);
      Traits::save(*loop_, out);
      const bool is_equal = !out.overflowed() && std::ranges::equal(out.written(), bytes);
      if (!is_equal) ++result_.different_snapshots;
      equal = is_equal ? "equal"
                       : fmt::format("DIFFERS from byte {}",
                                     std::ranges::mismatch(out.written(), bytes).in2 - bytes.begin());
    }
    print_(fmt::format("{}  snapshot of {} bytes: {}", seconds(now), bytes.size(), equal));
    loop_ = make_loop_();
    Traits::load(*loop_, in);
    Traits::forget(*loop_);
  }

  void compare(Nanoseconds now, ByteReader& in) {
    const auto recorded = in.take<FlightResult>();
    const FlightResult repeated = flight_result(*loop_);
    ++result_.compared;
    std::string difference;
    if (recorded.status != repeated.status)
      difference = fmt::format("status was {}, is {}", Traits::status_text(recorded.status),
                               Traits::status_text(repeated.status));
    if (within_tolerance_) {
      for (std::size_t k = 0; k < recorded.figures.size() && difference.empty(); ++k)
        if (!(std::abs(recorded.figures[k] - repeated.figures[k]) <= Traits::kTolerances[k]))
          difference =
              fmt::format("{} was {:.9g}, is {:.9g}", Traits::kFigures[k], recorded.figures[k], repeated.figures[k]);
    } else {
      std::size_t part = 0;
      loop_->for_each_part([&](const char* name, const auto&) {
        if (difference.empty() && recorded.hashes.at(part) != repeated.hashes.at(part))
          difference = fmt::format("{} differs", name);
        ++part;
      });
    }
    if (!difference.empty()) ++result_.different;
    if (options_.brief && difference.empty()) return;
    // After the first differences, all later states differ too.
    if (!difference.empty() && result_.different > kMostDifferences) return;
    print_(fmt::format("{}  {:<20} {}", seconds(now), Traits::status_text(recorded.status),
                       !difference.empty() ? "DIFFERENT: " + difference
                       : within_tolerance_ ? "within the tolerance"
                                           : "equal"));
  }

  static constexpr std::uint64_t kMostDifferences = 20;
  MakeLoop make_loop_;
  const RepeatOptions& options_;
  bool within_tolerance_;
  const Print& print_;
  std::unique_ptr<Loop> loop_;
  typename Traits::Repeater repeater_;
  RepeatResult result_;
  Nanoseconds start_ = 0;
  std::vector<std::byte> memory_;
};

template <typename Loop>
RepeatResult repeat_records(RecordReader& file, typename Repetition<Loop>::MakeLoop make_loop,
                            const RepeatOptions& options, bool within_tolerance, const Print& print) {
  Repetition<Loop> repetition(std::move(make_loop), options, within_tolerance, print);
  RecordedMessage record;
  while (file.next(record)) repetition.take(record.log_time, record.payload);
  if (repetition.result().steps == 0) throw std::runtime_error(options.path + ": has no step");
  return repetition.result();
}

}  // namespace

RepeatResult repeat_flight(const RepeatOptions& options, const Print& print) {
  RecordReader file(options.path);
  RecordedMessage record;
  if (!file.next(record) || file.channels().at(record.channel).topic != kFlightHeaderTopic)
    throw std::runtime_error(options.path + ": is not a flight file");
  const FlightHeader header =
      flight_header_from_json(std::string(reinterpret_cast<const char*>(record.payload.data()), record.payload.size()));
  const std::string here(to_string(widest_instruction_set()));
  std::string foreign;
  if (header.build != kFlightBuild)
    foreign = fmt::format("was written by build {}, this is build {}", header.build, kFlightBuild);
  else if (header.instruction_set != here)
    foreign = fmt::format("was written on a processor with {}, this one has {}", header.instruction_set, here);
  if (!foreign.empty() && !options.force)
    throw std::runtime_error(
        fmt::format("{}: {}. Such a run has other bits. --force repeats it and compares within a "
                    "tolerance",
                    options.path, foreign));
  const bool within_tolerance = !foreign.empty();
  const std::vector<Scene> scenes = scenes_of(header);
  const Scene& scene = scenes.front();
  std::vector<KeyedHand> hands;
  for (std::size_t h = 0; h < header.hands.size(); ++h) {
    hands.push_back({load_scene_hand(scenes[h]), hand_key(scenes[h])});
    if (const std::string hash = hash_text(hands[h].model); hash != header.hands[h])
      throw std::runtime_error(fmt::format("{}: the hand {} has changed since: its hash is {}, expected {}",
                                           options.path, scene.options.hand.model, hash, header.hands[h]));
  }
  if (hands.empty() && header.loop != "world") throw std::runtime_error(options.path + ": names no hand");
  print(fmt::format("{}: {} of scene {}; {}", options.path, header.module, header.scene,
                    foreign.empty() ? "same build and processor" : foreign));
  RepeatResult result;
  if (header.loop == "hand") {
    result = repeat_records<HandLoop>(
        file,
        [&] {
          auto loop = std::make_unique<HandLoop>(hands, scene.options.hand, object_spring(scene.options.world),
                                                 scene.soft_objects);
          loop->use_file_shapes(
              [folders = object_folders(scene)](const ShapeFile& shape) { return load_shape(shape, folders); });
          return loop;
        },
        options, within_tolerance, print);
  } else if (header.loop == "tracking") {
    result = repeat_records<TrackingLoop>(
        file,
        [&] {
          return std::make_unique<TrackingLoop>(scene.options.tracking, scene.options.hand.rate_hz, hands[0].model,
                                                hands[0].key);
        },
        options, within_tolerance, print);
  } else if (header.loop == "world") {
    result = repeat_records<WorldLoop>(
        file,
        [&] {
          return std::make_unique<WorldLoop>(scene.options.world, scene.options.objects, 1 / scene.options.hand.rate_hz,
                                             scene.options.joints, scene.soft_objects);
        },
        options, within_tolerance, print);
  } else {
    throw std::runtime_error(options.path + ": unknown loop '" + header.loop + "'");
  }
  result.reason = header.reason;
  print(fmt::format("written because: {}", result.reason));
  print(fmt::format("{} steps repeated from {} snapshots, {} compared: {} different states, {} different snapshots{}",
                    result.steps, result.snapshots, result.compared, result.different, result.different_snapshots,
                    file.truncated() ? "; the file was cut off" : ""));
  return result;
}

}  // namespace softhand
