// The driver SDK without DDS: sections of drivers, health, and the reception of packets.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "device/device_thread.hpp"
#include "device/driver.hpp"
#include "device/health.hpp"
#include "device/intake.hpp"
#include "device/refusals.hpp"
#include "runtime/clock.hpp"
#include "scene_file.hpp"
#include "support/count_allocations.hpp"
#include "support/pseudo_terminal.hpp"

namespace softhand::driver_sdk_test {
namespace {

using namespace std::chrono_literals;
constexpr Nanoseconds kMillisecond = 1'000'000;

struct GloveOptions {
  double gain = 2;
};
void describe(OptionVisitor& v, GloveOptions& o) { v.number("gain", o.gain, "1", {0, 10}, "Gain."); }
const RegisterDriver<GloveOptions> glove{"tracker_test_glove", "a glove of this test."};

TEST(DriverSections, BelongToTheDriverThatRegistersThem) {
  const Scene scene = read_scene_text("s.toml", "[tracker_test_glove]\ngain = 3\n", {"tracker_test_glove.gain=4"});
  EXPECT_EQ(driver_options<GloveOptions>(scene.options).gain, 4);
  EXPECT_EQ(driver_options<GloveOptions>(SceneOptions{}).gain, 2);
  ASSERT_EQ(scene.overrides.size(), 1u);
  EXPECT_EQ(scene.overrides[0].before, "3");
  EXPECT_TRUE(scene.ignored.empty());
  EXPECT_THROW(read_scene_text("s.toml", "[tracker_test_glove]\ngian = 3\n", {}), ConfigError);
  EXPECT_THROW(read_scene_text("s.toml", "[tracker_test_glove]\ngain = 11\n", {}), ConfigError);
  EXPECT_THROW(read_scene_text("s.toml", "", {"tracker_test_glove.gain=11"}), ConfigError);
  EXPECT_THROW(driver_options<int>(scene.options), std::logic_error);
}

TEST(DriverSections, OfOtherDriversAreIgnored) {
  const Scene scene = read_scene_text("s.toml", "[haptic_elsewhere]\nanything = 1\n", {"tracker_elsewhere.port=1"});
  EXPECT_EQ(scene.ignored, (std::vector<std::string>{"haptic_elsewhere", "tracker_elsewhere"}));
  EXPECT_THROW(read_scene_text("s.toml", "[trakcer_elsewhere]\nport = 1\n", {}), ConfigError);
  EXPECT_THROW(read_scene_text("s.toml", "[tracker_]\nport = 1\n", {}), ConfigError);
  EXPECT_THROW(read_scene_text("s.toml", "", {"trakcer_elsewhere.port=1"}), ConfigError);
}

TEST(Health, FollowsTheSamples) {
  HealthMonitor health;
  Nanoseconds now = 10'000 * kMillisecond;
  const SourceState good;
  EXPECT_EQ(health.update(now, good), Health::opening);
  const auto run = [&](int milliseconds, int period) {
    Health last = Health::opening;
    for (const Nanoseconds end = now + milliseconds * kMillisecond; now < end; now += kMillisecond) {
      if (period > 0 && now / kMillisecond % period == 0) health.sample(now);
      last = health.update(now, good);
    }
    return last;
  };
  EXPECT_EQ(run(3000, 11), Health::live);
  EXPECT_EQ(run(200, 0), Health::degraded);  // silent for more than 100 ms
  EXPECT_EQ(run(400, 0), Health::lost);
  EXPECT_EQ(run(500, 11), Health::degraded);  // the gap is less than a second ago
  EXPECT_EQ(run(1000, 11), Health::live);
  EXPECT_EQ(health.update(now, {.connected = false}), Health::lost);
  EXPECT_EQ(run(3000, 150), Health::degraded);  // too slow
}

TEST(Health, OfADeviceThatOnlyActsFollowsItsConnection) {
  ConnectionHealth health;
  EXPECT_EQ(health.update(false), Health::opening);
  EXPECT_EQ(health.update(true), Health::live);
  EXPECT_EQ(health.update(false), Health::lost);
  EXPECT_EQ(health.update(true), Health::live);
}

TEST(Health, DoubtDegradesAndAnUnseenHandDoesNot) {
  HealthMonitor health;
  Nanoseconds now = 1000 * kMillisecond;
  const auto run = [&](int samples, double confidence) {
    Health last = Health::opening;
    for (int i = 0; i < samples; ++i, now += 10 * kMillisecond) {
      health.sample(now, confidence);
      last = health.update(now, {});
    }
    return last;
  };
  EXPECT_EQ(run(100, 1), Health::live);
  EXPECT_EQ(run(100, 0), Health::live);
  EXPECT_EQ(run(100, 0.2), Health::degraded);
  EXPECT_EQ(run(90, 0.4), Health::degraded);  // the doubt is less than a second ago
  EXPECT_EQ(run(20, 0.4), Health::live);
}

TEST(Health, ManyRefusalsDegrade) {
  HealthMonitor health;
  SourceState state;
  Health last = Health::opening;
  const auto second = [&](Nanoseconds start, int refused) {
    for (int i = 0; i < 100; ++i) {
      health.sample(start + i * 10 * kMillisecond);
      if (i < refused) ++state.refused;
      last = health.update(start + i * 10 * kMillisecond, state);
    }
  };
  second(1000 * kMillisecond, 5);  // 5 of 105
  second(2000 * kMillisecond, 5);
  second(3000 * kMillisecond, 5);
  EXPECT_EQ(last, Health::live);
  second(4000 * kMillisecond, 20);  // 20 of 120
  second(5000 * kMillisecond, 0);
  EXPECT_EQ(last, Health::degraded);
  second(6000 * kMillisecond, 0);
  second(7000 * kMillisecond, 0);
  EXPECT_EQ(last, Health::live);
}

TEST(Backoff, DoublesUpToFiveSecondsAndStartsAgain) {
  Backoff backoff;
  std::vector<Nanoseconds> waits;
  for (int i = 0; i < 8; ++i) waits.push_back(backoff.next() / kMillisecond);
  EXPECT_EQ(waits, (std::vector<Nanoseconds>{100, 200, 400, 800, 1600, 3200, 5000, 5000}));
  backoff.reset();
  EXPECT_EQ(backoff.next(), 100 * kMillisecond);
}

TEST(ArrivalQueue, DropsAndCountsWhatIsNotTaken) {
  ArrivalQueue queue(8);
  for (int i = 0; i < 70; ++i) queue.push({std::string_view("12345678", 1 + i % 8), i, 5, false});
  queue.push({"123456789", 0, 0, false});  // too large
  std::vector<std::size_t> sizes;
  queue.take([&](const Arrival& packet) {
    EXPECT_EQ(packet.bytes, std::string_view("12345678").substr(0, packet.bytes.size()));
    EXPECT_EQ(packet.time, static_cast<Nanoseconds>(sizes.size()));
    EXPECT_EQ(packet.connection, 5u);
    sizes.push_back(packet.bytes.size());
  });
  ASSERT_EQ(sizes.size(), 64u);
  EXPECT_EQ(sizes[9], 2u);
  EXPECT_EQ(queue.passed_over(), 7u);
}

// Whatever the taker does meanwhile, packets keep their order, the newest one arrives, and the others are counted.
TEST(SendQueue, KeepsTheOrderAndTheNewestPacket) {
  constexpr int kPackets = 200'000;
  SendQueue queue(8, 4);
  std::atomic<bool> ended{false};
  std::thread sender([&] {
    for (int i = 0; i < kPackets; ++i) queue.push({packet_of(i), 0, 0, false});
    queue.push({"too large", 0, 0, false});
    ended = true;
  });
  int newest = -1, taken = 0;
  bool in_order = true;
  const auto take = [&] {
    queue.take([&](const Arrival& packet) {
      const int number = value_in<int>(packet);
      in_order = in_order && number > newest;
      newest = number;
      ++taken;
    });
  };
  while (!ended) take();
  sender.join();
  take();
  EXPECT_TRUE(in_order);
  EXPECT_EQ(newest, kPackets - 1);
  EXPECT_EQ(static_cast<std::uint64_t>(taken) + queue.superseded(), kPackets + 1u);
}

// The newest packet is not lost: it may be the zero after which nothing is sent.
TEST(Intake, SendsTheNewestPacketAfterAStall) {
  const int server = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in own{};
  own.sin_family = AF_INET;
  own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof own;
  ASSERT_EQ(bind(server, reinterpret_cast<const sockaddr*>(&own), size), 0);
  getsockname(server, reinterpret_cast<sockaddr*>(&own), &size);
  const timeval limit{1, 0};
  setsockopt(server, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  Intake intake(8);
  intake.connect_udp("127.0.0.1", ntohs(own.sin_port));
  for (int i = 0; i < 100; ++i) intake.send(0, std::to_string(i));  // its thread does not run yet
  intake.start();
  std::vector<std::string> packets;
  char bytes[16];
  for (ssize_t got; packets.size() < 65 && (got = recv(server, bytes, sizeof bytes, 0)) >= 0;)
    packets.emplace_back(bytes, static_cast<std::size_t>(got));
  ASSERT_EQ(packets.size(), 65u);
  EXPECT_EQ(packets[63], "63");
  EXPECT_EQ(packets[64], "99");
  EXPECT_EQ(intake.counters().superseded, 35u);
  intake.send(0, "next");
  ASSERT_EQ(recv(server, bytes, sizeof bytes, 0), 4);
  EXPECT_EQ(std::string(bytes, 4), "next");
  close(server);
}

enum class Fault { none, size, content };

TEST(Refusals, CountByReason) {
  Refusals<Fault, 3> refusals({"none", "size", "content_beyond_any_limit"});
  EXPECT_TRUE(refusals.accepted(Fault::none));
  EXPECT_FALSE(refusals.accepted(Fault::size));
  EXPECT_FALSE(refusals.accepted(Fault::content));
  EXPECT_FALSE(refusals.accepted(Fault::content));
  EXPECT_EQ(refusals.total(), 3u);
  LoopStatus status;
  const long before = allocations;
  counting = true;
  refusals.fill_status(status, 10);
  counting = false;
  EXPECT_EQ(allocations, before);
  ASSERT_EQ(status.counters.size(), 2u);
  EXPECT_EQ(get_text(status.counters[0].name), "refused_content_beyond_any_limi");
  EXPECT_EQ(status.counters[0].value, 2);
  EXPECT_EQ(get_text(status.counters[1].name), "refused_size");
  EXPECT_EQ(status.counters[1].value, 11);
}

// Packets that an intake received.
struct Received {
  explicit Received(Intake& of) : intake(of) {}
  bool until(const std::function<bool()>& done) {
    for (int i = 0; i < 2000; ++i) {
      intake.take([&](const Arrival& packet) {
        packets.emplace_back(packet.bytes);
        connections.push_back(packet.connection);
        EXPECT_LE(packet.time, now());
      });
      if (done()) return true;
      std::this_thread::sleep_for(5ms);
    }
    return false;
  }
  bool count(std::size_t n) {
    return until([&] { return packets.size() >= n; });
  }
  Intake& intake;
  std::vector<std::string> packets;
  std::vector<std::uint64_t> connections;
};

int connected_socket(int type, std::uint16_t port) {
  const int number = socket(AF_INET, type, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(number, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
  return number;
}

// An intake that takes lines by TCP, and what it received.
struct LineIntake {
  explicit LineIntake(std::size_t largest) : intake(largest), port(intake.listen_tcp("127.0.0.1", 0, '\n')) {
    intake.set_release("let go\n");
    intake.start();
  }
  int connect() const { return connected_socket(SOCK_STREAM, port); }
  Intake intake;
  std::uint16_t port;
  Received received{intake};
};

void send_text(int number, const std::string& text) {
  EXPECT_EQ(write(number, text.data(), text.size()), static_cast<ssize_t>(text.size()));
}

TEST(Intake, ReceivesDatagramsAndRefusesLargeOnes) {
  Intake intake(8);
  const std::uint16_t port = intake.listen_udp("127.0.0.1", 0);
  intake.start();
  EXPECT_TRUE(intake.connected());
  const int sender = connected_socket(SOCK_DGRAM, port);
  for (const char* text : {"one", "123456789", "12345678", "", "three\n"}) send_text(sender, text);
  Received received(intake);
  ASSERT_TRUE(received.count(4));
  EXPECT_EQ(received.packets, (std::vector<std::string>{"one", "12345678", "", "three\n"}));
  EXPECT_EQ(received.connections, (std::vector<std::uint64_t>{0, 0, 0, 0}));
  EXPECT_EQ(intake.counters().refused_size, 1u);
  close(sender);
}

TEST(Intake, JoinsAndSplitsTheLinesOfAStream) {
  LineIntake lines(8);
  auto& [intake, port, received] = lines;
  EXPECT_FALSE(intake.connected());
  int peer = lines.connect();
  for (const char* part : {"a", "b", "c\nde\n\nf", "g\n", "12345", "6789", "0\nlast\ncut"}) {
    send_text(peer, part);
    std::this_thread::sleep_for(5ms);
  }
  ASSERT_TRUE(received.count(5));
  EXPECT_EQ(received.packets, (std::vector<std::string>{"abc", "de", "", "fg", "last"}));
  EXPECT_TRUE(intake.connected());
  close(peer);
  ASSERT_TRUE(received.until([&] { return !intake.connected(); }));
  EXPECT_EQ(intake.counters().refused_size, 1u);
  EXPECT_EQ(intake.counters().refused_cut, 1u);
  EXPECT_EQ(intake.counters().reconnects, 0u);

  peer = lines.connect();
  send_text(peer, "again\n");
  ASSERT_TRUE(received.count(6));
  EXPECT_EQ(received.packets.back(), "again");
  EXPECT_GT(received.connections.back(), received.connections.front());
  EXPECT_EQ(intake.counters().reconnects, 1u);
  close(peer);
}

sockaddr_in address_of(const char* host, int port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(static_cast<std::uint16_t>(port));
  inet_pton(AF_INET, host, &out.sin_addr);
  return out;
}
// A socket at any free port of a host.
std::pair<int, int> bound_socket(int type, const char* host) {
  const int number = socket(AF_INET, type, 0);
  sockaddr_in own = address_of(host, 0);
  socklen_t size = sizeof own;
  EXPECT_EQ(bind(number, reinterpret_cast<const sockaddr*>(&own), size), 0);
  getsockname(number, reinterpret_cast<sockaddr*>(&own), &size);
  return {number, ntohs(own.sin_port)};
}

TEST(Intake, AsksAServerByUdpAndHearsNobodyElse) {
  const auto [server, port] = bound_socket(SOCK_DGRAM, "127.0.0.1");
  const auto [other_port, ignored_1] = bound_socket(SOCK_DGRAM, "127.0.0.1");
  const auto [other_host, ignored_2] = bound_socket(SOCK_DGRAM, "127.0.0.2");
  Intake intake(8);
  intake.connect_udp("127.0.0.1", port);
  intake.start();
  intake.send(0, "hello");
  char bytes[16];
  sockaddr_in client{};
  socklen_t size = sizeof client;
  ASSERT_EQ(recvfrom(server, bytes, sizeof bytes, 0, reinterpret_cast<sockaddr*>(&client), &size), 5);
  EXPECT_EQ(std::string(bytes, 5), "hello");
  Received received(intake);
  for (const int from : {other_host, server, other_port}) {
    const std::string text = from == other_host ? "stranger" : "answer";
    sendto(from, text.data(), text.size(), 0, reinterpret_cast<const sockaddr*>(&client), size);
  }
  ASSERT_TRUE(received.count(2));
  EXPECT_EQ(received.packets, (std::vector<std::string>{"answer", "answer"}));
  EXPECT_THROW(intake.connect_udp("localhost", 1), std::runtime_error);
  for (const int number : {server, other_port, other_host}) close(number);
}

TEST(Intake, TwoProgramsJoinAMulticastGroup) {
  const auto [server, port] = bound_socket(SOCK_DGRAM, "127.0.0.1");
  const sockaddr_in own = address_of("127.0.0.1", 0), group = address_of("239.255.42.98", port);
  setsockopt(server, IPPROTO_IP, IP_MULTICAST_IF, &own.sin_addr, sizeof own.sin_addr);
  Intake one(8), two(8), other(8);
  one.join_udp("127.0.0.1", "239.255.42.98", port, "127.0.0.1");
  two.join_udp("127.0.0.1", "239.255.42.98", port, "127.0.0.1");
  other.join_udp("127.0.0.2", "239.255.42.98", port, "127.0.0.1");  // of another server
  for (Intake* intake : {&one, &two, &other}) intake->start();
  for (int i = 0; i < 3; ++i) sendto(server, "data", 4, 0, reinterpret_cast<const sockaddr*>(&group), sizeof group);
  Received first(one), second(two), third(other);
  EXPECT_TRUE(first.count(3));
  EXPECT_TRUE(second.count(3));
  third.until([&, i = 0]() mutable { return ++i > 10; });
  EXPECT_TRUE(third.packets.empty());
  EXPECT_THROW(one.join_udp("127.0.0.1", "127.0.0.1", port, "0.0.0.0"), std::runtime_error);
  EXPECT_THROW(one.join_udp("127.0.0.1", "::1", port, "0.0.0.0"), std::runtime_error);
  close(server);
}

// Packets of a byte that states their size, and that many bytes. 'x' is no size.
std::size_t sized_packet(std::string_view bytes) {
  if (bytes.empty()) return 0;
  return bytes[0] == 'x' ? 1000 : 1 + static_cast<std::size_t>(bytes[0] - '0');
}

TEST(Intake, ConnectsToAServerAndDividesItsPacketsBySize) {
  const auto [server, port] = bound_socket(SOCK_STREAM, "127.0.0.1");
  Intake intake(8);
  intake.connect_tcp("127.0.0.1", port, sized_packet, "greeting");
  // Empty packets are left out before they wait.
  intake.translate([](const Arrival& packet) { return packet.bytes == "0" ? std::string_view() : packet.bytes; });
  intake.start();
  Received received(intake);
  std::this_thread::sleep_for(150ms);  // the server does not listen yet
  EXPECT_FALSE(intake.connected());
  ASSERT_EQ(listen(server, 1), 0);
  const auto accept_client = [server = server] {
    const int client = accept(server, nullptr, nullptr);
    char bytes[8];
    EXPECT_EQ(recv(client, bytes, sizeof bytes, MSG_WAITALL), 8);
    EXPECT_EQ(std::string(bytes, 8), "greeting");
    return client;
  };
  int client = accept_client();
  for (const char* part : {"3", "ab", "c", "1d0", "7seve", "n!?1"}) {
    send_text(client, part);
    std::this_thread::sleep_for(5ms);
  }
  ASSERT_TRUE(received.count(3));
  EXPECT_EQ(received.packets, (std::vector<std::string>{"3abc", "1d", "7seven!?"}));
  EXPECT_TRUE(intake.connected());
  close(client);  // within a packet
  client = accept_client();
  EXPECT_EQ(intake.counters().refused_cut, 1u);
  send_text(client, "1ax");  // no packet of this protocol: connected again
  close(accept_client());
  ASSERT_TRUE(received.count(4));
  EXPECT_EQ(received.packets.back(), "1a");
  EXPECT_EQ(intake.counters().refused_size, 1u);
  EXPECT_EQ(intake.counters().reconnects, 2u);
  close(client);
  close(server);
}

TEST(DeviceThread, OpensTheDeviceAgainAndStopsWithinASession) {
  std::atomic<int> sessions{0};
  {
    DeviceThread thread(8);
    EXPECT_FALSE(thread.connected());
    thread.start([&](DeviceThread& of) {
      const int session = ++sessions;
      if (session == 1) throw std::runtime_error("DeviceThread: a test without a device");
      of.opened();
      of.push(session == 2 ? "two" : "three", now());
      if (session == 2) return;  // lost
      while (!of.stops()) of.sleep(1'000'000'000);
    });
    std::vector<std::string> packets;
    std::vector<std::uint64_t> connections;
    for (int i = 0; i < 1000 && packets.size() < 2; ++i) {
      thread.take([&](const Arrival& packet) {
        packets.emplace_back(packet.bytes);
        connections.push_back(packet.connection);
      });
      std::this_thread::sleep_for(5ms);
    }
    EXPECT_EQ(packets, (std::vector<std::string>{"two", "three"}));
    ASSERT_EQ(connections.size(), 2u);
    EXPECT_NE(connections[0], connections[1]);
    EXPECT_TRUE(thread.connected());
    EXPECT_EQ(thread.counters().reconnects, 1u);
  }
  EXPECT_EQ(sessions, 3);
}

// A connection that cannot be accepted waits. It must not be tried again and again.
TEST(Intake, RestsWhileNoFileDescriptorIsFree) {
  LineIntake lines(8);
  const int peer = socket(AF_INET, SOCK_STREAM, 0);
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &limit), 0);
  const rlimit none{static_cast<rlim_t>(peer) + 1, limit.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  const sockaddr_in to = address_of("127.0.0.1", lines.port);
  EXPECT_EQ(connect(peer, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
  std::vector<int> taken;  // numbers below the limit
  for (int number; (number = dup(peer)) >= 0;) taken.push_back(number);
  std::this_thread::sleep_for(50ms);
  const std::clock_t before = std::clock();  // of all threads
  std::this_thread::sleep_for(400ms);
  const double used = static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC;
  const std::uint64_t open = lines.intake.counters().connections;
  setrlimit(RLIMIT_NOFILE, &limit);
  for (const int number : taken) close(number);
  EXPECT_EQ(open, 0u);
  EXPECT_LT(used, 0.1);
  send_text(peer, "here\n");
  EXPECT_TRUE(lines.received.count(1));
  close(peer);
}

TEST(Intake, TheOldestOfTooManyConnectionsIsClosed) {
  LineIntake lines(8);
  auto& [intake, port, received] = lines;
  std::vector<int> peers;
  for (std::size_t i = 1; i <= 17; ++i) {
    peers.push_back(lines.connect());
    send_text(peers.back(), "x\n");
    ASSERT_TRUE(received.count(i));
  }
  EXPECT_TRUE(received.until([&] { return intake.counters().connections == 16; }));
  char c;
  EXPECT_EQ(read(peers[0], &c, 1), 0);  // end of the stream
  for (const int peer : peers) close(peer);
}

TEST(Intake, RefusesAddressesAndPortsThatCannotBeBound) {
  Intake first(8), second(8);
  const std::uint16_t port = first.listen_udp("127.0.0.1", 0);
  EXPECT_THROW(second.listen_udp("127.0.0.1", port), std::runtime_error);
  EXPECT_THROW(second.listen_udp("localhost", 0), std::runtime_error);
  EXPECT_THROW(second.listen_tcp("300.0.0.1", 0, '\n'), std::runtime_error);
  EXPECT_THROW(second.open_serial("/dev/null", 12345, '\n'), std::invalid_argument);
}

// A serial device whose terminal has a fixed path.
class SerialDevice {
 public:
  explicit SerialDevice(const std::string& path) : path_(path) {
    std::filesystem::create_symlink(terminal_.path(), path);
  }
  ~SerialDevice() { std::filesystem::remove(path_); }
  void send(const std::string& text) { send_text(terminal_.file(), text); }
  /// All bytes that arrived, after at most 2 s until they end with `end`.
  std::string receive(const std::string& end) {
    std::string text;
    for (int i = 0; i < 400 && !text.ends_with(end); ++i) {
      char bytes[256];
      const ssize_t size = read(terminal_.file(), bytes, sizeof bytes);
      if (size > 0) text.append(bytes, static_cast<std::size_t>(size));
      if (size <= 0) std::this_thread::sleep_for(5ms);
    }
    return text;
  }

 private:
  std::string path_;
  testing::PseudoTerminal terminal_;
};

TEST(Intake, OpensASerialPortWhenItAppearsAndAgainAfterAPowerCycle) {
  const std::string path = ::testing::TempDir() + "softhand_serial_" + std::to_string(getpid());
  Intake intake(32);
  intake.open_serial(path, 115200, '\n');
  intake.start();
  Received received(intake);
  std::this_thread::sleep_for(150ms);  // no device yet
  EXPECT_FALSE(intake.connected());
  for (std::size_t cycle = 0; cycle < 3; ++cycle) {
    SerialDevice device(path);
    ASSERT_TRUE(received.until([&] { return intake.connected() && intake.counters().reconnects == cycle; }));
    device.send("A10B20\nA1");
    device.send("1B21\n");
    ASSERT_TRUE(received.count(2 * cycle + 2));
    EXPECT_EQ(received.packets[2 * cycle], "A10B20");
    EXPECT_EQ(received.packets[2 * cycle + 1], "A11B21");
  }
  EXPECT_TRUE(received.until([&] { return !intake.connected(); }));
}

std::string receive_line(int number) {
  std::string text;
  for (char c = 0; read(number, &c, 1) == 1 && c != '\n';) text += c;
  return text;
}

TEST(Intake, SendsToOneConnectionOrToAll) {
  LineIntake lines(32);
  auto& [intake, port, received] = lines;
  const int first = lines.connect();
  send_text(first, "1\n");
  ASSERT_TRUE(received.count(1));
  const int second = lines.connect();
  send_text(second, "2\n");
  ASSERT_TRUE(received.count(2));
  intake.send(received.connections[1], "to the second\n");
  intake.send(received.connections[0], "to the first\n");
  EXPECT_EQ(receive_line(first), "to the first");
  EXPECT_EQ(receive_line(second), "to the second");
  intake.send(0, "to both\n");
  EXPECT_EQ(receive_line(first), "to both");
  EXPECT_EQ(receive_line(second), "to both");
  std::thread([&intake = intake] { intake.release(); }).join();
  EXPECT_EQ(receive_line(first), "let go");
  EXPECT_EQ(receive_line(second), "let go");
  intake.send(99, "to nobody\n");
  close(first);
  ASSERT_TRUE(received.until([&] { return intake.counters().connections == 1; }));
  intake.send(received.connections[0], "to a closed one\n");
  intake.send(0, "to the rest\n");
  EXPECT_EQ(receive_line(second), "to the rest");
  close(second);
}

// A device that takes nothing for a while gets whole packets, and the newest one last.
TEST(Intake, OnlyTheNewestPacketWaitsForASlowDevice) {
  LineIntake lines(1024);
  auto& [intake, port, received] = lines;
  const int peer = lines.connect();
  send_text(peer, "1\n");
  ASSERT_TRUE(received.count(1));
  int sent = 0;
  for (; intake.counters().superseded < 20 && sent < 100'000; ++sent) {
    intake.send(0, std::string(1000, 'x') + std::to_string(sent) + "\n");
    std::this_thread::sleep_for(20us);
  }
  ASSERT_GE(intake.counters().superseded, 20u);
  std::this_thread::sleep_for(20ms);  // the queue is empty
  intake.send(0, "newest\n");
  int count = 0;
  for (std::string line; (line = receive_line(peer)) != "newest"; ++count) {
    ASSERT_GT(line.size(), 1000u);
    ASSERT_EQ(line.find_first_not_of('x'), 1000u);
    ASSERT_EQ(line.find('x', 1000), std::string::npos);
  }
  EXPECT_GT(count, 1);
  EXPECT_LT(count, sent - 10);
  close(peer);
}

TEST(Intake, WritesItsLastPacketAtTheEnd) {
  const std::string path = ::testing::TempDir() + "softhand_serial_out_" + std::to_string(getpid());
  SerialDevice device(path);
  auto intake = std::make_unique<Intake>(32);
  intake->open_serial(path, 115200, '\n');
  intake->start();
  Received received(*intake);
  ASSERT_TRUE(received.until([&] { return intake->connected(); }));
  intake->send(0, "A1000\n");
  EXPECT_EQ(device.receive("A1000\n"), "A1000\n");
  intake->send(0, "A0\n");
  intake.reset();
  EXPECT_EQ(device.receive("A0\n"), "A0\n");
}

TEST(Intake, SendingDoesNotAllocate) {
  LineIntake lines(64);
  auto& [intake, port, received] = lines;
  const int peer = lines.connect();
  send_text(peer, "1\n");
  ASSERT_TRUE(received.count(1));
  const std::string text = std::string(63, 'x') + "\n";
  char bytes[64];
  counting = true;
  const long before = allocations;
  for (int i = 0; i < 200; ++i) {
    intake.send(0, text);
    std::this_thread::sleep_for(100us);
    EXPECT_GE(recv(peer, bytes, sizeof bytes, MSG_DONTWAIT), -1);
  }
  counting = false;
  EXPECT_EQ(allocations, before);
  close(peer);
}

TEST(Intake, TakingDoesNotAllocate) {
  Intake intake(64);
  const std::uint16_t port = intake.listen_udp("127.0.0.1", 0);
  intake.start();
  const int sender = connected_socket(SOCK_DGRAM, port);
  const std::string text(64, 'x');
  std::size_t taken = 0;
  send_text(sender, text);
  std::this_thread::sleep_for(50ms);  // the thread has started
  const long before = allocations;
  counting = true;
  for (int i = 0; i < 200; ++i) {
    ::send(sender, text.data(), text.size(), 0);
    intake.take([&](const Arrival& packet) { taken += packet.bytes.size(); });
    std::this_thread::sleep_for(100us);
  }
  counting = false;
  EXPECT_GT(taken, 100 * text.size());
  EXPECT_EQ(allocations, before);
  close(sender);
}

}  // namespace
}  // namespace softhand::driver_sdk_test
