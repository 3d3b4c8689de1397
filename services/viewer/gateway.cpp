#include "viewer/gateway.hpp"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <map>
#include <optional>
#include <string>

#include "device/answer.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/object_store.hpp"

namespace softhand::viewer {
namespace {

constexpr Nanoseconds kStatePeriod = 500'000'000;

// A reader that exists only while its topic is shown.
template <typename T>
class Feed {
 public:
  Feed(const bus::Participant& participant, const bus::Topic<T>& topic, FrameType type)
      : participant_(participant), topic_(topic), type_(type) {}

  // Calls f(const T&) for each new sample. On topics of state only the newest sample of each instance arrives.
  template <typename F>
  void take(TypeSet shown, F&& f) {
    const bool subscribes = (shown & set_of(type_)) != 0;
    if (subscribes != reader_.has_value()) {
      if (subscribes) {
        reader_.emplace(participant_, topic_);
      } else {
        reader_.reset();
      }
    }
    if (reader_) reader_->take_all(f);
  }
  FrameType type() const { return type_; }

 private:
  const bus::Participant& participant_;
  const bus::Topic<T>& topic_;
  FrameType type_;
  std::optional<bus::Reader<T>> reader_;
};

constexpr Nanoseconds kForgetHeld = 1'000'000'000;  // a hand that does not report its coupling holds nothing
constexpr std::size_t kMostFiles = 256;             // object files that are known; more than a world has objects

}  // namespace

std::uint32_t Slots::of(std::string_view name) {
  auto slot = std::find_if(slots_.begin(), slots_.end(), [name](const Slot& each) { return each.name == name; });
  if (slot == slots_.end()) {
    if (slots_.size() < kMost) slots_.emplace_back();
    slot = slots_.size() < kMost
               ? slots_.end() - 1
               : std::min_element(slots_.begin(), slots_.end(), [](auto& a, auto& b) { return a.used < b.used; });
    slot->name = name;
  }
  slot->used = ++uses_;
  return static_cast<std::uint32_t>(slot - slots_.begin());
}

class Gateway::Impl {
 public:
  Impl(const bus::Participant& participant, Server& server, std::vector<HandModel> hands, const HandKey& key,
       bool quantised, double rate_hz, std::vector<std::string> folders)
      : server_(server),
        hands_(std::move(hands)),
        key_(key),
        quantised_(quantised),
        rate_hz_(rate_hz),
        folders_(std::move(folders)),
        participant_(participant),
        messages_(participant_, bus::topics::message),
        epoch_(make_epoch()),
        clock_id_(clock_id()) {}

  void step(Nanoseconds at) {
    const TypeSet shown = server_.shown();
    // Descriptions are kept for later pages. After the first request their topics stay subscribed.
    described_ |= shown;
    pass(hand_descriptions_, described_, Retain::yes,
         [this](const HandDescription& each) { return encode(each, rest_nodes_of(each)); });
    pass(object_descriptions_, described_, Retain::yes,
         [this](const ObjectDescription& each) { return encode(each, mesh_of(each)); });
    pass(soft_descriptions_, described_, Retain::yes,
         [this](const SoftObjectDescription& each) { return encode(each, body_of(each)); });
    pass(soft_objects_, shown, Retain::no, [this](const SoftObjectState& each) { return encode(each, quantised_); });
    pass(surfaces_, shown, Retain::no, [this](const TissueSurface& each) { return encode(each, quantised_); });
    for (Feed<Skeleton>* feed : {&tracked_, &intermediate_, &simulated_})
      pass(*feed, shown, Retain::no, [feed](const Skeleton& each) { return encode(feed->type(), each); });
    pass(contacts_, shown, Retain::no, [](const Contacts& each) { return encode(each); });
    couplings_.take(shown, [this, at](const ObjectCoupling& each) { held_[instance_of(each.hand)] = {each, at}; });
    std::erase_if(held_, [at](const auto& each) { return at - each.second.at > kForgetHeld; });
    pass(objects_, shown, Retain::no, [this](const WorldObjects& each) {
      *drawn_ = each;
      for (const auto& [hand, held] : held_) draw_held(*drawn_, held.coupling);
      return encode(*drawn_);
    });
    pass(wrenches_, shown, Retain::no, [](const BoneWrench& each) { return encode(each); });
    pass(statuses_, shown, Retain::no,
         [this](const LoopStatus& each) { return encode(each, modules_.of(get_text(each.module))); });
    pass(choices_, described_, Retain::yes,
         [this](const RigChoices& each) { return encode(each, modules_.of(get_text(each.module))); });
    pass(replies_, shown, Retain::no,
         [this](const MessageReply& each) { return encode(each, modules_.of(get_text(each.module))); });
    for (Message& message : server_.take_messages()) {
      message.stamp.sequence = ++sequence_;
      message.stamp.epoch = epoch_;
      message.stamp.clock_id = clock_id_;
      message.stamp.sample_time = message.stamp.publish_time = now();
      messages_.write(message);
    }
    if (at >= next_state_) {
      next_state_ = at + kStatePeriod;
      const ServerCounters counters = server_.counters();
      const GatewayState state{at,
                               epoch_,
                               counters.pages,
                               static_cast<std::uint32_t>(rate_hz_ + 0.5),
                               counters.bytes_sent,
                               counters.frames_sent,
                               counters.frames_passed_over,
                               refused_content_,
                               counters.refused};
      if (counters.pages > 0) outgoing_.push_back({FrameType::gateway, 0, encode(state)});
    }
    if (!outgoing_.empty()) server_.publish(std::exchange(outgoing_, {}));
  }

