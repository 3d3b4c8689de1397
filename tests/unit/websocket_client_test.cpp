// The WebSocket client of the SDK against a server: messages both ways, power cycles, bounds, the last message.
#include "device/websocket_client.hpp"

#include <gtest/gtest.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "device/simulated_service.hpp"
#include "support/count_allocations.hpp"

namespace softhand {
namespace {

class Client : public ::testing::Test {
 protected:
  void open_service(std::int64_t port = 0) {
    service_.emplace(port, SimulatedService::Behaviour{[this](const std::string& target) {
                                                         const std::lock_guard lock(mutex_);
                                                         targets_.push_back(target);
                                                         return "welcome";
                                                       },
                                                       [this](const std::string& message) {
                                                         const std::lock_guard lock(mutex_);
                                                         messages_.push_back(message);
                                                         return message == "ask" ? "answer" : "";
                                                       },
                                                       [this] {
                                                         const std::lock_guard lock(mutex_);
                                                         ++left_;
                                                       }});
  }
  void open_client(std::vector<std::string> greeting = {}) {
    const std::int64_t port = service_ ? service_->port() : 1;
    client_ = std::make_unique<WebSocketClient>(
        WebSocketClient::Server{"127.0.0.1", port, "/v2/feedbacks?app=1", std::move(greeting)}, 64, 8);
  }
  template <typename Done>
  bool until(const Done& done) {
    for (int i = 0; i < 5000; ++i) {
      if (client_) client_->take([this](const Arrival& arrival) { received_.emplace_back(arrival.bytes); });
      {
        const std::lock_guard lock(mutex_);
        if (done()) return true;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return false;
  }

  std::mutex mutex_;
  std::vector<std::string> targets_, messages_;
  int left_ = 0;
  std::vector<std::string> received_;
  std::optional<SimulatedService> service_;
  std::unique_ptr<WebSocketClient> client_;
};

TEST_F(Client, ExchangesMessagesAfterItsGreeting) {
  open_service();
  open_client({"first", "second"});
  EXPECT_FALSE(client_->connected());
  client_->start();
  ASSERT_TRUE(until([&] { return !received_.empty(); }));
  EXPECT_TRUE(client_->connected());
  client_->send("ask");
  ASSERT_TRUE(until([&] { return received_.size() == 2; }));
  EXPECT_EQ(received_, (std::vector<std::string>{"welcome", "answer"}));
  EXPECT_EQ(messages_, (std::vector<std::string>{"first", "second", "ask"}));
  EXPECT_EQ(targets_, (std::vector<std::string>{"/v2/feedbacks?app=1"}));
}

TEST_F(Client, ConnectsAgainAfterPowerCycles) {
  open_service();
  const std::int64_t port = service_->port();
  open_client({"hello"});
  client_->start();
  for (std::size_t cycle = 1; cycle <= 3; ++cycle) {
    ASSERT_TRUE(until([&] { return messages_.size() == cycle; }));
    service_.reset();
    ASSERT_TRUE(until([&] { return !client_->connected(); }));
    client_->send("lost");  // without a connection nothing waits
    open_service(port);
  }
  ASSERT_TRUE(until([&] { return messages_.size() == 4; }));
  EXPECT_EQ(messages_, (std::vector<std::string>(4, "hello")));
  EXPECT_EQ(client_->counters().reconnects, 3u);
  EXPECT_EQ(client_->counters().connections, 1u);
}

// Messages of the service must not end a connection whose handshake is not done.
TEST_F(Client, AServiceSendsNothingBeforeTheHandshake) {
  open_service();
  boost::asio::io_context context;
  boost::asio::ip::tcp::socket socket(context);
  socket.connect({boost::asio::ip::address_v4::loopback(), service_->port()});
  for (int i = 0; i < 20; ++i) {
    service_->send("early");
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  boost::beast::websocket::stream<boost::asio::ip::tcp::socket> stream(std::move(socket));
  boost::beast::error_code error;
  stream.handshake("127.0.0.1", "/", error);
  ASSERT_FALSE(error) << error.message();
  boost::beast::flat_buffer received;
  stream.read(received, error);
  ASSERT_FALSE(error) << error.message();
  EXPECT_EQ(boost::beast::buffers_to_string(received.cdata()), "welcome");
}

TEST_F(Client, RefusesMessagesThatAreTooLarge) {
  open_service();
  open_client();
  client_->start();
  ASSERT_TRUE(until([&] { return received_.size() == 1; }));
  service_->send(std::string(64, 'a'));
  ASSERT_TRUE(until([&] { return received_.size() == 2; }));
  service_->send(std::string(65, 'b'));
  ASSERT_TRUE(until([&] { return received_.size() == 3; }));  // the welcome of the next connection
  EXPECT_EQ(received_.back(), "welcome");
  EXPECT_EQ(client_->counters().refused_size, 1u);
}

TEST_F(Client, DropsMessagesThatAreNotTaken) {
  open_service();
  open_client();
  client_->start();
  ASSERT_TRUE(until([&] { return received_.size() == 1; }));
  for (int i = 0; i < 10; ++i) service_->send("flood");
  for (int i = 0; i < 5000 && client_->counters().passed_over < 2; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(client_->counters().passed_over, 2u);
  ASSERT_TRUE(until([&] { return received_.size() == 9; }));
}

TEST_F(Client, TranslatesInItsOwnThread) {
  open_service();
  open_client();
  const auto here = std::this_thread::get_id();
  client_->translate([&](const Arrival& arrival) -> std::string_view {
    EXPECT_NE(std::this_thread::get_id(), here);
    return arrival.bytes == "skip" ? "" : arrival.bytes.substr(0, 2);
  });
  client_->start();
  ASSERT_TRUE(until([&] { return received_.size() == 1; }));
  service_->send("skip");
  service_->send("number");
  ASSERT_TRUE(until([&] { return received_.size() == 2; }));
  EXPECT_EQ(received_, (std::vector<std::string>{"we", "nu"}));
}

// A command that switches a device off is sent even if the process ends at once, and the service sees the end.
TEST_F(Client, SendsItsLastMessage) {
  for (std::size_t i = 1; i <= 20; ++i) {
    open_service();
    received_.clear();
    open_client();
    client_->start();
    ASSERT_TRUE(until([&] { return received_.size() == 1; }));
    client_->send("force");
    client_->send("off");
    client_.reset();
    ASSERT_TRUE(until([&] { return left_ == static_cast<int>(i); }));
    EXPECT_EQ(messages_.back(), "off");
  }
}

// The thread stood still while more messages came than can wait.
TEST_F(Client, SendsTheNewestMessageAfterAStall) {
  open_service();
  open_client();
  std::mutex stall;
  client_->translate([&](const Arrival& arrival) {
    const std::lock_guard lock(stall);
    return arrival.bytes;
  });
  client_->start();
  ASSERT_TRUE(until([&] { return received_.size() == 1; }));
  std::unique_lock lock(stall);
  service_->send("hold");
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  for (int i = 0; i < 100; ++i) client_->send(std::to_string(i));
  lock.unlock();
  ASSERT_TRUE(until([&] { return !messages_.empty(); }));
  EXPECT_TRUE(until([&] { return messages_.back() == "99"; })) << messages_.back();
  EXPECT_EQ(client_->counters().superseded, 100 - messages_.size());
}

TEST_F(Client, EndsWithoutAService) {
  open_client();
  client_->start();
  client_->send("lost");
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  client_.reset();
  EXPECT_THROW(WebSocketClient({"localhost", 1}, 64), std::invalid_argument);
}

TEST_F(Client, SendsWithoutAllocation) {
  open_service();
  open_client();
  client_->start();
  ASSERT_TRUE(until([&] { return received_.size() == 1; }));
  // Only the sending thread is watched: the other one may allocate.
  client_.reset();
  service_.reset();
  open_client();  // not started
  counting = true;
  for (int i = 0; i < 10; ++i) client_->send("force");
  client_->take([](const Arrival&) {});
  counting = false;
  EXPECT_EQ(allocations, 0);
}

}  // namespace
}  // namespace softhand
