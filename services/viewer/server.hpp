// The pages that are open, and what each of them is sent.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "viewer/frames.hpp"
#include "web/listening.hpp"

namespace softhand::viewer {

enum class Keep : bool {
  no,   ///< for whoever shows it now
  yes,  ///< and, the newest of each instance, for pages that come later: descriptions
};

struct Outgoing {
  FrameType type = FrameType::gateway;
  std::uint32_t instance = 0;
  Frame frame;
  Keep keep = Keep::no;
};

struct ServerCounters {
  std::uint32_t pages = 0;
  std::uint64_t bytes_sent = 0;
  std::uint64_t frames_sent = 0;
  std::uint64_t frames_passed_over = 0;
  RefusalCounts refused{};
};

/// Each page gets what it shows, of each type and instance at most at the server's rate and at that which it asked for,
/// and never more than it takes: newer frames of a type and instance replace those that wait for their time or for a
/// message that is on its way. Who is let in: web/web_server.hpp. Thread-safe.
class Server {
 public:
  /// Listens from here on, and serves the files of `folder`; a page gets at most `rate_hz` frames of a type and
  /// instance a second. Throws std::runtime_error naming address and port where that is refused.
  Server(const web::Listening& listening, const std::string& folder, std::size_t max_pages, double rate_hz);
  ~Server();

  /// Where it is reached, e.g. http://127.0.0.1:8080
  const std::string& url() const;
  /// Where other machines reach it.
  const std::vector<std::string>& urls_elsewhere() const;
  /// Union of what the open pages show.
  TypeSet shown() const;
  void publish(std::vector<Outgoing> frames);
  /// Messages that pages sent since the last call, in order.
  std::vector<Message> take_messages();
  ServerCounters counters() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::viewer