  MessageReply answer(const Message& message, const std::string& module) {
    if (!is_addressed(message, module)) return reply_to(message, module, kReplyIgnored, "not for this module");
    if (get_text(message.key) != "prompt")
      return reply_to(message, module, kReplyIgnored, "unknown key; known: prompt");
    const std::optional<Prompt> prompt = read_prompt(get_text(message.value));
    if (!prompt)
      return reply_to(message, module, kReplyRefused, "prompt: expected seconds from 0 to 600, a space, and a text");
    outgoing_.push_back({FrameType::prompt, 0, encode(*prompt)});
    return reply_to(message, module, kReplyApplied, "shown on the pages");
  }

  void fill_status(LoopStatus& status) const {
    const ServerCounters counters = server_.counters();
    status.input_age_ms = -1;
    add_counter(status, "pages", counters.pages);
    add_counter(status, "bytes_sent", static_cast<double>(counters.bytes_sent));
    add_counter(status, "frames_sent", static_cast<double>(counters.frames_sent));
    add_counter(status, "frames_passed_over", static_cast<double>(counters.frames_passed_over));
    add_counter(status, "refused_nonfinite", static_cast<double>(refused_content_));
    for (std::size_t i = 1; i < counters.refused.size(); ++i)
      add_counter(status, "refused_" + std::string(kRefusalNames[i]), static_cast<double>(counters.refused[i]));
  }

 private:
  template <typename T, typename F>
  void pass(Feed<T>& feed, TypeSet shown, Retain retain, F&& encoded) {
    feed.take(shown, [&](const T& sample) {
      const Frame frame = encoded(sample);
      if (frame == nullptr) {
        ++refused_content_;
        return;
      }
      std::uint32_t instance = 0;
      std::memcpy(&instance, frame->data() + 12, sizeof instance);
      outgoing_.push_back({feed.type(), instance, frame, retain});
    });
  }

  const TriangleMesh* mesh_of(const ObjectDescription& description) {
    if (description.shape.file.empty() || description.removed != 0) return nullptr;
    const ShapeFile& file = description.shape.file[0];
    const ObjectModel* model = model_of(file);
    return model != nullptr && file.link < model->links.size() ? &model->links[file.link].mesh : nullptr;
  }

  const SoftBody* body_of(const SoftObjectDescription& description) {
    const ObjectModel* model = description.removed == 0 ? model_of(description.file) : nullptr;
    return model != nullptr && model->soft ? &*model->soft : nullptr;
  }

