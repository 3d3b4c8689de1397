// The open pages, and the frames that each of them gets.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "viewer/frames.hpp"
#include "web/listening.hpp"

namespace softhand::viewer {

enum class Retain : bool {
  no,   ///< only for pages that show it now
  yes,  ///< the newest of each instance is also sent to later pages (descriptions)
};

struct Outgoing {
  FrameType type = FrameType::gateway;
  std::uint32_t instance = 0;
  Frame frame;
  Retain retain = Retain::no;
};

struct ServerCounters {
  std::uint32_t pages = 0;
  std::uint64_t bytes_sent = 0;
  std::uint64_t frames_sent = 0;
  std::uint64_t frames_passed_over = 0;
  RefusalCounts refused{};
};

/// Each page gets the types that it shows. The rate per type and instance is limited by the server's rate and by the
/// requested rate. A page never gets more than it can take. If a frame waits for its time or for a message on its way,
/// a newer frame of its type and instance replaces it. Rules of access: web/web_server.hpp. Thread-safe.
class Server {
 public:
  /// Starts listening and serves the files of `folder`. At most `max_pages` pages may control, and as many others may
  /// watch. A page gets at most `rate_hz` frames per second of a type and instance. Throws std::runtime_error with
  /// address and port if listening fails.
  Server(const web::Listening& listening, const std::string& folder, std::size_t max_pages, double rate_hz);
  ~Server();

  /// URL for this machine, e.g. http://127.0.0.1:8080
  const std::string& url() const;
  /// URLs for other machines.
  const std::vector<std::string>& urls_elsewhere() const;
  /// Union of the types that the open pages show.
  TypeSet shown() const;
  void publish(std::vector<Outgoing> frames);
  /// Messages from pages since the last call, in order.
  std::vector<Message> take_messages();
  ServerCounters counters() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::viewer
