// `softhand doctor`: what is missing for a device, with simulators of devices and without.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "device/driver_check.hpp"
#include "haptics/dhd/stand_in.hpp"
#include "haptics/openhaptics/stand_in.hpp"
#include "support/free_port.hpp"
#include "support/shared_struct.hpp"
#include "support/tracker_process.hpp"
#ifdef SOFTHAND_SOCKET_TRACKERS
#include "haptics/haply/simulated_inverse3.hpp"
#include "tactile/bhaptics/simulated_player.hpp"
#endif

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
  for (const char* device : {"natnet", "vrpn", "opengloves", "streamer", "dhd", "weart"})
    EXPECT_TRUE(has(list, device)) << list;
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

// A port whose program accepts connections and says nothing.
class SilentServer {
 public:
  SilentServer() : listener_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in own = testing::loopback(0);
    socklen_t size = sizeof own;
    EXPECT_EQ(bind(listener_, reinterpret_cast<const sockaddr*>(&own), size), 0);
    EXPECT_EQ(listen(listener_, 8), 0);
    getsockname(listener_, reinterpret_cast<sockaddr*>(&own), &size);
    port_ = ntohs(own.sin_port);
  }
  ~SilentServer() { close(listener_); }
  std::string port() const { return std::to_string(port_); }

 private:
  int listener_, port_ = 0;
};

TEST(Doctor, AsksWeartsMiddlewareForItsVersionAndItsGloves) {
  const std::string port = std::to_string(testing::free_port(SOCK_STREAM));
  const std::string weart = "weart --set tactile_weart.port=";
  const auto [off, off_code] = doctor(weart + port);
  EXPECT_EQ(off_code, 1);
  EXPECT_TRUE(has(off, "Start the middleware")) << off;
  const testing::Process middleware("simulate-tactile-weart", {port}, false);
  std::pair<std::string, int> on;
  for (int i = 0; i < 100 && (i == 0 || on.second != 0); ++i) on = doctor(weart + port);  // until it listens
  EXPECT_EQ(on.second, 0) << on.first;
  EXPECT_TRUE(has(on.first, "it has version 2.0.0 and status code 0")) << on.first;
  EXPECT_TRUE(has(on.first, "connected devices: 0 left, 1 right")) << on.first;
  const SilentServer silent;
  const auto [text, code] = doctor(weart + silent.port());
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(has(text, "it does not say its state within 1 s")) << text;
}

#ifdef SOFTHAND_SOCKET_TRACKERS
std::string haply_at(int port, int event_port) {
  return "haply --set haptic_haply.port=" + std::to_string(port) +
         " --set haptic_haply.event_port=" + std::to_string(event_port);
}

TEST(Doctor, AsksHaplysServiceForItsVersionAndItsDevice) {
  const auto [off, off_code] = doctor(haply_at(testing::free_port(SOCK_STREAM), testing::free_port(SOCK_STREAM)));
  EXPECT_EQ(off_code, 1);
  EXPECT_TRUE(has(off, "Start the service")) << off;
  EXPECT_TRUE(has(off, "Correct `event_port`")) << off;
  for (const std::string key : {"vector", "values"}) {
    SimulatedInverse3 device(0, 0, key);
    const std::string haply = haply_at(device.port(), device.event_port());
    const auto [on, on_code] = doctor(haply);
    EXPECT_EQ(on_code, 0) << on;
    EXPECT_TRUE(has(on, key == "vector" ? "of version 3.5 or later" : "older than version 3.5")) << on;
    EXPECT_TRUE(has(on, "Inverse3 '049D' is connected")) << on;
    EXPECT_EQ(device.messages(), 0);  // a question would take the turn of a driver
    const auto [other, other_code] = doctor(haply + " --set haptic_haply.device_id=0001");
    EXPECT_EQ(other_code, 1);
    EXPECT_TRUE(has(other, "no Inverse3 '0001' is connected")) << other;
    device.unplug(true);
    const auto [none, none_code] = doctor(haply);
    EXPECT_EQ(none_code, 1);
    EXPECT_TRUE(has(none, "no Inverse3 is connected")) << none;
  }
  const SilentServer silent;
  const auto [text, code] = doctor("haply --set haptic_haply.event_port=0 --set haptic_haply.port=" + silent.port());
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(has(text, "no WebSocket clients at /")) << text;
  for (const std::string first : {"hello", "{}", R"({"version":7})", R"({"inverse3":{}})"}) {
    SimulatedService other(0, {[&](const std::string&) { return first; }, {}, {}});
    const auto [hello, hello_code] = doctor(haply_at(other.port(), 0));
    EXPECT_EQ(hello_code, 1);
    EXPECT_TRUE(has(hello, "its first message does not list devices")) << first << hello;
  }
}

