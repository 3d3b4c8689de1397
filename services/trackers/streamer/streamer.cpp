#include "trackers/streamer/streamer.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kFarthest = 1000;       // m
constexpr double kLongestHand = 0.5;     // m from the wrist
constexpr double kUnitTolerance = 0.02;  // the app rounds quaternions to three decimals
constexpr std::size_t kLongestNumber = 24;

bool skip(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

template <typename Number>
bool take_number(std::string_view& text, Number& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (error != std::errc{}) return false;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return true;
}

// A number with a decimal point, or with a decimal comma: the app follows the language of the headset. Fewer decimals
// than the app writes mean that the packet was cut there.
bool parse_decimal(std::string_view text, std::size_t decimals, double& out) {
  std::array<char, kLongestNumber> copy;
  const std::size_t point = text.find_first_of(".,");
  if (point == std::string_view::npos || text.size() - point - 1 < decimals || text.size() > copy.size()) return false;
  std::replace_copy(text.begin(), text.end(), copy.begin(), ',', '.');
  const auto [end, error] = std::from_chars(copy.data(), copy.data() + text.size(), out, std::chars_format::fixed);
  return error == std::errc{} && end == copy.data() + text.size();
}

// `count` numbers, each after ", ".
template <std::size_t count>
bool parse_numbers(std::string_view text, std::size_t decimals, std::array<double, count>& out) {
  for (double& value : out) {
    if (!skip(text, ", ")) return false;
    const std::size_t end = std::min(text.find(", "), text.size());
    if (!parse_decimal(text.substr(0, end), decimals, value)) return false;
    text.remove_prefix(end);
  }
  return text.empty();
}

// Unity is left-handed with +Z forward. The world's -Z is forward.
Vector3 from_unity(double x, double y, double z) { return {x, y, -z}; }

StreamerRefusal parse_pose(std::string_view text, Pose& out) {
  std::array<double, 7> v;
  if (!parse_numbers(text, 3, v)) return StreamerRefusal::numbers;
  out.position = from_unity(v[0], v[1], v[2]);
  out.orientation = Quaternion(v[6], -v[3], -v[4], v[5]);
  const double norm = out.orientation.norm();
  if (!(out.position.cwiseAbs().maxCoeff() <= kFarthest) || !(std::abs(norm - 1) < kUnitTolerance))
    return StreamerRefusal::content;
  out.orientation.normalize();
  return StreamerRefusal::none;
}

}  // namespace

StreamerRefusal decode_streamer_line(std::string_view text, StreamerLine& out) {
  if (skip(text, "Head pose")) {
    out.kind = StreamerLine::Kind::head;
  } else {
    if (skip(text, "Left ")) {
      out.side = Side::left;
    } else if (skip(text, "Right ")) {
      out.side = Side::right;
    } else {
      return StreamerRefusal::label;
    }
    if (skip(text, "wrist")) {
      out.kind = StreamerLine::Kind::wrist;
    } else if (skip(text, "landmarks")) {
      out.kind = StreamerLine::Kind::landmarks;
    } else {
      return StreamerRefusal::label;
    }
  }
  out.sent.reset();
  if (skip(text, " | f = ")) {
    std::uint64_t frame = 0;
    Nanoseconds sent = 0;
    if (!take_number(text, frame) || !skip(text, " | t = ") || !take_number(text, sent)) return StreamerRefusal::label;
    // Less than a century since the start of the headset: no difference of two such times overflows.
    if (sent <= 0 || sent > 3'000'000'000'000'000'000) return StreamerRefusal::content;
    out.sent = sent;
  }
  if (!skip(text, ":")) return StreamerRefusal::label;
  if (out.kind != StreamerLine::Kind::landmarks) return parse_pose(text, out.pose);
  std::array<double, 3 * kLandmarkCount> v;
  if (!parse_numbers(text, 4, v)) return StreamerRefusal::numbers;
  for (std::size_t i = 0; i < kLandmarkCount; ++i) {
    out.landmarks[i] = from_unity(v[3 * i], v[3 * i + 1], v[3 * i + 2]);
    if (!(out.landmarks[i].norm() <= kLongestHand)) return StreamerRefusal::content;
  }
  return StreamerRefusal::none;
}

bool mend_little_finger(Landmarks& points) {
  // The knuckle of the little finger is about as far from the wrist as that of the ring finger. The base of its
  // metacarpal is half as far.
  const double little = (points[17] - points[0]).norm(), ring = (points[13] - points[0]).norm();
  if (!(little < 0.65 * ring)) return false;
  for (std::size_t i = 17; i < 20; ++i) points[i] = points[i + 1];
  points[20] = points[19] + 0.8 * (points[19] - points[18]);
  return true;
}

