// The sample pad: the page shows its code, the traction of the simulation becomes packets, and every end is zero.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <algorithm>
#include <fstream>
#include <iterator>

#include "support/device_process.hpp"
#include "support/press.hpp"

namespace softhand {
namespace {

std::string text_of(const std::string& path) {
  std::ifstream in(std::string(SOFTHAND_SOURCE_DIR) + "/" + path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST(SamplePad, ThePageShowsItsCode) {
  const std::string page = text_of("docs/add-a-device.md");
  const std::string code = text_of("services/tactile/sample/sample_pad.hpp");
  ASSERT_FALSE(code.empty());
  EXPECT_NE(page.find("\n" + code + "```\n"), std::string::npos) << "docs/add-a-device.md differs from sample_pad.hpp";
}

// The pad's end of the wire.
class Pad {
 public:
  using Forces = std::array<float, 27>;

  Pad() : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof here;
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&here), size), 0);
    getsockname(socket_, reinterpret_cast<sockaddr*>(&here), &size);
    port_ = ntohs(here.sin_port);
  }
  ~Pad() { close(socket_); }
  Pad(const Pad&) = delete;
  Pad& operator=(const Pad&) = delete;
  std::uint16_t port() const { return port_; }
  /// The newest forces, N.
  const Forces& forces() {
    Forces packet;
    while (recv(socket_, packet.data(), sizeof packet, 0) == sizeof packet) forces_ = packet;
    return forces_;
  }

 private:
  int socket_;
  std::uint16_t port_ = 0;
  Forces forces_{};
};

class SamplePadProcess : public testing::DeviceProcess<SkinTraction> {
 protected:
  SamplePadProcess() : DeviceProcess("tactile-sample") {}
  Pad pad_;
};

TEST_F(SamplePadProcess, PinsPressAndShearAndEveryEndIsZero) {
  start({"port=" + std::to_string(pad_.port()), "maximum_force=5"});
  testing::press(input_, Finger::index, 2, 0.1);
  // The pin in the middle feels most. The friction on the skin is against the slip, away from the tip.
  EXPECT_TRUE(push([&] {
    const Pad::Forces& forces = pad_.forces();
    return forces[14] > 0.3f && forces[12] < -0.15f && forces[14] > forces[2] && forces[14] > forces[26];
  }));
  float press = 0, along = 0;
  for (std::size_t pin = 0; pin < 9; ++pin) {
    along += pad_.forces()[3 * pin];
    press += pad_.forces()[3 * pin + 2];
  }
  EXPECT_NEAR(press, 2, 0.2f) << "N; the pins are on a round surface";
  EXPECT_NEAR(along, -1, 0.01f) << "N";
  // The thumb is not on the pad.
  testing::press(input_, Finger::thumb, 2);
  testing::press(input_, Finger::index, 0);
  EXPECT_TRUE(push([&] { return pad_.forces() == Pad::Forces{}; }));
  testing::press(input_, Finger::index, 2);
  check_every_end([&] { return pad_.forces()[14] > 0.3f; }, [&] { return pad_.forces() == Pad::Forces{}; });
}

}  // namespace
}  // namespace softhand
