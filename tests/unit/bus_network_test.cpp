// The section [network], and the clocks of other hosts.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "bus/host_clocks.hpp"
#include "bus/network.hpp"
#include "messages/age.hpp"
#include "runtime/config.hpp"

namespace softhand::bus {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& path) {
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

class NetworkFile : public ::testing::Test {
 protected:
  NetworkFile() { fs::create_directories(folder_ / "keys"); }
  ~NetworkFile() override { fs::remove_all(folder_); }
  std::string write(const std::string& text) {
    std::ofstream(folder_ / "network.toml") << "[network]\n" << text;
    return (folder_ / "network.toml").string();
  }
  std::string error_of(const std::string& text) {
    try {
      read_network(write(text));
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "";
  }
  const fs::path folder_ = "/tmp/softhand_network_" + std::to_string(getpid());
};

TEST_F(NetworkFile, WithoutAFileNothingLeavesTheHost) {
  unsetenv("SOFTHAND_NETWORK");
  const Network network = network_from_environment();
  EXPECT_EQ(network.addresses, std::vector<std::string>{"127.0.0.1"});
  EXPECT_FALSE(network.leaves_host());
  EXPECT_EQ(cyclone_settings(network, "client"), text_of(SOFTHAND_SOURCE_DIR "/config/dds/cyclonedds.xml"))
      << "softhand cyclone > config/dds/cyclonedds.xml";
}

TEST_F(NetworkFile, EveryBadValueHasFileLineAndKey) {
  const std::pair<const char*, const char*> bad[] = {
      {"interfaces = \"nowhere0\"", "network.interfaces"},
      {"interfaces = \"\"", "network.interfaces"},
      {"interfaces = 3", "network.interfaces"},
      {"peers = \"10.1.0.300\"", "network.peers"},
      {"peers = \"a-name\"", "network.peers"},
      {"multicast = \"no\"", "network.multicast"},
      {"discovery_server = \"10.1.0.1\"", "network.discovery_server"},
      {"discovery_server = \"10.1.0.1:0\"", "network.discovery_server"},
      {"discovery_server = \"10.1.0.1:99999\"", "network.discovery_server"},
      {"security = \"missing\"", "network.security"},
      {"security = \"keys\"", "network.security"},
      {"profile = \"missing.xml\"", "network.profile"},
      {"clock = \"gps\"", "network.clock"},
      {"interface = \"lo\"", "network.interface"},
  };
  for (const auto& [line, key] : bad) {
    const std::string error = error_of(std::string(line) + "\n");
    EXPECT_NE(error.find("network.toml:2: "), std::string::npos) << line << ": " << error;
    EXPECT_NE(error.find(key), std::string::npos) << line << ": " << error;
  }
}

TEST_F(NetworkFile, ContradictionsAreRefused) {
  std::ofstream(folder_ / "profile.xml") << "<profiles/>";
  for (const char* file : {"authority.pem", "governance.p7s"}) std::ofstream(folder_ / "keys" / file) << "x";
  EXPECT_EQ(error_of("profile = \"profile.xml\"\nsecurity = \"keys\"\n"), "");
  EXPECT_NE(error_of("peers = \"10.1.0.1\"\nprofile = \"profile.xml\"\n").find("network.profile"), std::string::npos);
  EXPECT_NE(error_of("discovery_server = \"10.1.0.1:11811\"\nsecurity = \"keys\"\n").find("network.security"),
            std::string::npos);
  EXPECT_THROW(cyclone_settings(read_network(write("discovery_server = \"10.1.0.1:11811\"\n")), "client"), ConfigError);
  EXPECT_THROW(cyclone_settings(read_network(write("profile = \"profile.xml\"\n")), "client"), ConfigError);
}

TEST_F(NetworkFile, CycloneGetsTheSameSettings) {
  for (const char* file : {"authority.pem", "governance.p7s"}) std::ofstream(folder_ / "keys" / file) << "x";
  const Network network =
      read_network(write("multicast = false\npeers = \"10.1.0.2 10.1.0.3\"\nsecurity = \"keys\"\n"));
  const std::string xml = cyclone_settings(network, "tracker");
  for (const char* part :
       {"<AllowMulticast>false<", "<Peer Address=\"10.1.0.2\"/>", "<Peer Address=\"10.1.0.3\"/>",
        "/keys/tracker-cyclone/certificate.pem<", "/keys/authority.pem<", "/keys/tracker-cyclone/permissions.p7s<"})
    EXPECT_NE(xml.find(part), std::string::npos) << part;
}

constexpr std::uint32_t kOwn = 1, kOther = 2;
constexpr Nanoseconds kSecond = 1'000'000'000;
constexpr Nanoseconds kOffset = 3600 * kSecond;
constexpr Nanoseconds kDelay = 1'000'000;

/// A beacon of the other host that arrives at our time `received`. With `answers` it says when it got our last one.
ClockBeacon beacon(Nanoseconds received, bool answers) {
  ClockBeacon beacon;
  beacon.stamp.clock_id = kOther;
  beacon.stamp.publish_time = received - kDelay - kOffset;
  const Nanoseconds ours = received - 3 * kDelay;
  if (answers) beacon.hosts.push_back({kOwn, ours, ours + kDelay - kOffset, 0, -1, 0});
  return beacon;
}

Stamp stamp_of(std::uint32_t clock, Nanoseconds time) {
  Stamp stamp;
  stamp.clock_id = clock;
  stamp.sample_time = stamp.publish_time = stamp.chain.tracker_sample = time;
  return stamp;
}

TEST(HostClocks, AnUnknownClockIsRefusedAndAKnownOneIsConverted) {
  HostClocks clocks(kOwn, false);
  BoundedVector<HostClock, kMaxHosts> found;
  const Nanoseconds now = 10'000 * kSecond;
  Stamp stamp = stamp_of(kOther, now - kOffset);
  EXPECT_FALSE(clocks.to_local(stamp));
  EXPECT_FALSE(is_usable(stamp, now, kOwn));
  clocks.heard(beacon(now, false), now, {});
  clocks.update(now, found);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].sent, now - kDelay - kOffset) << "the next beacon answers this one";
  EXPECT_EQ(found[0].received, now);
  EXPECT_FALSE(clocks.to_local(stamp)) << "one direction is not enough";
  clocks.heard(beacon(now, true), now, {});
  clocks.update(now, found);
  ASSERT_TRUE(clocks.to_local(stamp));
  EXPECT_EQ(stamp.clock_id, kOwn);
  EXPECT_TRUE(is_usable(stamp, now, kOwn));
  for (const Nanoseconds time : {stamp.sample_time, stamp.publish_time, stamp.chain.tracker_sample})
    EXPECT_NEAR(static_cast<double>(time - now), 0, 1.2 * kDelay);
  EXPECT_EQ(stamp.chain.wrench_published, 0) << "unknown stays unknown";
  EXPECT_NEAR(clocks.hosts()[0].uncertainty, 1e-3, 0.2e-3);
  for (const std::uint32_t own : {0u, kOwn}) {
    Stamp local = stamp_of(own, now);
    EXPECT_TRUE(clocks.to_local(local));
    EXPECT_EQ(local.sample_time, now);
  }
}