  // The content of an object file. A file that cannot be used is named once, and gives null. It may be put there later,
  // so each description tries again.
  const ObjectModel* model_of(const ShapeFile& file) {
    const std::string name(get_text(file.name)), sha256(get_text(file.sha256));
    if (files_.size() >= kMostFiles) files_.clear();  // anybody on the domain can invent names
    const auto [known, is_new] = files_.try_emplace(name + " " + sha256);
    if (!known->second) {
      try {
        known->second = find_object(name, sha256, folders_);
        if (!known->second) throw std::runtime_error("no file '" + name + std::string(kObjectSuffix) + "'");
      } catch (const std::exception& problem) {
        if (is_new) std::fprintf(stderr, "softhand-viewer: object '%s' refused: %s\n", name.c_str(), problem.what());
      }
    }
    return known->second ? &known->second->model : nullptr;
  }

  std::span<const Vector3> rest_nodes_of(const HandDescription& description) const {
    if (description.hand != key_) return {};
    for (const HandModel& hand : hands_) {
      if (description.node_count == hand.nodes.size()) return hand.nodes;
    }
    return {};
  }

  Server& server_;
  std::vector<HandModel> hands_;
  HandKey key_;
  bool quantised_;
  double rate_hz_;
  std::vector<std::string> folders_;
  std::map<std::string, std::optional<LoadedObject>> files_;  // by name and SHA-256; empty: could not be used
  const bus::Participant& participant_;
  Feed<HandDescription> hand_descriptions_{participant_, bus::topics::hand_description, FrameType::hand_description};
  Feed<ObjectDescription> object_descriptions_{participant_, bus::topics::object_description,
                                               FrameType::object_description};
  Feed<SoftObjectDescription> soft_descriptions_{participant_, bus::topics::soft_object_description,
                                                 FrameType::soft_object_description};
  Feed<SoftObjectState> soft_objects_{participant_, bus::topics::soft_object_state, FrameType::soft_object_nodes};
  Feed<TissueSurface> surfaces_{participant_, bus::topics::tissue_surface, FrameType::nodes};
  Feed<Skeleton> tracked_{participant_, bus::topics::tracked_skeleton, FrameType::tracked_skeleton};
  Feed<Skeleton> intermediate_{participant_, bus::topics::intermediate_skeleton, FrameType::intermediate_skeleton};
  Feed<Skeleton> simulated_{participant_, bus::topics::simulated_skeleton, FrameType::simulated_skeleton};
  Feed<Contacts> contacts_{participant_, bus::topics::contacts, FrameType::contacts};
  Feed<WorldObjects> objects_{participant_, bus::topics::objects, FrameType::objects};
  Feed<ObjectCoupling> couplings_{participant_, bus::topics::object_coupling, FrameType::objects};
  Feed<BoneWrench> wrenches_{participant_, bus::topics::bone_wrench, FrameType::bone_wrench};
  Feed<LoopStatus> statuses_{participant_, bus::topics::loop_status, FrameType::loop_status};
  Feed<RigChoices> choices_{participant_, bus::topics::rig_choices, FrameType::rig_choices};
  Feed<MessageReply> replies_{participant_, bus::topics::message_reply, FrameType::message_reply};
  bus::Writer<Message> messages_;
  struct Held {
    ObjectCoupling coupling;
    Nanoseconds at = 0;
  };
  std::map<std::uint32_t, Held> held_;  // newest coupling of each hand
  std::unique_ptr<WorldObjects> drawn_ = std::make_unique<WorldObjects>();
  Slots modules_;
  TypeSet described_ = 0;
  std::vector<Outgoing> outgoing_;
  std::uint64_t refused_content_ = 0;
  std::uint64_t sequence_ = 0;
  std::uint64_t epoch_;
  std::uint32_t clock_id_;
  Nanoseconds next_state_ = 0;
};

Gateway::Gateway(const bus::Participant& participant, Server& server, std::vector<HandModel> hands, const HandKey& key,
                 bool quantised, double rate_hz, std::vector<std::string> folders)
    : impl_(
          std::make_unique<Impl>(participant, server, std::move(hands), key, quantised, rate_hz, std::move(folders))) {}
Gateway::~Gateway() = default;
void Gateway::step(Nanoseconds now) { impl_->step(now); }
MessageReply Gateway::answer(const Message& message, const std::string& module) {
  return impl_->answer(message, module);
}
void Gateway::fill_status(LoopStatus& status) const { impl_->fill_status(status); }

}  // namespace softhand::viewer
