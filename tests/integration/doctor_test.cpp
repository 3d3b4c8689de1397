// `softhand doctor`: what is missing for a device, with simulators of devices and without.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdio>
#include <fstream>
#include <string>
#include <utility>

#include "device/driver_check.hpp"
#include "support/free_port.hpp"
#include "support/tracker_process.hpp"

namespace softhand {
namespace {

// Output and exit code of `softhand doctor ARGUMENTS`.
std::pair<std::string, int> doctor(const std::string& arguments) {
  std::FILE* const pipe =
      popen((std::string(SOFTHAND_PROGRAMS) + "/softhand doctor " + arguments + " 2>&1").c_str(), "r");
  std::string text;
  for (int c; (c = std::fgetc(pipe)) != EOF;) text += static_cast<char>(c);
  return {text, WEXITSTATUS(pclose(pipe))};
}
bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST(Doctor, ListsTheDevicesAndRefusesOthers) {
  const auto [list, code] = doctor("");
  EXPECT_EQ(code, 0);
  for (const char* device : {"natnet", "vrpn", "opengloves", "streamer"}) EXPECT_TRUE(has(list, device)) << list;
  const auto [text, refused] = doctor("toaster");
  EXPECT_EQ(refused, 1);
  EXPECT_TRUE(has(text, "no driver 'toaster'")) << text;
  EXPECT_EQ(doctor("natnet --set tracker_natnet.colour=1").second, 1);
}

TEST(Doctor, AsksServersForTheirVersion) {
  const std::string udp = std::to_string(testing::free_port(SOCK_DGRAM)),
                    tcp = std::to_string(testing::free_port(SOCK_STREAM));
  const std::string natnet = "natnet --set tracker_natnet.right.body=2 --set tracker_natnet.command_port=" + udp;
  const std::string vrpn = "tracker_vrpn --set tracker_vrpn.right.sensor=1 --set tracker_vrpn.port=" + tcp;
  for (const std::string& device : {natnet, vrpn}) {
    const auto [text, code] = doctor(device);
    EXPECT_EQ(code, 1);
    EXPECT_TRUE(has(text, "missing")) << text;
    EXPECT_TRUE(has(text, "Start ")) << text;
  }
  const testing::Process motive("simulate-tracker-natnet", {udp, "3.1"}, true),
      server("simulate-tracker-vrpn", {tcp}, true);
  const auto [of_natnet, natnet_code] = doctor(natnet);
  EXPECT_EQ(natnet_code, 0) << of_natnet;
  EXPECT_TRUE(has(of_natnet, "it speaks NatNet 3.1")) << of_natnet;
  const auto [of_vrpn, vrpn_code] = doctor(vrpn);
  EXPECT_EQ(vrpn_code, 0) << of_vrpn;
  EXPECT_TRUE(has(of_vrpn, "'vrpn: ver. 07.35'")) << of_vrpn;
  // Nothing is chosen.
  const auto [nothing, nothing_code] = doctor("vrpn --set tracker_vrpn.port=" + tcp);
  EXPECT_EQ(nothing_code, 1);
  EXPECT_TRUE(has(nothing, "no sensor is chosen")) << nothing;
}

TEST(DriverCheck, PortsThatAreTakenAreMissing) {
  const int taken = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in own = testing::loopback(0);
  socklen_t size = sizeof own;
  ASSERT_EQ(bind(taken, reinterpret_cast<const sockaddr*>(&own), size), 0);
  getsockname(taken, reinterpret_cast<sockaddr*>(&own), &size);
  EXPECT_FALSE(check_udp_listening("127.0.0.1", ntohs(own.sin_port)).is_good);
  close(taken);
  EXPECT_TRUE(check_udp_listening("127.0.0.1", ntohs(own.sin_port)).is_good);
  EXPECT_TRUE(check_tcp_listening("127.0.0.1", testing::free_port(SOCK_STREAM)).is_good);
  EXPECT_FALSE(check_tcp_listening("nowhere", 80).is_good);
}

TEST(DriverCheck, SaysWhyAFileASerialPortOrALibraryCannotBeUsed) {
  EXPECT_TRUE(check_serial("/dev/null").is_good);
  const DriverCheck missing = check_serial("/dev/ttyNOWHERE");
  EXPECT_FALSE(missing.is_good);
  EXPECT_TRUE(has(missing.advice, "Serial ports now:"));
  EXPECT_TRUE(check_library("libc.so.6", {"malloc"}, "").is_good);
  EXPECT_FALSE(check_library("libc.so.6", {"malloc", "LeapGetNow"}, "").is_good);
  EXPECT_FALSE(check_library("/nowhere.so", {}, "").is_good);
  EXPECT_FALSE(check_file("the key", "/nowhere.pem").is_good);
  EXPECT_TRUE(check_file("the list", "/etc/passwd").is_good);
}

}  // namespace
}  // namespace softhand
