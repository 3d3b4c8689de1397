// The web server over real sockets: the host names under which it answers, whom it trusts, and the number of
// connections. Also its memory, and its behaviour without free file descriptors.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <ctime>
#include <list>
#include <string>
#include <thread>
#include <vector>

#include "support/http_client.hpp"
#include "web/web_server.hpp"

namespace softhand::web {
namespace {

using namespace std::chrono_literals;
using testing::HttpClient;
using testing::lan_address;

Site site() {
  Site site;
  site.get = [](const std::string&) { return Answer{200, "text/plain", "here"}; };
  site.connect = [](auto&&...) { return nullptr; };
  site.refused = [] {};
  return site;
}

std::string ask(const WebServer& server, const std::string& host) {
  HttpClient client;
  client.connect(server.port());
  return client.ask(host);
}

TEST(WebServer, ClosesConnectionsAboveItsLimit) {
  const WebServer server({.address = "0.0.0.0"}, site());
  std::list<HttpClient> idle(64);
  for (HttpClient& each : idle) each.connect(server.port());
  {
    HttpClient one;
    one.connect(server.port());
    EXPECT_TRUE(one.is_closed());
  }
  if (const in_addr_t lan = lan_address(); lan != 0) {
    HttpClient other;
    other.connect(server.port(), lan);
    EXPECT_EQ(other.ask("localhost"), "HTTP/1.1 200 OK") << "other machines are counted apart";
  }
  idle.pop_back();
  std::string answer;
  for (const auto until = std::chrono::steady_clock::now() + 10s;
       answer.empty() && std::chrono::steady_clock::now() < until;)
    answer = ask(server, "localhost");
  EXPECT_EQ(answer, "HTTP/1.1 200 OK") << "a closed connection makes room";
}

// Many clients that ask for a large file and read slowly.
TEST(WebServer, DoesNotCopyTheFileForEachRequest) {
  const std::string large(std::size_t{16} << 20, 'x');
  Site big = site();
  big.get = [&large](const std::string&) { return Answer{200, "text/plain", large}; };
  const WebServer server({}, std::move(big));
  const auto used = [] {
    const auto memory = mallinfo2();
    return memory.uordblks + memory.hblkhd;
  };
  const std::size_t before = used();
  std::list<HttpClient> clients(8);
  for (HttpClient& each : clients) {
    each.connect(server.port());
    EXPECT_EQ(each.ask("localhost"), "HTTP/1.1 200 OK");
  }
  EXPECT_LT(used() - before, large.size() / 4);
}

TEST(WebServer, TrustsByAddressAndTokenAndNotByName) {
  std::vector<bool> trusted;
  Site controlling = site();
  controlling.controls = true;
  controlling.connect = [&trusted](bool is_trusted) {
    trusted.push_back(is_trusted);
    return nullptr;
  };
  const WebServer server({.address = "0.0.0.0", .hosts = "quest-pc.local"}, std::move(controlling));
  const std::string url = server.urls_elsewhere().at(0);
  const std::string token = url.substr(url.find("?token=") + 7);
  EXPECT_EQ(token.size(), 10u) << url;
  EXPECT_EQ(server.url().find("token"), std::string::npos) << "programs of this machine need no token";
  const auto is_trusted = [&](in_addr_t address, const std::string& target, const std::string& host) {
    HttpClient client;
    client.connect(server.port(), address);
    EXPECT_EQ(client.open_socket(target, host), "HTTP/1.1 503 Service Unavailable");
    return trusted.back();
  };
  EXPECT_TRUE(is_trusted(htonl(INADDR_LOOPBACK), "/stream", "quest-pc.local")) << "a tunnel";
  const in_addr_t lan = lan_address();
  if (lan == 0) GTEST_SKIP() << "no address but loopback addresses";
  EXPECT_FALSE(is_trusted(lan, "/stream", "quest-pc.local"));
  EXPECT_FALSE(is_trusted(lan, "/stream", "localhost")) << "anybody can write this name";
  EXPECT_FALSE(is_trusted(lan, "/stream?token=", "quest-pc.local"));
  EXPECT_FALSE(is_trusted(lan, "/stream?token=" + token + "x", "quest-pc.local"));
  EXPECT_FALSE(is_trusted(lan, "/stream?other=" + token, "quest-pc.local"));
  EXPECT_TRUE(is_trusted(lan, "/stream?token=" + token, "quest-pc.local"));
  EXPECT_TRUE(is_trusted(lan, "/stream?plain&token=" + token + "&x=1", "quest-pc.local"));
}

TEST(WebServer, TheTokenCanBeChosen) {
  Site controlling = site();
  controlling.controls = true;
  const WebServer server({.address = "0.0.0.0", .hosts = "quest-pc.local", .token = "My-own_1"}, controlling);
  EXPECT_TRUE(server.urls_elsewhere().at(0).ends_with("/?token=My-own_1"));
  EXPECT_THROW(WebServer({.token = "a b"}, controlling), std::runtime_error);
  const WebServer closed({.token = "unused"}, controlling);
  EXPECT_EQ(closed.url().find("token"), std::string::npos) << "only this machine can connect";
}

TEST(WebServer, AnswersUnderItsNamesInAnyNotation) {
  const WebServer server({.address = "0.0.0.0", .hosts = "Quest-PC.local FD00::1"}, site());
  for (const char* host :
       {"Quest-PC.local:80", "quest-pc.local:80", "quest-pc.local", "LOCALHOST", "[fd00::1]:80", "[FD00::1]"})
    EXPECT_EQ(ask(server, host), "HTTP/1.1 200 OK") << host;
  for (const char* host : {"quest-pc", "elsewhere.example", "[fd00::2]:80", "fd00::1"})
    EXPECT_EQ(ask(server, host), "HTTP/1.1 403 Forbidden") << host;
  const std::string port = ":" + std::to_string(server.port());
  EXPECT_EQ(server.url(), "http://localhost" + port);
  EXPECT_EQ(server.urls_elsewhere(),
            (std::vector<std::string>{"http://quest-pc.local" + port, "http://[fd00::1]" + port}));
}

TEST(WebServer, WritesIpv6AddressesInBrackets) {
  // An IPv4 address in IPv6 notation. A machine has it even without an IPv6 address of its own.
  const WebServer one({.address = "0:0::FFFF:127.0.0.1"}, site());
  EXPECT_EQ(one.url(), "http://[::ffff:127.0.0.1]:" + std::to_string(one.port()));
  EXPECT_EQ(ask(one, "[::ffff:127.0.0.1]:80"), "HTTP/1.1 200 OK");
  const WebServer every({.address = "::", .hosts = "quest-pc.local"}, site());
  const std::string port = ":" + std::to_string(every.port());
  EXPECT_EQ(every.url(), "http://localhost" + port);
  EXPECT_EQ(every.urls_elsewhere(), std::vector<std::string>{"http://quest-pc.local" + port});
}

double cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

TEST(WebServer, IdlesWithoutFreeFileDescriptorsAndContinuesAfterwards) {
  const WebServer server({}, site());
  HttpClient client;
  rlimit usual{};
  getrlimit(RLIMIT_NOFILE, &usual);
  const rlimit low{128, usual.rlim_max};
  setrlimit(RLIMIT_NOFILE, &low);
  std::vector<int> taken;
  for (int file = 0; (file = open("/dev/null", O_RDONLY)) >= 0;) taken.push_back(file);
  ASSERT_FALSE(taken.empty());
  client.connect(server.port());
  const double before = cpu_seconds();
  std::this_thread::sleep_for(500ms);
  EXPECT_LT(cpu_seconds() - before, 0.1);
  for (const int file : taken) close(file);
  setrlimit(RLIMIT_NOFILE, &usual);
  EXPECT_EQ(client.ask("localhost"), "HTTP/1.1 200 OK");
}

}  // namespace
}  // namespace softhand::web
