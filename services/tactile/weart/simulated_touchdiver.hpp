// A TouchDIVER for the right hand and its middleware, for the simulator and for tests.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdio>
#include <map>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tactile/weart/weart_messages.hpp"

namespace softhand {

/// Closures from 0 to 255, of the right hand. The left one is open.
inline std::string weart_tracking(int thumb, int index, int middle, int abduction = 128) {
  return "Tracking:TrackType1:" + std::to_string(index) + ":" + std::to_string(thumb) + ":" +
         std::to_string(abduction) + ":" + std::to_string(middle) + ":0:0:128:0~";
}

/// Serves one client at a time.
class SimulatedTouchDiver {
 public:
  explicit SimulatedTouchDiver(int port) : listener_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_port = htons(static_cast<std::uint16_t>(port));
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int yes = 1;
    setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (bind(listener_, reinterpret_cast<const sockaddr*>(&here), sizeof here) != 0 || listen(listener_, 4) != 0)
      throw std::runtime_error("cannot listen on port " + std::to_string(port));
    thread_ = std::thread([this] { run(); });
  }
  /// Cuts the connection, as a power cut does.
  ~SimulatedTouchDiver() {
    stop_ = true;
    thread_.join();
    if (client_ >= 0) close(client_);
    close(listener_);
  }
  SimulatedTouchDiver(const SimulatedTouchDiver&) = delete;
  SimulatedTouchDiver& operator=(const SimulatedTouchDiver&) = delete;

  int port() const {
    sockaddr_in here{};
    socklen_t size = sizeof here;
    getsockname(listener_, reinterpret_cast<sockaddr*>(&here), &size);
    return ntohs(here.sin_port);
  }
  void send(const std::string& bytes) {
    const std::lock_guard lock(mutex_);
    if (client_ >= 0) ::send(client_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }
  /// "force:INDEX" and the values that the client set, as text. Without an entry the effect is stopped.
  std::map<std::string, std::string> effects() const {
    const std::lock_guard lock(mutex_);
    return effects_;
  }
  /// Messages that are no effects, in their order.
  std::vector<std::string> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }

 private:
  void run() {
    while (!stop_) {
      pollfd files[2]{{listener_, POLLIN, 0}, {client_, POLLIN, 0}};
      poll(files, client_ >= 0 ? 2 : 1, 5);
      const std::lock_guard lock(mutex_);
      if (client_ >= 0 && files[1].revents != 0) receive();
      if (client_ < 0 && files[0].revents != 0) {
        client_ = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
        const int yes = 1;
        setsockopt(client_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        received_.clear();
      }
    }
  }
  void receive() {
    char bytes[4096];
    const ssize_t size = recv(client_, bytes, sizeof bytes, MSG_DONTWAIT);
    if (size <= 0) {
      close(client_);
      client_ = -1;
      return;
    }
    received_.append(bytes, static_cast<std::size_t>(size));
    for (std::size_t end; (end = received_.find(kWeartEnd)) != std::string::npos; received_.erase(0, end + 1))
      take(received_.substr(0, end));
  }
  void take(const std::string& message) {
    const std::size_t hand = message.find(":RIGHT:");
    if (hand == std::string::npos) {
      requests_.push_back(message);
      answer(message);
      return;
    }
    const std::string point = message.substr(hand + 7), effect = message.substr(0, hand);
    for (const std::string name : {"force", "temperature", "texture"}) {
      const std::string key = name + ":" + point;
      if (effect.compare(0, name.size() + 1, name + ":") == 0) effects_[key] = effect.substr(name.size() + 1);
      if (effect == "stop" + std::string(1, static_cast<char>(name[0] - 'a' + 'A')) + name.substr(1))
        effects_.erase(key);
    }
  }

  void answer(const std::string& question) {
    std::string state;
    if (question.find("\"MW_GET_STATUS\"") != std::string::npos)
      state = R"({"type":"MW_STATUS","ts":1,"data":{"status":"IDLE","version":"2.0.0","statusCode":0}}~)";
    if (question.find("\"DEVICES_GET_STATUS\"") != std::string::npos)
      state = R"({"type":"DEVICES_STATUS","ts":1,"data":{"devices":[{"handSide":"RIGHT","batteryLevel":80}]}}~)";
    ::send(client_, state.data(), state.size(), MSG_NOSIGNAL);
  }

  int listener_;
  int client_ = -1;
  std::atomic<bool> stop_{false};
  mutable std::mutex mutex_;
  std::string received_;
  std::map<std::string, std::string> effects_;
  std::vector<std::string> requests_;
  std::thread thread_;
};

}  // namespace softhand
