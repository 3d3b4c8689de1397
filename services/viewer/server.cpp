#include "viewer/server.hpp"

#include <algorithm>
#include <atomic>
#include <deque>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <sstream>
#include <utility>

#include "device/answer.hpp"
#include "runtime/clock.hpp"
#include "web/web_server.hpp"

namespace softhand::viewer {
namespace {

constexpr std::size_t kLargestRequest = 4096;      // bytes, message from a page
constexpr std::size_t kWaitingMessages = 64;       // limit of messages that the gateway's loop has not taken yet
constexpr std::size_t kMostConnections = 64;       // besides the pages' streams: a browser opens six for the files
constexpr std::size_t kMostRetained = 512;         // descriptions; more than the topics have instances
constexpr std::size_t kMostStreams = 1024;         // of a page
constexpr std::uint64_t kRefusalsOfOnePage = 100;  // then the page is closed
constexpr double kSlowest = 0.01;                  // Hz, lowest rate that a page may request
constexpr int kPorts = 11;                         // number of ports that are tried

struct File {
  std::string body;
  std::string_view type;
};

std::string_view media_type(const std::filesystem::path& path) {
  static const std::map<std::string, std::string_view> types{{".html", "text/html; charset=utf-8"},
                                                             {".js", "text/javascript; charset=utf-8"},
                                                             {".css", "text/css; charset=utf-8"},
                                                             {".svg", "image/svg+xml"},
                                                             {".map", "application/json"},
                                                             {".txt", "text/plain; charset=utf-8"},
                                                             {".png", "image/png"},
                                                             {".webmanifest", "application/manifest+json"}};
  const auto found = types.find(path.extension().string());
  return found == types.end() ? "application/octet-stream" : found->second;
}

// Reads all files once. Therefore no request can reach a path outside the folder.
std::map<std::string, File> read_files(const std::string& folder) {
  std::map<std::string, File> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder, error)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream in(entry.path(), std::ios::binary);
    std::stringstream body;
    body << in.rdbuf();
    files["/" + std::filesystem::relative(entry.path(), folder).generic_string()] = {body.str(),
                                                                                     media_type(entry.path())};
  }
  if (const auto index = files.find("/index.html"); index != files.end()) files["/"] = index->second;
  return files;
}

// State that all pages share. Only the server's thread uses it, except the atomics and the members behind the mutex.
struct Shared {
  std::map<std::string, File> files;
  struct Retained {
    Frame frame;
    std::uint64_t order = 0;  // grows with each frame
  };
  std::map<std::pair<FrameType, std::uint32_t>, Retained> retained;
  std::uint64_t retained_frames = 0;

  std::atomic<TypeSet> shown{0};
  std::atomic<std::uint32_t> pages{0};
  std::atomic<std::uint64_t> bytes_sent{0};
  std::atomic<std::uint64_t> frames_sent{0};
  std::atomic<std::uint64_t> frames_passed_over{0};
  std::array<std::atomic<std::uint64_t>, kRefusalNames.size()> refused{};
  std::mutex mutex;
  std::vector<Message> messages;

  // Anybody on the domain can invent instances. The one that was silent for the longest time makes room.
  void retain(const Outgoing& each) {
    retained[{each.type, each.instance}] = {each.frame, ++retained_frames};
    if (retained.size() <= kMostRetained) return;
    retained.erase(std::min_element(retained.begin(), retained.end(),
                                    [](const auto& a, const auto& b) { return a.second.order < b.second.order; }));
  }

  void refuse(Refusal why) { refused[static_cast<std::size_t>(why)].fetch_add(1, std::memory_order_relaxed); }
};

class Page : public web::Session {
 public:
  Page(Shared& shared, double rate_hz, bool may_control, std::function<void()> show_changed)
      : shared_(shared), rate_hz_(rate_hz), may_control_(may_control), show_changed_(std::move(show_changed)) {}

  TypeSet types() const { return socket_ != nullptr ? show_.types : 0; }
  bool gone() const { return gone_; }
  bool may_control() const { return may_control_; }

  void opened(web::Socket& socket) override { socket_ = &socket; }

