// The web server over real sockets: the host names under which it answers, and its behaviour without free file
// descriptors.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <ctime>
#include <string>
#include <thread>
#include <vector>

#include "web/web_server.hpp"

namespace softhand::web {
namespace {

using namespace std::chrono_literals;

Site site() {
  Site site;
  site.get = [](const std::string&) { return Answer{200, "text/plain", "here"}; };
  site.connect = [] { return nullptr; };
  site.refused = [] {};
  return site;
}

/// Asks for one page.
class HttpClient {
 public:
  HttpClient() : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval timeout{10, 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  }
  ~HttpClient() { close(socket_); }
  HttpClient(const HttpClient&) = delete;
  HttpClient& operator=(const HttpClient&) = delete;
  void connect(const WebServer& server) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(server.port());
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  /// The answer's first line.
  std::string ask(const std::string& host) {
    const std::string request = "GET / HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n";
    send(socket_, request.data(), request.size(), MSG_NOSIGNAL);
    std::string line;
    for (char c = 0; recv(socket_, &c, 1, 0) == 1 && c != '\r';) line += c;
    return line;
  }

 private:
  int socket_;
};

std::string ask(const WebServer& server, const std::string& host) {
  HttpClient client;
  client.connect(server);
  return client.ask(host);
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
  client.connect(server);
  const double before = cpu_seconds();
  std::this_thread::sleep_for(500ms);
  EXPECT_LT(cpu_seconds() - before, 0.1);
  for (const int file : taken) close(file);
  setrlimit(RLIMIT_NOFILE, &usual);
  EXPECT_EQ(client.ask("localhost"), "HTTP/1.1 200 OK");
}

}  // namespace
}  // namespace softhand::web
