#include "trackers/sockets/inbox.hpp"

#include <atomic>
#include <optional>

#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "web/web_server.hpp"

namespace softhand {
namespace {

constexpr std::uint64_t kMaxConnections = 16;

struct Shared {
  explicit Shared(std::size_t largest) : arrivals(largest) {}
  std::atomic<std::uint64_t> connections{0}, refused_origin{0}, refused_size{0};
  std::uint64_t next_connection = 1;  // used only by the server's thread, as the pushing end of the queue
  ArrivalQueue arrivals;
};

class Sender : public web::Session {
 public:
  explicit Sender(Shared& shared) : shared_(shared), id_(shared.next_connection++) { ++shared_.connections; }
  void opened(web::Socket&) override {}
  void received(std::string_view bytes, bool binary) override { shared_.arrivals.push({bytes, now(), id_, binary}); }
  void sent(std::size_t) override {}
  void closed(bool too_large) override {
    --shared_.connections;
    if (too_large) ++shared_.refused_size;
  }

 private:
  Shared& shared_;
  std::uint64_t id_;
};

}  // namespace

class Inbox::Impl {
 public:
  Impl(const web::Listening& listening, Transport transport, std::size_t largest)
      : shared_(largest), web_(listening, site(largest)) {
    if (transport == Transport::websocket) return;
    datagrams_.emplace(largest);
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
    site.connect = [this](bool) {
      return shared_.connections < kMaxConnections ? std::make_shared<Sender>(shared_) : nullptr;
    };
    site.refused = [this] { ++shared_.refused_origin; };
    return site;
  }

  Shared shared_;
  web::WebServer web_;
  std::optional<Intake> datagrams_;
};

Inbox::Inbox(const web::Listening& listening, Transport transport, std::size_t largest)
    : impl_(std::make_unique<Impl>(listening, transport, largest)) {}
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
  return {shared.connections, shared.refused_origin, shared.refused_size + of.refused_size,
          shared.arrivals.passed_over() + of.passed_over};
}

void Inbox::fill_status(LoopStatus& status) const {
  const Counters of = counters();
  add_counter(status, "connections", static_cast<double>(of.connections));
  add_counter(status, "refused_origin", static_cast<double>(of.refused_origin));
  add_counter(status, "passed_over", static_cast<double>(of.passed_over));
}

}  // namespace softhand