  void offer(const Outgoing& outgoing) {
    if (socket_ == nullptr || (outgoing.type != FrameType::gateway && (show_.types & set_of(outgoing.type)) == 0))
      return;
    if (outgoing.type == FrameType::message_reply) {
      // Replies are not state, so they do not replace each other. A page that does not take them loses the oldest.
      replies_.push_back(outgoing.frame);
      if (replies_.size() > kWaitingMessages) replies_.pop_front();
      return;
    }
    const std::pair key{outgoing.type, outgoing.instance};
    // Anybody on the domain can invent instances.
    if (streams_.size() >= kMostStreams && !streams_.contains(key)) {
      shared_.frames_passed_over.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    Frame& waiting = streams_[key].waiting;
    if (waiting != nullptr) shared_.frames_passed_over.fetch_add(1, std::memory_order_relaxed);
    waiting = outgoing.frame;
  }

  void flush(Nanoseconds at) {
    if (socket_ == nullptr || sending_ > 0 || closing_) return;
    const double asked = show_.rate_hz > 0 ? show_.rate_hz : rate_hz_;
    const auto period = static_cast<Nanoseconds>(1e9 / std::clamp(asked, kSlowest, rate_hz_));
    std::vector<web::Bytes> frames;
    for (auto& [key, stream] : streams_) {
      if (stream.waiting == nullptr || at < stream.due) continue;
      frames.push_back(std::exchange(stream.waiting, nullptr));
      // A sample that is late by up to a period does not delay the next one. So a stream of exactly this rate loses no
      // sample although its times are uneven.
      stream.due = std::max(stream.due, at - period) + period;
    }
    // Streams that rest make room for others.
    if (streams_.size() >= kMostStreams)
      std::erase_if(streams_,
                    [at](const auto& each) { return each.second.waiting == nullptr && at >= each.second.due; });
    frames.insert(frames.end(), replies_.begin(), replies_.end());
    replies_.clear();
    if (frames.empty()) return;
    sending_ = frames.size();
    socket_->send(std::move(frames));
  }

  void sent(std::size_t bytes) override {
    shared_.bytes_sent.fetch_add(bytes, std::memory_order_relaxed);
    shared_.frames_sent.fetch_add(std::exchange(sending_, 0), std::memory_order_relaxed);
    flush(now());
  }

  void received(std::string_view bytes, bool binary) override {
    PageRequest request;
    Refusal refusal =
        binary ? decode({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, request) : Refusal::type;
    if (refusal == Refusal::none) {
      if (const auto* show = std::get_if<ShowRequest>(&request)) {
        change_show(*show);
      } else if (!may_control_) {
        refusal = Refusal::token;
        answer_without_token(std::get<Message>(request));
      } else {
        const std::lock_guard lock(shared_.mutex);
        if (shared_.messages.size() < kWaitingMessages) {
          shared_.messages.push_back(std::get<Message>(request));
        } else {
          refusal = Refusal::flood;
        }
      }
    }
    if (refusal == Refusal::none) return;
    shared_.refuse(refusal);
    if (++refusals_ < kRefusalsOfOnePage) return;
    closing_ = true;
    socket_->close();
  }

  void closed(bool too_large) override {
    if (too_large) shared_.refuse(Refusal::size);
    socket_ = nullptr;
    gone_ = true;
    show_changed_();
  }

 private:
  void change_show(const ShowRequest& show) {
    const TypeSet fresh = show.types & ~show_.types;
    show_ = show;
    std::erase_if(streams_, [this](const auto& stream) {
      const FrameType type = stream.first.first;
      return type != FrameType::gateway && (show_.types & set_of(type)) == 0;
    });
    for (const auto& [key, retained] : shared_.retained) {
      if ((fresh & set_of(key.first)) != 0) offer({key.first, key.second, retained.frame});
    }
    show_changed_();
    flush(now());
  }

  void answer_without_token(const Message& message) {
    const MessageReply reply = reply_to(message, "viewer", kReplyRefused,
                                        "other machines need the token: open the address that the viewer printed");
    offer({FrameType::message_reply, 0, encode(reply, 0)});
    flush(now());
  }

  struct Stream {
    Frame waiting;  // the newest frame, until it is sent
    Nanoseconds due = 0;
  };

  Shared& shared_;
  double rate_hz_;
  bool may_control_;
  std::function<void()> show_changed_;
  web::Socket* socket_ = nullptr;  // null unless it is open
  ShowRequest show_;
  std::map<std::pair<FrameType, std::uint32_t>, Stream> streams_;  // by type and instance
  std::deque<Frame> replies_;
  std::size_t sending_ = 0;  // number of frames on their way
  std::uint64_t refusals_ = 0;
  bool gone_ = false;
  bool closing_ = false;
};

}  // namespace

class Server::Impl {
 public:
  Impl(const web::Listening& listening, const std::string& folder, std::size_t max_pages, double rate_hz)
      : max_pages_(max_pages), rate_hz_(rate_hz), web_(listening, site(folder), kPorts) {}

