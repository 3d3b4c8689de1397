// The trackers that listen to sockets, as processes.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <cmath>
#include <string>

#include "messages/convert.hpp"
#include "model/hand_model.hpp"
#include "runtime/clock.hpp"
#include "support/tracker_process.hpp"
#include "support/webxr_frame.hpp"

namespace softhand {
namespace {

std::string scene() { return std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml"; }

/// A tracker on any free port.
class Tracker {
 public:
  Tracker(const std::string& program, const std::string& section)
      : process_(program, {"--config", scene(), "--set", section + ".port=0", "--source", "9"}, true) {}
  ~Tracker() {
    const int status = process_.end(SIGTERM);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }
  Tracker(const Tracker&) = delete;
  Tracker& operator=(const Tracker&) = delete;
  sockaddr_in address() const {
    sockaddr_in out{};
    out.sin_family = AF_INET;
    out.sin_port = htons(static_cast<std::uint16_t>(process_.number_after("ws://127.0.0.1:")));
    out.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return out;
  }

 private:
  testing::Process process_;
};

/// A WebSocket client that only sends.
class Client {
 public:
  Client(const Tracker& tracker, const std::string& origin) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const sockaddr_in address = tracker.address();
    EXPECT_EQ(connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    const std::string request =
        "GET / HTTP/1.1\r\nHost: localhost:1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: "
        "13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nOrigin: " +
        origin + "\r\n\r\n";
    EXPECT_EQ(::send(socket_, request.data(), request.size(), 0), static_cast<ssize_t>(request.size()));
    for (char c = 0; answer_.find("\r\n\r\n") == std::string::npos && recv(socket_, &c, 1, 0) == 1;) answer_ += c;
  }
  ~Client() { close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;
  bool accepted() const { return answer_.rfind("HTTP/1.1 101", 0) == 0; }
  void send(const std::string& bytes, bool binary) {
    std::string frame{static_cast<char>(binary ? 0x82 : 0x81)};
    if (bytes.size() < 126) {
      frame += static_cast<char>(0x80 | bytes.size());
    } else {
      frame +=
          {static_cast<char>(0x80 | 126), static_cast<char>(bytes.size() >> 8), static_cast<char>(bytes.size() & 255)};
    }
    frame += std::string(4, '\0');  // clients must send a mask, which may be zero
    frame += bytes;
    ::send(socket_, frame.data(), frame.size(), MSG_NOSIGNAL);
  }

 private:
  int socket_;
  std::string answer_;
};

class SocketTrackers : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
};

TEST_F(SocketTrackers, FramesOfAPageBecomeHandsAndHead) {
  testing::TrackerListener listener;
  const Tracker tracker("softhand-tracker-webxr", "tracker_webxr");
  EXPECT_FALSE(Client(tracker, "http://elsewhere.example").accepted());
  Client page(tracker, "http://localhost:8080");
  ASSERT_TRUE(page.accepted());
  const double zero = static_cast<double>(now()) * 1e-6 - 5000;  // the zero of the page's clock, ms
  const auto time = [&] { return static_cast<double>(now()) * 1e-6 - zero; };
  ASSERT_TRUE(listener.until([&] { page.send(testing::webxr_frame(time(), time()), true); },
                             [&] {
                               return listener.count > 40 && listener.head.valid == 1 &&
                                      listener.hands[0].source == 9 && listener.hands[1].source == 9;
                             }));
  const Skeleton& right = listener.hands[1];
  EXPECT_EQ(right.joints[0].flags, kJointValid | kJointInferred);
  EXPECT_NEAR(right.joints[25].position[2], -0.25, 1e-6);
  EXPECT_NEAR(listener.head.position[1], 1.6, 1e-6);
  EXPECT_LE(right.stamp.sample_time, right.stamp.publish_time);
  EXPECT_LT(now() - right.stamp.sample_time, 500'000'000);  // on the clock of this process

  page.send(testing::webxr_frame(std::nan(""), 1), true);
  page.send("short", true);
  page.send("text", false);
  std::string version = testing::webxr_frame(time(), time());
  version[4] = 9;
  page.send(version, true);
  ASSERT_TRUE(listener.until([] {}, [&] { return listener.counter("refused_version") == 1; }));
  EXPECT_EQ(listener.counter("refused_content"), 1);
  EXPECT_EQ(listener.counter("refused_size"), 1);
  EXPECT_EQ(listener.counter("refused_type"), 1);
  EXPECT_EQ(listener.counter("refused_origin"), 1);
  page.send(std::string(9000, 'x'), true);  // closes the connection
  ASSERT_TRUE(listener.until(
      [] {}, [&] { return listener.counter("refused_size") == 2 && listener.counter("connections") == 0; }));
  Client again(tracker, "http://localhost:8080");
  const int before = listener.count;
  EXPECT_TRUE(listener.until([&] { again.send(testing::webxr_frame(time(), time()), true); },
                             [&] { return listener.count > before + 10; }));
}

// A right hand at rest, in the camera's axes.
std::string landmarks_message() {
  const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  const auto joint_of_landmark = [](int i) {
    return i == 0 ? 1 : i <= 4 ? i + 1 : 7 + 5 * ((i - 5) / 4) + (i - 5) % 4;
  };
  std::string text = R"({"version":1,"hand":"right","coordinates":"world","landmarks":[)";
  for (int i = 0; i < 21; ++i) {
    const Vector3 p = hand.rest_joints[static_cast<std::size_t>(joint_of_landmark(i))].position;
    text += (i > 0 ? ",[" : "[") + std::to_string(-p.x()) + "," + std::to_string(-p.y()) + "," + std::to_string(p.z()) +
            "]";
  }
  text += "]}";
  return text;
}

TEST_F(SocketTrackers, LandmarksBecomeAHandOverUdpAndWebSocket) {
  const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  const std::string text = landmarks_message();
  testing::TrackerListener listener;
  const Tracker tracker("softhand-tracker-landmarks", "tracker_landmarks");
  const int udp = ::socket(AF_INET, SOCK_DGRAM, 0);
  const sockaddr_in address = tracker.address();
  const auto send = [&](const std::string& bytes) {
    sendto(udp, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  };
  ASSERT_TRUE(listener.until([&] { send(text); }, [&] { return listener.count > 10; }));
  // The hand is 0.5 m in front of the camera, which looks along +Z from (0, 0.15, -0.5). The scene's hand is a finer
  // hand with the same anatomy.
  EXPECT_LT((to_vector(listener.hands[1].joints[1].position) - Vector3(0, 0.15, 0)).norm(), 1e-3);
  EXPECT_LT(
      (to_vector(listener.hands[1].joints[15].position) - hand.rest_joints[15].position - Vector3(0, 0.15, 0)).norm(),
      3e-3);
  EXPECT_EQ(listener.hands[1].source, 9u);

  Client page(tracker, "http://localhost:3000");
  ASSERT_TRUE(page.accepted());
  const int before = listener.count;
  EXPECT_TRUE(listener.until([&] { page.send(text, false); }, [&] { return listener.count > before + 10; }));
  send("{");
  send(std::string(9000, '{'));
  send(R"({"version":2})");
  EXPECT_TRUE(listener.until([] {},
                             [&] {
                               return listener.counter("refused_json") == 1 && listener.counter("refused_size") == 1 &&
                                      listener.counter("refused_version") == 1;
                             }));
  close(udp);
}

TEST_F(SocketTrackers, LatencyAdded) {
  testing::TrackerListener listener;
  {
    const Tracker tracker("softhand-tracker-webxr", "tracker_webxr");
    Client page(tracker, "http://localhost:8080");
    const auto time = [] { return static_cast<double>(now()) * 1e-6; };
    testing::check_latency(listener, "webxr", [&] { page.send(testing::webxr_frame(time(), time()), true); });
  }
  listener.hands = {};
  const Tracker tracker("softhand-tracker-landmarks", "tracker_landmarks");
  Client page(tracker, "http://localhost:3000");
  const std::string text = landmarks_message();
  testing::check_latency(listener, "landmarks, WebSocket", [&] { page.send(text, false); });
}

TEST_F(SocketTrackers, AnswerMessagesOfUnknownKeys) {
  testing::TrackerListener listener;
  const Tracker tracker("softhand-tracker-webxr", "tracker_webxr");
  bus::Writer messages(listener.participant, bus::topics::message);
  bus::Reader replies(listener.participant, bus::topics::message_reply);
  Message message;
  set_text(message.key, "colour");
  const auto says = [&](const char* module) {
    set_text(message.module, module);
    const std::uint64_t asked = message.id;
    std::string answer;
    listener.until(
        [&] {
          ++message.id;
          messages.write(message);
        },
        [&] {
          replies.take_all([&](const MessageReply& reply) {
            if (reply.id > asked && get_text(reply.module) == "tracker" && reply.result == kReplyIgnored)
              answer = get_text(reply.text);
          });
          return !answer.empty();
        });
    return answer;
  };
  EXPECT_EQ(says("tracker"), "unknown key; known: strength");
  EXPECT_EQ(says("hand"), "not for this module");
}

}  // namespace
}  // namespace softhand