TEST(Doctor, AsksBhapticsPlayerForItsGloves) {
  const std::string bhaptics = "bhaptics --set tactile_bhaptics.port=";
  const auto [off, off_code] = doctor(bhaptics + std::to_string(testing::free_port(SOCK_STREAM)));
  EXPECT_EQ(off_code, 1);
  EXPECT_TRUE(has(off, "Start the Player")) << off;
  SimulatedPlayer player(0);
  const auto [on, on_code] = doctor(bhaptics + std::to_string(player.port()));
  EXPECT_EQ(on_code, 0) << on;
  EXPECT_TRUE(has(on, "messages of version 2")) << on;
  EXPECT_TRUE(has(on, "connected: GloveL GloveR")) << on;
  EXPECT_EQ(player.target(), "/v2/feedbacks?app_id=softhand_doctor&app_name=softhand_doctor");
  EXPECT_EQ(player.messages(), 0);
  SimulatedService without(0, {[](const std::string&) { return std::string(R"({"ConnectedPositions":[]})"); }, {}, {}});
  const auto [none, none_code] = doctor(bhaptics + std::to_string(without.port()));
  EXPECT_EQ(none_code, 1);
  EXPECT_TRUE(has(none, "no TactGlove is connected")) << none;
  SimulatedService quiet(0, {});
  const auto [text, code] = doctor(bhaptics + std::to_string(quiet.port()));
  EXPECT_EQ(code, 0) << text;
  EXPECT_TRUE(has(text, "it did not list its devices")) << text;
}
#endif

TEST(Doctor, LoadsForceDimensionsLibraryAndCountsDevices) {
  testing::SharedStruct<DhdStandIn> device(kDhdStandInFile);
  const std::string dhd = "dhd --set haptic_dhd.library=";
  const auto [on, on_code] = doctor(dhd + DHD_STAND_IN);
  EXPECT_EQ(on_code, 0) << on;
  EXPECT_TRUE(has(on, "it sees 1 device\n")) << on;
  EXPECT_EQ(device->opened, 0);
  EXPECT_EQ(doctor(dhd + DHD_STAND_IN + " --set haptic_dhd.index=1").second, 1);
  device->is_present = false;
  const auto [off, off_code] = doctor(dhd + DHD_STAND_IN);
  EXPECT_EQ(off_code, 1);
  EXPECT_TRUE(has(off, "it sees 0 devices")) << off;
  EXPECT_TRUE(has(off, "Connect the device")) << off;
  const auto [other, other_code] = doctor(dhd + "libc.so.6");
  EXPECT_EQ(other_code, 1);
  EXPECT_TRUE(has(other, "libc.so.6: has no function dhd")) << other;
  const auto [none, none_code] = doctor(dhd + "/nowhere/libdhd.so.3");
  EXPECT_EQ(none_code, 1);
  EXPECT_TRUE(has(none, "Install the Force Dimension SDK")) << none;
}