TEST(HostClocks, AClockThatIsSilentForLongIsUnknown) {
  HostClocks clocks(kOwn, false);
  BoundedVector<HostClock, kMaxHosts> found;
  const Nanoseconds now = 10'000 * kSecond;
  clocks.heard(beacon(now, true), now, {});
  clocks.update(now + 5 * kSecond, found);
  Stamp stamp = stamp_of(kOther, now - kOffset);
  EXPECT_TRUE(clocks.to_local(stamp));
  clocks.update(now + 11 * kSecond, found);
  EXPECT_EQ(found.size(), 0u);
  stamp = stamp_of(kOther, now - kOffset);
  EXPECT_FALSE(clocks.to_local(stamp));
}

// One more host, or a program that invents clocks.
TEST(HostClocks, NewClocksTakeOnlyThePlaceOfSilentOnes) {
  HostClocks clocks(kOwn, false);
  BoundedVector<HostClock, kMaxHosts> found;
  Nanoseconds now = 10'000 * kSecond;
  const auto hear = [&](std::uint32_t id) {
    ClockBeacon sample = beacon(now, true);
    sample.stamp.clock_id = id;
    clocks.heard(sample, now, {});
  };
  const auto is_known = [&](std::uint32_t id) {
    Stamp stamp = stamp_of(id, now - kOffset);
    return clocks.to_local(stamp);
  };
  constexpr std::uint32_t kFirst = 100, kEnd = kFirst + kMaxHosts;
  std::uint32_t invented = 1000;
  std::uint64_t refused = 0;
  for (int round = 0; round < 20; ++round, now += kSecond / 10) {
    for (std::uint32_t id = kFirst; id < kEnd; ++id) hear(id);
    clocks.update(now, found);
    for (int i = 0; i < 16; ++i, ++refused) hear(invented++);
    for (std::uint32_t id = kFirst; id < kEnd; ++id) EXPECT_TRUE(is_known(id)) << id;
  }
  EXPECT_EQ(clocks.refused(), refused);
  for (int round = 0; round < 12; ++round, now += kSecond / 10) {
    for (std::uint32_t id = kFirst + 1; id < kEnd; ++id) hear(id);
    hear(kEnd);
    clocks.update(now, found);
  }
  EXPECT_TRUE(is_known(kEnd));
  EXPECT_FALSE(is_known(kFirst)) << "it is silent";
  EXPECT_TRUE(is_known(kFirst + 1));
}

