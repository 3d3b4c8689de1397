#include "device/driver.hpp"

#include <bit>

#include "device/packet_bytes.hpp"
#include "trackers/natnet/natnet_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const NatNetOptions& options) {
  // A greeting: its header, our name, and the newest version that we understand.
  PacketWriter<std::endian::little> greeting;
  greeting.add(std::uint16_t{0}).add(std::uint16_t{269}).add_padded("softhand", 260);
  greeting.add(std::uint8_t{4}).add(std::uint8_t{1}).add_padded("", 7);
  std::string answer;
  DriverChecks out{check_udp_server("Motive", options.server, options.command_port, greeting.bytes,
                                    "Start Motive, stream to the network of this machine, and open its firewall",
                                    answer)};
  if (out[0].is_good) {
    PacketReader<std::endian::little> in(answer);
    in.take(4 + 256 + 4);
    const int major = in.read<std::uint8_t>(), minor = in.read<std::uint8_t>();
    out.push_back({in.good() && major >= 3, "it speaks NatNet " + std::to_string(major) + "." + std::to_string(minor),
                   "Update Motive: this driver needs NatNet 3.0"});
  }
  if (options.skeleton.empty() && options.left.body == 0 && options.right.body == 0 && options.head.body == 0)
    out.push_back(
        {false, "nothing is chosen to be tracked", "Set `skeleton`, or `left.body`, `right.body`, `head.body`"});
  return out;
}

const RegisterDriver<NatNetOptions> driver{"tracker_natnet", "OptiTrack's Motive (NatNet).", check};
}  // namespace
