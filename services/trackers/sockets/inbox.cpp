#include "trackers/sockets/inbox.hpp"

#include <array>
#include <atomic>
#include <optional>

#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "web/web_server.hpp"

namespace softhand {
namespace {

// Programs of this machine and others are counted apart, so that others cannot lock out the user.
constexpr std::uint64_t kMaxConnections = 16;

struct Shared {
  Shared(std::size_t largest, const std::function<Translate()>& make_translate) : arrivals(largest) {
    if (make_translate) arrivals.translate(make_translate());
  }
  std::array<std::atomic<std::uint64_t>, 2> connections{};  // of others, of programs of this machine
  std::atomic<std::uint64_t> refused_origin{0}, refused_connections{0}, refused_size{0};
  std::uint64_t next_connection = 1;  // used only by the server's thread, as the pushing end of the queue
  ArrivalQueue arrivals;
};

class Sender : public web::Session {
 public:
  Sender(Shared& shared, std::atomic<std::uint64_t>& connections)
      : shared_(shared), connections_(connections), id_(shared.next_connection++) {
    ++connections_;
  }
  void opened(web::Socket&) override {}
  void received(std::string_view bytes, bool binary) override { shared_.arrivals.push({bytes, now(), id_, binary}); }
  void sent(std::size_t) override {}
  void closed(bool too_large) override {
    --connections_;
    if (too_large) ++shared_.refused_size;
  }

 private:
  Shared& shared_;
  std::atomic<std::uint64_t>& connections_;
  std::uint64_t id_;
};

}  // namespace

class Inbox::Impl {
 public:
  Impl(const web::Listening& listening, Transport transport, std::size_t largest,
       const std::function<Translate()>& make_translate)
      : shared_(largest, make_translate), web_(listening, site(largest)) {
    if (transport == Transport::websocket) return;
    datagrams_.emplace(largest);
    if (make_translate) datagrams_->translate(make_translate());
    datagrams_->listen_udp(listening.address, web_.port());
    datagrams_->start();
  }
  Intake* datagrams() { return datagrams_ ? &*datagrams_ : nullptr; }
  Shared& shared() { return shared_; }
  const web::WebServer& web() const { return web_; }

 private:
  web::Site site(std::size_t largest) {
    web::Site site;
    site.get = [](const std::string&) {
      return web::Answer{426, "text/plain", "This port accepts only WebSocket connections.\n"};
    };
    site.origin = web::Origin::this_host;
    site.largest_message = largest;
    site.connect = [this](bool trusted) -> std::shared_ptr<web::Session> {
      auto& connections = shared_.connections[trusted ? 1 : 0];
      if (connections < kMaxConnections) return std::make_shared<Sender>(shared_, connections);
      ++shared_.refused_connections;
      return nullptr;
    };
    site.refused = [this] { ++shared_.refused_origin; };
    return site;
  }

  Shared shared_;
  web::WebServer web_;
  std::optional<Intake> datagrams_;
};

Inbox::Inbox(const web::Listening& listening, Transport transport, std::size_t largest,
             const std::function<Translate()>& make_translate)
    : impl_(std::make_unique<Impl>(listening, transport, largest, make_translate)) {}
Inbox::~Inbox() = default;
std::uint16_t Inbox::port() const { return impl_->web().port(); }

std::string Inbox::url() const {
  std::string url = impl_->web().url();
  return url.replace(0, 4, "ws");
}

ArrivalQueue& Inbox::messages() { return impl_->shared().arrivals; }
Intake* Inbox::datagrams() { return impl_->datagrams(); }

Inbox::Counters Inbox::counters() const {
  const Shared& shared = impl_->shared();
  const Intake* intake = impl_->datagrams();
  const Intake::Counters of = intake == nullptr ? Intake::Counters{} : intake->counters();
  return {shared.connections[0] + shared.connections[1], shared.refused_origin, shared.refused_connections,
          shared.refused_size + of.refused_size, shared.arrivals.passed_over() + of.passed_over};
}

void Inbox::fill_status(LoopStatus& status) const {
  const Counters of = counters();
  add_counter(status, "connections", static_cast<double>(of.connections));
  add_counter(status, "refused_origin", static_cast<double>(of.refused_origin));
  add_counter(status, "refused_connections", static_cast<double>(of.refused_connections));
  add_counter(status, "passed_over", static_cast<double>(of.passed_over));
}

}  // namespace softhand