// Differences of samples by differences of stamps are velocities.
TEST(HostClocks, TheOffsetInUseHasNoSteps) {
  HostClocks clocks(kOwn, false);
  BoundedVector<HostClock, kMaxHosts> found;
  Nanoseconds last = 0;
  double least = 1;
  for (int i = 0; i < 300; ++i) {
    const Nanoseconds now = 10'000 * kSecond + i * kSecond / 10;
    // The first messages from there are slow. Later ones show by how much.
    ClockBeacon sample = beacon(now, true);
    const Nanoseconds slow = i < 20 ? 10'000'000 : 0;
    clocks.heard(sample, now + slow, {});
    clocks.update(now + slow, found);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_LE(std::abs(static_cast<double>(found[0].offset - kOffset)), 1e9 * found[0].uncertainty);
    if (i > 0) {
      EXPECT_LE(std::abs(found[0].offset - last), 600'000) << i << ": 5 ms/s, and the growth of the bounds";
    }
    last = found[0].offset;
    least = std::min(least, found[0].uncertainty);
  }
  EXPECT_LT(least, 1.1e-3);
}

TEST(HostClocks, SynchronisedWallClocksGiveTheOffset) {
  HostClocks clocks(kOwn, true);
  BoundedVector<HostClock, kMaxHosts> found;
  const Nanoseconds now = 10'000 * kSecond;
  const WallClock ours{500 * kSecond, 50e-6};
  ClockBeacon sample = beacon(now, true);
  sample.wall_offset = ours.offset + kOffset;
  Stamp stamp = stamp_of(kOther, now - kOffset);
  clocks.heard(sample, now, ours);  // nobody keeps their wall clock
  clocks.update(now, found);
  EXPECT_FALSE(clocks.to_local(stamp));
  sample.wall_uncertainty = 20e-6;
  clocks.heard(sample, now, {ours.offset, -1});  // nobody keeps ours
  clocks.update(now, found);
  EXPECT_FALSE(clocks.to_local(stamp));
  clocks.heard(sample, now, ours);
  clocks.update(now, found);
  ASSERT_TRUE(clocks.to_local(stamp));
  EXPECT_EQ(stamp.sample_time, now);
  EXPECT_NEAR(clocks.hosts()[0].uncertainty, 70e-6, 1e-9);
}

TEST(HostClocks, AnyBeaconAndStampIsSafe) {
  constexpr Nanoseconds kFirst = std::numeric_limits<Nanoseconds>::min();
  constexpr Nanoseconds kLast = std::numeric_limits<Nanoseconds>::max();
  for (const bool synchronised : {false, true}) {
    HostClocks clocks(kOwn, synchronised);
    BoundedVector<HostClock, kMaxHosts> found;
    std::uint32_t id = kOther;
    for (const Nanoseconds a : {kFirst, Nanoseconds{0}, kLast}) {
      for (const Nanoseconds b : {kFirst, Nanoseconds{0}, kLast}) {
        ClockBeacon sample;
        sample.stamp.clock_id = id++;  // more hosts than there is room for
        sample.stamp.publish_time = a;
        sample.wall_offset = b;
        sample.wall_uncertainty = b == 0 ? std::numeric_limits<double>::quiet_NaN() : 0;
        sample.hosts.push_back({kOwn, a, b, b, 0, 0});
        for (int i = 0; i < 3; ++i) {
          clocks.heard(sample, 10'000 * kSecond, {0, 0});
          clocks.update(10'000 * kSecond, found);
          Stamp stamp = stamp_of(sample.stamp.clock_id, a);
          clocks.to_local(stamp);
        }
      }
    }
    for (std::uint32_t host = 100; host < 200; ++host) {
      ClockBeacon sample = beacon(10'000 * kSecond, true);
      sample.stamp.clock_id = host;
      clocks.heard(sample, 10'000 * kSecond, {});
    }
    EXPECT_EQ(clocks.hosts().size(), kMaxHosts);
  }
}

}  // namespace
}  // namespace softhand::bus