  void publish(std::vector<Outgoing>&& frames) {
    web_.post([this, frames = std::move(frames)] {
      for (const Outgoing& each : frames) {
        if (each.retain == Retain::yes) shared_.retain(each);
        for (const auto& page : pages_) page->offer(each);
      }
      const Nanoseconds at = now();
      for (const auto& page : pages_) page->flush(at);
    });
  }

  const web::WebServer& web() const { return web_; }
  Shared& shared() { return shared_; }

 private:
  web::Site site(const std::string& folder) {
    shared_.files = read_files(folder);
    web::Site site;
    site.get = [this](const std::string& path) {
      const auto file = shared_.files.find(path);
      if (file != shared_.files.end()) return web::Answer{200, file->second.type, file->second.body};
      web::Answer answer;
      if (shared_.files.empty())
        answer.body = "softhand-viewer was built without its page (SOFTHAND_VIEWER=OFF, or no npm).\n";
      return answer;
    };
    site.socket_path = "/stream";
    site.largest_message = kLargestRequest;
    site.most_connections = kMostConnections + max_pages_;
    site.controls = true;
    site.connect = [this](bool trusted) -> std::shared_ptr<web::Session> {
      // Pages without the token are counted apart, so that they cannot lock out the user.
      const auto taken = std::count_if(pages_.begin(), pages_.end(),
                                       [trusted](const auto& page) { return page->may_control() == trusted; });
      if (static_cast<std::size_t>(taken) >= max_pages_) return nullptr;
      pages_.push_back(std::make_shared<Page>(shared_, rate_hz_, trusted, [this] { count_pages(); }));
      count_pages();
      return pages_.back();
    };
    site.refused = [this] { shared_.refuse(Refusal::origin); };
    return site;
  }

  void count_pages() {
    std::erase_if(pages_, [](const auto& page) { return page->gone(); });
    TypeSet shown = 0;
    for (const auto& page : pages_) shown |= page->types();
    shared_.shown.store(shown, std::memory_order_relaxed);
    shared_.pages.store(static_cast<std::uint32_t>(pages_.size()), std::memory_order_relaxed);
  }

  Shared shared_;
  std::vector<std::shared_ptr<Page>> pages_;
  std::size_t max_pages_;
  double rate_hz_;
  web::WebServer web_;  // last member, because its thread uses the others
};

Server::Server(const web::Listening& listening, const std::string& folder, std::size_t max_pages, double rate_hz)
    : impl_(std::make_unique<Impl>(listening, folder, max_pages, rate_hz)) {}
Server::~Server() = default;
const std::string& Server::url() const { return impl_->web().url(); }
const std::vector<std::string>& Server::urls_elsewhere() const { return impl_->web().urls_elsewhere(); }
TypeSet Server::shown() const { return impl_->shared().shown.load(std::memory_order_relaxed); }
void Server::publish(std::vector<Outgoing> frames) { impl_->publish(std::move(frames)); }

std::vector<Message> Server::take_messages() {
  const std::lock_guard lock(impl_->shared().mutex);
  return std::exchange(impl_->shared().messages, {});
}

ServerCounters Server::counters() const {
  const Shared& shared = impl_->shared();
  ServerCounters out{shared.pages, shared.bytes_sent, shared.frames_sent, shared.frames_passed_over, {}};
  std::copy(shared.refused.begin(), shared.refused.end(), out.refused.begin());
  return out;
}

}  // namespace softhand::viewer