TEST(Doctor, LoadsOpenHapticsAndOpensTheDevice) {
  testing::SharedStruct<HdStandIn> device(kHdStandInFile);
  const std::string openhaptics = "openhaptics --set haptic_openhaptics.library=";
  const auto [on, on_code] = doctor(openhaptics + HD_STAND_IN);
  EXPECT_EQ(on_code, 0) << on;
  EXPECT_TRUE(has(on, "the default device can be opened")) << on;
  EXPECT_EQ(device->opened, 1);
  EXPECT_EQ(device->closed, 1);
  EXPECT_FALSE(device->is_enabled);
  device->is_present = false;
  const auto [off, off_code] = doctor(openhaptics + HD_STAND_IN + " --set haptic_openhaptics.device=left");
  EXPECT_EQ(off_code, 1);
  EXPECT_TRUE(has(off, "device 'left': HD error 0x0302")) << off;
  const auto [other, other_code] = doctor(openhaptics + "libc.so.6");
  EXPECT_EQ(other_code, 1);
  EXPECT_TRUE(has(other, "libc.so.6: has no function hdInitDevice")) << other;
}

// Folders as the kernel's, with a device that nobody may open, one that everybody may open, and a serial port.
class UsbTree : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = "/tmp/softhand_usb_XXXXXX";
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
    std::filesystem::permissions(root_, std::filesystem::perms(0755));
    add("1-1", "1451", "0402", 4, 0);
    add("1-2", "1451", "040c", 5, 0666);
    add("1-3", "2988", "0302", 6, 0);
    std::filesystem::create_directories(devices() / "1-3" / "1-3:1.0" / "tty" / "ttyACM0");
    write(root_ / "dev" / "ttyACM0", "", 0666);
    std::filesystem::create_directories(devices() / "1-1:1.0");  // an interface
    // Root may open everything.
    ASSERT_EQ(seteuid(geteuid() == 0 ? 65534 : geteuid()), 0);
  }
  void TearDown() override {
    ASSERT_EQ(seteuid(getuid()), 0);
    std::filesystem::remove_all(root_);
  }
  DriverChecks check(int vendor, int product = -1) const { return check_usb(vendor, product, root_.string()); }

 private:
  std::filesystem::path devices() const { return root_ / "sys" / "bus" / "usb" / "devices"; }
  static void write(const std::filesystem::path& path, const std::string& text, int permissions) {
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << text << "\n";
    std::filesystem::permissions(path, std::filesystem::perms(permissions));
  }
  void add(const std::string& name, const std::string& vendor, const std::string& product, int number,
           int permissions) {
    write(devices() / name / "idVendor", vendor, 0444);
    write(devices() / name / "idProduct", product, 0444);
    write(devices() / name / "busnum", "1", 0444);
    write(devices() / name / "devnum", std::to_string(number), 0444);
    write(root_ / "dev" / "bus" / "usb" / "001" / ("00" + std::to_string(number)), "", permissions);
  }
  std::filesystem::path root_;
};

TEST_F(UsbTree, DevicesThatThisUserMayNotOpenAreMissing) {
  const DriverChecks refused = check(0x1451, 0x0402);
  ASSERT_EQ(refused.size(), 1u);
  EXPECT_FALSE(refused[0].is_good);
  EXPECT_TRUE(has(refused[0].found, "USB device 1451:0402")) << refused[0].found;
  EXPECT_TRUE(has(refused[0].found, "/dev/bus/usb/001/004: Permission denied")) << refused[0].found;
  EXPECT_TRUE(has(refused[0].advice, R"(ATTR{idVendor}=="1451", TAG+="uaccess")")) << refused[0].advice;
  const DriverChecks allowed = check(0x1451, 0x040c);
  ASSERT_EQ(allowed.size(), 1u);
  EXPECT_TRUE(allowed[0].is_good) << allowed[0].found;
  EXPECT_EQ(check(0x1451).size(), 2u);
  EXPECT_TRUE(check(0x0403, 0xcb48).empty());
}

TEST_F(UsbTree, TheSerialPortOfADeviceIsOpenedInItsPlace) {
  const DriverChecks found = check(0x2988);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_TRUE(found[0].is_good) << found[0].found;
  EXPECT_TRUE(has(found[0].found, "/dev/ttyACM0 can be opened")) << found[0].found;
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
