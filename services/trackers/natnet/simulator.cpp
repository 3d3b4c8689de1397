// simulate-tracker-natnet PORT 3.0|3.1|4.0|4.1 [multicast PORT] [local] [z-up]: Motive at 127.0.0.1 with the skeleton
// "Actor", whose hands close and open, rigid bodies 1 and 2 on its left and right wrist, and 3 on a moving head, at
// 120 Hz. Like Motive it sends unicast to clients that spoke within the last three seconds, or multicast to
// 239.255.42.99. Prints a line when it listens.
#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "runtime/clock.hpp"
#include "trackers/natnet/simulated_motive.hpp"
#include "trackers/replay/generator.hpp"

namespace {
using namespace softhand;

constexpr std::uint64_t kTicksPerSecond = 3'312'787;  // of the captured server
constexpr Nanoseconds kForgetAfter = 3'000'000'000, kPeriod = 8'333'333;
constexpr Nanoseconds kClockOffset = 77'000'000'000;  // the server's clock is another one

struct Client {
  sockaddr_in address;
  Nanoseconds heard;
};

sockaddr_in address_of(const char* host, int port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(static_cast<std::uint16_t>(port));
  inet_pton(AF_INET, host, &out.sin_addr);
  return out;
}
std::uint64_t ticks_at(Nanoseconds time) {
  return static_cast<std::uint64_t>(static_cast<double>(time + kClockOffset) * 1e-9 * kTicksPerSecond);
}
void send_to(int socket, const std::string& packet, const sockaddr_in& to) {
  sendto(socket, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
}
}  // namespace

int main(int argc, char** argv) {
  NatNetVersion version;
  if (argc < 3 || std::sscanf(argv[2], "%d.%d", &version.major, &version.minor) != 2) {
    std::fprintf(stderr, "usage: simulate-tracker-natnet PORT VERSION [multicast PORT] [local] [z-up]\n");
    return 2;
  }
  int multicast = 0;
  bool is_local = false, is_z_up = false;
  for (int i = 3; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "multicast" && i + 1 < argc) multicast = std::atoi(argv[++i]);
    is_local = is_local || word == "local";
    is_z_up = is_z_up || word == "z-up";
  }
  const int server = socket(AF_INET, SOCK_DGRAM, 0);
  const sockaddr_in own = address_of("127.0.0.1", std::atoi(argv[1])), group = address_of("239.255.42.99", multicast);
  setsockopt(server, IPPROTO_IP, IP_MULTICAST_IF, &own.sin_addr, sizeof own.sin_addr);
  if (bind(server, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0) {
    std::perror("simulate-tracker-natnet: bind");
    return 1;
  }
  std::printf("Motive listens on UDP port %s\n", argv[1]);
  std::fflush(stdout);

  const HandModel right = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  GeneratorOptions options;
  options.motion = "fist";
  const std::array motions{make_motion(mirrored(right), options), make_motion(right, options)};
  const std::string models = motive_models(version, "Actor", 1, true);
  std::vector<Client> clients;
  const Nanoseconds start = now();
  MotiveScene scene;
  scene.has_extras = true;
  for (Nanoseconds next = start;;) {
    pollfd wait{server, POLLIN, 0};
    poll(&wait, 1, static_cast<int>(std::max<Nanoseconds>(0, next - now()) / 1'000'000));
    char bytes[2048];
    sockaddr_in from{};
    socklen_t size = sizeof from;
    for (ssize_t count; (count = recvfrom(server, bytes, sizeof bytes, MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from),
                                          &size)) > 0;) {
      const std::string_view packet(bytes, static_cast<std::size_t>(count));
      const auto known = std::find_if(clients.begin(), clients.end(), [&](const Client& client) {
        return client.address.sin_port == from.sin_port && client.address.sin_addr.s_addr == from.sin_addr.s_addr;
      });
      if (known != clients.end()) {
        known->heard = now();
      } else if (const auto word = read_natnet(packet); word && word->message == NatNetMessage::connect) {
        clients.push_back({from, now()});
      }
      const std::string answer =
          motive_answer(packet, version, ticks_at(now()), kTicksPerSecond, models, multicast != 0);
      if (!answer.empty()) send_to(server, answer, from);
    }
    if (now() < next) continue;
    next += kPeriod;
    std::erase_if(clients, [](const Client& client) { return now() - client.heard > kForgetAfter; });
    const double time = static_cast<double>(now() - start) * 1e-9;
    const std::array<JointFrames, 2> hands{motions[0]->at(std::fmod(time, motions[0]->duration())),
                                           motions[1]->at(std::fmod(time, motions[1]->duration()))};
    const Pose head{Vector3(0.05 * std::sin(time), 1.6, 0), Quaternion::Identity()};
    scene.bodies = {{1, hands[0][1], true}, {2, hands[1][1], true}, {3, head, true}};
    scene.skeletons = {{1, motive_skeleton(hands, is_local)}};
    if (is_z_up) {
      for (NatNetBody& body : scene.bodies) body.pose = to_z_up(body.pose);
      for (NatNetBody& bone : scene.skeletons[0].bones) bone.pose = to_z_up(bone.pose);
    }
    const Nanoseconds exposure = now() - 4'000'000;  // cameras and solver take some milliseconds
    scene.time = time;
    scene.ticks = {ticks_at(exposure), ticks_at(exposure + 2'000'000), ticks_at(now())};
    const std::string frame = motive_frame(version, scene);
    ++scene.number;
    if (multicast != 0) {
      send_to(server, frame, group);
    } else {
      for (const Client& client : clients) send_to(server, frame, client.address);
    }
  }
}
