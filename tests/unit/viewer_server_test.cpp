// The pages of the viewer over real sockets: how many may be open, and what a page that does not read may cost.
#include <gtest/gtest.h>

#include <cstring>
#include <list>
#include <string>
#include <vector>

#include "support/eventually.hpp"
#include "support/http_client.hpp"
#include "viewer/server.hpp"

namespace softhand::viewer {
namespace {

using testing::eventually;
using testing::HttpClient;

constexpr const char* kOpened = "HTTP/1.1 101 Switching Protocols";
constexpr const char* kTooMany = "HTTP/1.1 503 Service Unavailable";

std::uint16_t port_of(const Server& server) {
  return static_cast<std::uint16_t>(std::stoi(server.url().substr(server.url().rfind(':') + 1)));
}

std::string open_page(const Server& server, HttpClient& client, in_addr_t address) {
  client.connect(port_of(server), address);
  return client.open_socket("/stream", "localhost");
}

// The request of a page as a WebSocket message.
std::string show_message(TypeSet types) {
  const std::uint16_t numbers[] = {kVersion, static_cast<std::uint16_t>(FrameType::show)};
  const std::uint32_t sizes[] = {8, 0}, magic = kMagic;
  const float rate_hz = 0;
  std::string message("\x82\x98\0\0\0\0", 6);  // one binary message of 24 bytes, under a mask that changes nothing
  for (const auto& [data, size] : std::initializer_list<std::pair<const void*, std::size_t>>{
           {&magic, 4}, {numbers, 4}, {sizes, 8}, {&types, 4}, {&rate_hz, 4}})
    message.append(static_cast<const char*>(data), size);
  return message;
}

TEST(ViewerServer, PagesWithoutTheTokenDoNotLockOutTheUser) {
  const in_addr_t lan = testing::lan_address();
  if (lan == 0) GTEST_SKIP() << "no address but loopback addresses";
  const Server server({.address = "0.0.0.0", .port = 0}, "", 2, 60);
  std::list<HttpClient> clients;
  const auto open = [&](in_addr_t address) { return open_page(server, clients.emplace_back(), address); };
  for (int i = 0; i < 2; ++i) EXPECT_EQ(open(lan), kOpened);
  EXPECT_EQ(open(lan), kTooMany);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(open(htonl(INADDR_LOOPBACK)), kOpened);
  EXPECT_EQ(open(htonl(INADDR_LOOPBACK)), kTooMany);
}

// Anybody on the domain can invent instances.
TEST(ViewerServer, StreamsOfAPageThatDoesNotReadAreLimited) {
  Server server({.port = 0}, "", 1, 60);
  HttpClient page;
  ASSERT_EQ(open_page(server, page, htonl(INADDR_LOOPBACK)), kOpened);
  page.write(show_message(set_of(FrameType::nodes)));
  ASSERT_TRUE(eventually([&] { return server.shown() == set_of(FrameType::nodes); }));
  const auto frame = [](std::size_t size) { return std::make_shared<const std::vector<std::uint8_t>>(size); };
  server.publish({{FrameType::nodes, 0, frame(std::size_t{64} << 20)}});  // more than the sockets' buffers hold
  constexpr std::uint32_t kStreams = 1024, kInvented = 3000;
  std::vector<Outgoing> invented;
  for (std::uint32_t instance = 0; instance < kInvented; ++instance)
    invented.push_back({FrameType::nodes, instance, frame(4)});
  server.publish(invented);
  EXPECT_TRUE(eventually([&] { return server.counters().frames_passed_over == kInvented - kStreams; }))
      << server.counters().frames_passed_over;
  EXPECT_EQ(server.counters().frames_sent, 0u);
}

}  // namespace
}  // namespace softhand::viewer