StreamerDecoder::StreamerDecoder(const HandModel& hand)
    : lifters_{LandmarkLifter(hand, Side::left), LandmarkLifter(hand, Side::right)} {}

void StreamerDecoder::take(const Arrival& packet, TrackerSink& out) {
  const bool is_datagram = packet.connection == 0;
  if (is_datagram) wrist_of(0).waits = false;
  std::string_view rest = packet.bytes;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty()) continue;
    if (!refusals_.accepted(take_line(line, packet, out))) {
      // What follows in the stream or datagram needs a new wrist.
      wrist_of(packet.connection).waits = false;
      if (is_datagram) return;
    }
  }
  if (is_datagram && wrist_of(0).waits) refusals_.accepted(StreamerRefusal::unpaired);
}

StreamerRefusal StreamerDecoder::take_line(std::string_view text, const Arrival& packet, TrackerSink& out) {
  if (const StreamerRefusal refusal = decode_streamer_line(text, line_); refusal != StreamerRefusal::none)
    return refusal;
  Wrist& wrist = wrist_of(packet.connection);
  switch (line_.kind) {
    case StreamerLine::Kind::wrist: {
      const bool lacks_landmarks = wrist.waits;
      wrist.line = line_;
      wrist.waits = true;
      if (!lacks_landmarks) return StreamerRefusal::none;
      // The earlier wrist is refused, not this one.
      refusals_.accepted(StreamerRefusal::unpaired);
      return StreamerRefusal::none;
    }
    case StreamerLine::Kind::landmarks:
      if (!wrist.waits || wrist.line.side != line_.side) return StreamerRefusal::unpaired;
      wrist.waits = false;
      return take_landmarks(wrist.line, packet, out);
    case StreamerLine::Kind::head:
      break;
  }
  const auto time = time_of(line_, packet.time, 2);
  if (!time) return StreamerRefusal::order;
  head_.stamp.sample_time = *time;
  head_.stamp.sequence = ++sequence_[2];
  head_.position = to_wire(line_.pose.position);
  head_.orientation = to_wire(line_.pose.orientation);
  head_.valid = 1;
  out.head(head_);
  return StreamerRefusal::none;
}

StreamerRefusal StreamerDecoder::take_landmarks(const StreamerLine& wrist, const Arrival& packet, TrackerSink& out) {
  const auto side = static_cast<std::size_t>(wrist.side);
  Landmarks& points = line_.landmarks;
  const bool lacks_tip = mend_little_finger(points);
  for (Vector3& point : points) point = wrist.pose * point;
  if (!lifters_[side].lift(points, hand_)) return StreamerRefusal::shape;
  const auto time = time_of(wrist, packet.time, side);
  if (!time) return StreamerRefusal::order;
  for (const Joint joint : {Joint::little_distal, Joint::little_tip}) {
    JointSample& guessed = hand_.joints[static_cast<std::size_t>(index_of(joint))];
    if (lacks_tip) guessed.flags = kJointValid | kJointInferred;
    guessed.confidence = lacks_tip ? kGuessedConfidence : 1;
  }
  hand_.hand.side = static_cast<std::uint32_t>(side);
  hand_.confidence = 1;  // the app sends nothing while it does not see the hand
  hand_.stamp.sample_time = *time;
  hand_.stamp.sequence = ++sequence_[side];
  out.hand(hand_);
  return StreamerRefusal::none;
}

std::optional<Nanoseconds> StreamerDecoder::time_of(const StreamerLine& line, Nanoseconds arrival, std::size_t track) {
  Nanoseconds& last = last_[track];
  if (!line.sent) return last = std::max(last + 1, arrival);
  if (clock_.add(*line.sent, arrival)) sent_ = {};
  if (sent_[track] && *line.sent <= *sent_[track]) return std::nullopt;
  sent_[track] = line.sent;
  // Keep the times ascending, even if a better estimate of the offset would move them back.
  return last = std::max(last + 1, std::min(clock_.map(*line.sent), arrival));
}

StreamerDecoder::Wrist& StreamerDecoder::wrist_of(std::uint64_t connection) {
  const auto found =
      std::find_if(wrists_.begin(), wrists_.end(), [&](const Wrist& wrist) { return wrist.connection == connection; });
  if (found != wrists_.end()) return *found;
  // The place of the oldest connection. The first place belongs to UDP.
  Wrist& oldest = *std::min_element(wrists_.begin() + 1, wrists_.end(),
                                    [](const Wrist& a, const Wrist& b) { return a.connection < b.connection; });
  oldest = Wrist{};
  oldest.connection = connection;
  return oldest;
}

}  // namespace softhand
