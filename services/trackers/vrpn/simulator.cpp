// simulate-tracker-vrpn PORT [z-up]: a VRPN server at 127.0.0.1 with the tracker "Tracker0": sensors 0 and 1 move as
// wrists, left and right, and sensor 2 as a head, at 100 Hz. Prints a line when it listens.
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "device/body_mount.hpp"
#include "runtime/clock.hpp"
#include "trackers/vrpn/simulated_vrpn.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  if (argc < 2) {
    std::fprintf(stderr, "usage: simulate-tracker-vrpn PORT [z-up]\n");
    return 2;
  }
  const bool is_z_up = argc > 2 && std::string(argv[2]) == "z-up";
  sockaddr_in own{};
  own.sin_family = AF_INET;
  own.sin_port = htons(static_cast<std::uint16_t>(std::stoi(argv[1])));
  own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int server = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0), yes = 1;
  setsockopt(server, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (bind(server, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0 || listen(server, 4) != 0) {
    std::perror("simulate-tracker-vrpn: listen");
    return 1;
  }
  std::printf("VRPN listens on TCP port %s\n", argv[1]);
  std::fflush(stdout);

  struct Client {
    int socket;
    std::string cookie;
    bool is_gone = false;
  };
  std::vector<Client> clients;
  const Nanoseconds start = now(), offset = 1'000'000'000'000'000'000;  // the server's clock is another one
  for (;;) {
    if (const int client = accept4(server, nullptr, nullptr, SOCK_NONBLOCK); client >= 0) {
      setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
      const std::string greeting = vrpn_cookie();
      send(client, greeting.data(), greeting.size(), MSG_NOSIGNAL);
      clients.push_back({client, ""});
    }
    const double time = static_cast<double>(now() - start) * 1e-9;
    std::string poses;
    for (std::int32_t sensor = 0; sensor < 3; ++sensor) {
      Pose pose{Vector3(sensor == 2 ? 0 : 0.4 * sensor - 0.2, sensor == 2 ? 1.6 : 1.1, -0.3),
                Quaternion(Eigen::AngleAxisd(0.3 * std::sin(time), Vector3::UnitY()))};
      pose.position.x() += 0.05 * std::sin(2 * time);
      if (is_z_up) pose = to_z_up(pose);
      poses += vrpn_pose(5, 3, now() + offset, sensor, pose);
    }
    for (Client& client : clients) {
      char bytes[256];
      const ssize_t count = recv(client.socket, bytes, sizeof bytes, MSG_DONTWAIT);
      if (count > 0 && client.cookie.size() < kVrpnHeader) {
        client.cookie.append(bytes, static_cast<std::size_t>(count));
        // Like VRPN's own server it tells its names after the client's cookie.
        if (client.cookie.size() >= kVrpnHeader) {
          const std::string names = vrpn_greeting().substr(kVrpnHeader);
          client.is_gone = !is_vrpn_cookie(client.cookie.substr(0, kVrpnHeader));
          send(client.socket, names.data(), names.size(), MSG_NOSIGNAL);
        }
      }
      if (count == 0) client.is_gone = true;
      if (client.cookie.size() < kVrpnHeader) continue;
      if (send(client.socket, poses.data(), poses.size(), MSG_NOSIGNAL) < 0) client.is_gone = true;
    }
    std::erase_if(clients, [](const Client& client) { return client.is_gone && close(client.socket) == 0; });
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}
