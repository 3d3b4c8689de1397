#include "cli/topic_recording.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "bus/topics.hpp"
#include "cli/idl_text.hpp"
#include "runtime/clock.hpp"

namespace softhand {
namespace {

constexpr int kRecordedHistory = 64;

std::string last_part(std::string_view name) { return std::string(name.substr(name.rfind('/') + 1)); }

void refuse_unknown(const std::vector<std::string>& topics) {
  std::vector<std::string> known;
  bus::topics::for_each([&known](const auto& topic) { known.push_back(last_part(topic.name)); });
  for (const std::string& topic : topics) {
    if (std::find(known.begin(), known.end(), topic) != known.end()) continue;
    std::string list;
    for (const std::string& name : known) list += (list.empty() ? "" : ", ") + name;
    throw std::invalid_argument("unknown topic '" + topic + "'; expected one of: " + list);
  }
}

bool chosen(const std::vector<std::string>& topics, std::string_view name) {
  return topics.empty() || std::find(topics.begin(), topics.end(), last_part(name)) != topics.end();
}

}  // namespace

struct TopicRecorder::Lane {
  virtual ~Lane() = default;
  virtual void poll(RecordWriter& file) = 0;
  virtual bus::ReaderCounters counters() const = 0;
  std::string name;
  std::uint64_t messages = 0;
};

TopicRecorder::TopicRecorder(const bus::Participant& participant, const std::string& path,
                             const std::vector<std::string>& topics)
    : file_((refuse_unknown(topics), path)) {
  bus::topics::for_each([&]<typename T>(const bus::Topic<T>& topic) {
    if (!chosen(topics, topic.name)) return;
    struct LaneOf final : Lane {
      explicit LaneOf(bus::Reader<T> r) : reader(std::move(r)), bytes(bus::max_encoded_size<T>()) {}
      void poll(RecordWriter& file) override {
        reader.take_all([&](const T& message) {
          const std::size_t size = bus::encode(message, bytes);
          file.write(channel, static_cast<std::uint32_t>(message.stamp.sequence), now(), message.stamp.publish_time,
                     {bytes.data(), size});
          ++messages;
        });
      }
      bus::ReaderCounters counters() const override { return reader.counters(); }
      bus::Reader<T> reader;
      std::uint16_t channel = 0;
      std::vector<std::byte> bytes;
    };
    auto lane = std::make_unique<LaneOf>(bus::Reader<T>(participant, with_history(topic, kRecordedHistory)));
    lane->name = last_part(topic.name);
    lane->channel = file_.add_channel({std::string(topic.name), "cdr", topic.type, "omgidl", idl_of(topic.type)});
    lanes_.push_back(std::move(lane));
  });
}

TopicRecorder::~TopicRecorder() = default;

void TopicRecorder::poll() {
  for (auto& lane : lanes_) lane->poll(file_);
}

void TopicRecorder::finish() { file_.finish(); }

std::map<std::string, TopicCount> TopicRecorder::counts() const {
  std::map<std::string, TopicCount> counts;
  for (const auto& lane : lanes_)
    counts[lane->name] = {lane->messages, lane->counters().lost, lane->counters().refused};
  return counts;
}

struct TopicPlayer::Lane {
  virtual ~Lane() = default;
  virtual void publish(std::span<const std::byte> payload, const std::function<void(Stamp&)>& restamp) = 0;
  TopicCount count;
};

TopicPlayer::TopicPlayer(const bus::Participant& participant, const std::string& path,
                         const std::vector<std::string>& topics, double speed)
    : file_((refuse_unknown(topics), path)), speed_(speed), epoch_(make_epoch()), clock_id_(clock_id()) {
  if (!(speed > 0)) throw std::invalid_argument("speed must be above 0");
  // The first pass finds the topics of the file. Discovery of a writer takes time, so all writers are created before
  // the first message is due.
  RecordReader survey(path);
  RecordedMessage message;
  std::map<std::string, RecordReader::Channel> present;
  bool any = false;
  while (survey.next(message)) {
    const RecordReader::Channel& channel = survey.channels().at(message.channel);
    if (!chosen(topics, channel.topic)) continue;
    present[channel.topic] = channel;
    if (!any) first_time_ = message.log_time;
    any = true;
    last_time_ = std::max(last_time_, message.log_time);
  }
  truncated_ = survey.truncated();
  bus::topics::for_each([&]<typename T>(const bus::Topic<T>& topic) {
    const auto channel = present.find(std::string(topic.name));
    if (channel == present.end()) return;
    if (channel->second.message_encoding != "cdr" || channel->second.schema->name != topic.type) {
      throw std::runtime_error(path + ": " + channel->first + " holds " + channel->second.schema->name + " as " +
                               channel->second.message_encoding + "; expected " + topic.type + " as cdr");
    }
    struct LaneOf final : Lane {
      explicit LaneOf(bus::Writer<T> w) : writer(std::move(w)) {}
      void publish(std::span<const std::byte> payload, const std::function<void(Stamp&)>& restamp) override {
        if (!bus::decode(payload, *content)) {
          ++count.refused;
          *content = T{};
          return;
        }
        restamp(content->stamp);
        writer.write(*content);
        ++count.messages;
      }
      bus::Writer<T> writer;
      std::unique_ptr<T> content = std::make_unique<T>();
    };
    lanes_[std::string(topic.name)] = std::make_unique<LaneOf>(bus::Writer<T>(participant, topic));
  });
  if (lanes_.empty()) throw std::invalid_argument(path + ": contains no message of the chosen topics");
  at_end_ = !advance();
}

TopicPlayer::~TopicPlayer() = default;

bool TopicPlayer::advance() {
  while (file_.next(next_)) {
    if (lanes_.count(file_.channels().at(next_.channel).topic) > 0) return true;
  }
  return false;
}

Nanoseconds TopicPlayer::moved(Nanoseconds recorded) const {
  if (recorded == 0) return 0;  // 0 means unknown
  return start_ + static_cast<Nanoseconds>(std::llround(static_cast<double>(recorded - first_time_) / speed_));
}

Nanoseconds TopicPlayer::next_due() const { return moved(next_.log_time); }

bool TopicPlayer::play(Nanoseconds now) {
  if (start_ == 0) start_ = now;
  const auto restamp = [this](Stamp& stamp) {
    stamp.epoch ^= epoch_;
    stamp.clock_id = clock_id_;
    for (Nanoseconds* time :
         {&stamp.sample_time, &stamp.publish_time, &stamp.chain.tracker_sample, &stamp.chain.tracked_published,
          &stamp.chain.intermediate_published, &stamp.chain.simulated_published, &stamp.chain.wrench_published}) {
      *time = moved(*time);
    }
  };
  while (!at_end_ && next_due() <= now) {
    lanes_.at(file_.channels().at(next_.channel).topic)->publish(next_.payload, restamp);
    at_end_ = !advance();
  }
  return !at_end_;
}

std::map<std::string, TopicCount> TopicPlayer::counts() const {
  std::map<std::string, TopicCount> counts;
  for (const auto& [name, lane] : lanes_) counts[last_part(name)] = lane->count;
  return counts;
}

}  // namespace softhand
