// softhand-haptic-opengloves with its simulator: TCP and serial, power cycles, bad lines, forces, and its latency.
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "device/health.hpp"
#include "haptics/opengloves/simulated_glove.hpp"
#include "support/hung_loop.hpp"
#include "support/tracker_process.hpp"

namespace softhand::opengloves_process_test {
namespace {

// The glove's end of the wire.
class Glove {
 public:
  explicit Glove(int port) : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
    const int yes = 1;
    setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  }
  ~Glove() { close(socket_); }
  Glove(const Glove&) = delete;
  Glove& operator=(const Glove&) = delete;
  void send_text(const std::string& text) const {
    EXPECT_EQ(::send(socket_, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }
  void send_curl(int value) const { send_text(glove_line({value, value, value, value, value})); }
  /// The newest brakes.
  const std::array<int, 5>& forces() {
    char bytes[512];
    for (ssize_t size; (size = recv(socket_, bytes, sizeof bytes, MSG_DONTWAIT)) > 0;)
      received_.append(bytes, static_cast<std::size_t>(size));
    for (std::size_t end; (end = received_.find('\n')) != std::string::npos; received_.erase(0, end + 1)) {
      EXPECT_TRUE(read_forces(received_.substr(0, end), forces_)) << received_;
      ++lines_;
    }
    return forces_;
  }
  int lines() const { return lines_; }

 private:
  int socket_;
  std::string received_;
  std::array<int, 5> forces_{};
  int lines_ = 0;
};

class OpenGlovesProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  void start(std::vector<std::string> settings) {
    std::vector<std::string> arguments{
        "--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml", "--source", "6", "--device", "3"};
    for (const std::string& setting : settings) {
      arguments.emplace_back("--set");
      arguments.push_back("haptic_opengloves." + setting);
    }
    driver_.emplace("softhand-haptic-opengloves", arguments, true);
  }
  int start_tcp() {
    start({"port=0", "blocking_force=4"});
    return driver_->number_after("TCP port ");
  }
  bool health(Health of) {
    return listener_.until([] {}, [&] { return listener_.counter("health") == static_cast<double>(of); });
  }
  // Sends the force against closing on the index finger at 200 Hz, and a line of the glove at 100 Hz. Returns true as
  // soon as `done`.
  template <typename Done>
  bool push(const Glove& glove, double newton, const Done& done, bool glove_speaks = true) {
    for (int i = 0; i < 2000; ++i) {
      write_force(newton);
      if (glove_speaks && i % 2 == 0) glove.send_curl(1000);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      if (done()) return true;
    }
    return false;
  }
  void write_force(double newton) {
    wrench_.simulated_valid = 1;
    wrench_.stamp.clock_id = clock_id();
    wrench_.stamp.epoch = 7;
    ++wrench_.stamp.sequence;
    wrench_.stamp.sample_time = wrench_.stamp.publish_time = now();
    wrench_.bones[static_cast<std::size_t>(index_of(Body::index_distal))].coupling_force = {0, newton, 0};
    writer_.write(wrench_);
  }
  static double milliseconds_until_free(Glove& glove, Nanoseconds since) {
    while (glove.forces()[1] != 0 && now() - since < 1'000'000'000) std::this_thread::yield();
    return static_cast<double>(now() - since) * 1e-6;
  }

  testing::TrackerListener listener_;
  bus::Writer<BoneWrench> writer_{listener_.participant, bus::topics::bone_wrench};
  bus::Writer<Message> messages_{listener_.participant, bus::topics::message};
  BoneWrench wrench_;
  std::optional<testing::Process> driver_;
};

TEST_F(OpenGlovesProcess, FollowsTheSimulatorThroughPowerCycles) {
  const std::string path = ::testing::TempDir() + "softhand_glove_" + std::to_string(getpid());
  for (const std::string transport : {"tcp", "serial"}) {
    start(transport == "tcp" ? std::vector<std::string>{"port=0"} : std::vector<std::string>{"serial=" + path});
    const std::string place = transport == "tcp" ? std::to_string(driver_->number_after("TCP port ")) : path;
    listener_.status = {};
    ASSERT_TRUE(health(Health::opening));
    for (int cycle = 0; cycle < 2; ++cycle) {
      testing::Process glove("simulate-haptic-opengloves", {transport, place}, false);
      ASSERT_TRUE(health(Health::live)) << transport << cycle;
      const int before = listener_.count;
      const Nanoseconds since = now();
      ASSERT_TRUE(listener_.until([] {}, [&] { return listener_.count >= before + 100; }));
      // The glove waits up to 1 s for an answer to each line. At about 100 Hz, all are answered.
      EXPECT_LT(now() - since, 4'000'000'000) << transport << cycle;
      const Skeleton& hand = listener_.hands[1];
      EXPECT_EQ(hand.source, 6u);
      EXPECT_EQ(hand.frame, 2u);
      EXPECT_EQ(hand.joints[1].flags, kJointValid | kJointInferred);
      EXPECT_EQ(hand.joints[10].flags, kJointValid | kJointTracked);
      glove.end(SIGKILL);
      ASSERT_TRUE(health(Health::lost)) << transport << cycle;
    }
    EXPECT_EQ(listener_.counter("reconnects"), 1);
    for (const char* reason : {"syntax", "range", "repeated", "layout", "hand", "size"})
      EXPECT_EQ(listener_.counter(std::string("refused_") + reason), 0) << reason;
    EXPECT_EQ(driver_->end(SIGTERM), 0);
  }
  unlink(path.c_str());
}

TEST_F(OpenGlovesProcess, RefusesAndCountsBadLines) {
  std::optional<Glove> glove(start_tcp());
  const std::string line = glove_line({1, 2, 3, 4, 5});
  glove->send_text(line + line);
  for (std::size_t i = 0; i < line.size(); i += 3) {  // split
    glove->send_text(line.substr(i, 3));
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  glove->send_text(line + line.substr(0, line.size() - 1) + line);  // joined, and joined without an end
  glove->send_text("A1B2\n" + line + line);                         // truncated, then others than before, then good
  glove->send_text("A1B2x\n" + std::string(600, 'A') + "\nA9999\n" + line.substr(0, 7));
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("published") == 4; }));
  glove.reset();
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_cut") == 1; }));
  EXPECT_EQ(listener_.counter("published"), 4);
  EXPECT_EQ(listener_.counter("refused_repeated"), 1);
  EXPECT_EQ(listener_.counter("refused_layout"), 2);
  EXPECT_EQ(listener_.counter("refused_syntax"), 1);
  EXPECT_EQ(listener_.counter("refused_range"), 1);
  EXPECT_EQ(listener_.counter("refused_size"), 1);
}

TEST_F(OpenGlovesProcess, ForcesReachTheGloveAndEveryEndIsZero) {
  const int port = start_tcp();
  std::optional<Glove> glove(port);
  ASSERT_TRUE(push(*glove, 2, [&] { return glove->forces() == std::array<int, 5>{0, 500, 0, 0, 0}; }));
  EXPECT_TRUE(push(*glove, 50, [&] { return glove->forces()[1] == 1000; }));
  EXPECT_TRUE(push(*glove, -2, [&] { return glove->forces()[1] == 0; }));  // a brake cannot pull

  // The motors are switched off, also while the glove says nothing.
  for (const bool glove_speaks : {true, false}) {
    const auto motors = [&](const char* value) {
      Message message;
      message.id = static_cast<std::uint64_t>(now());
      set_text(message.module, "haptic-opengloves");
      set_text(message.key, "motors");
      set_text(message.value, value);
      message.stamp.publish_time = now();
      messages_.write(message);
    };
    motors("on");
    ASSERT_TRUE(push(*glove, 2, [&] { return glove->forces()[1] == 500; }));
    const Nanoseconds sent = now();
    motors("off");
    EXPECT_TRUE(push(
        *glove, 2, [&] { return glove->forces()[1] == 0; }, glove_speaks));
    std::printf("off: zero after %.1f ms\n", static_cast<double>(now() - sent) * 1e-6);
    EXPECT_LT(now() - sent, 50'000'000);
    motors("on");
  }

  // The simulation falls silent: zero 40 ms after the last input. The bound leaves room for a busy machine.
  ASSERT_TRUE(push(*glove, 2, [&] { return glove->forces()[1] == 500; }));
  const double silent = milliseconds_until_free(*glove, now());
  std::printf("silence: zero after %.1f ms\n", silent);
  EXPECT_LT(silent, 80);

  // The loop hangs while the simulation and the glove go on: zero after some 30 ms. Two ordinary threads do it, so a
  // busy machine needs longer. Without them the force would stay.
  ASSERT_TRUE(push(*glove, 2, [&] { return glove->forces()[1] == 500; }));
  {
    const Nanoseconds hung = now();
    const testing::HungLoop loop(driver_->id());
    const double released = milliseconds_until_free(*glove, hung);
    std::printf("hung loop: zero after %.1f ms\n", released);
    EXPECT_LT(released, 200);
  }

  // A glove that comes back gets forces on its new connection.
  ASSERT_TRUE(push(*glove, 2, [&] { return glove->forces()[1] == 500; }));
  Glove again(port);
  ASSERT_TRUE(push(again, 2, [&] { return again.forces()[1] == 500; }));
  EXPECT_GT(again.lines(), 0);

  const Nanoseconds stopped = now();
  EXPECT_EQ(driver_->end(SIGTERM), 0);
  std::printf("SIGTERM: zero after %.1f ms\n", milliseconds_until_free(again, stopped));
  EXPECT_EQ(again.forces()[1], 0);
  EXPECT_EQ(glove->forces()[1], 0);  // the earlier connection too
}

TEST_F(OpenGlovesProcess, StaysWithTheGloveWhenOthersConnect) {
  const int port = start_tcp();
  Glove glove(port);
  ASSERT_TRUE(push(glove, 2, [&] { return glove.forces()[1] == 500; }));
  const Glove stray(port);
  stray.send_text("GET / HTTP/1.1\n\n");
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_syntax") == 1; }));
  const int before = listener_.count;
  EXPECT_TRUE(push(glove, 3, [&] { return glove.forces()[1] == 750; }));
  EXPECT_TRUE(listener_.until([&] { glove.send_curl(1000); }, [&] { return listener_.count > before; }));
  // The earlier connection is let go, and is heard again after the newest one was silent.
  Glove again(port);
  ASSERT_TRUE(push(again, 3, [&] { return again.forces()[1] == 750; }));
  EXPECT_TRUE(push(again, 3, [&] { return glove.forces()[1] == 0; }));
  EXPECT_TRUE(push(glove, 3, [&] { return glove.forces()[1] == 750; }));
  EXPECT_TRUE(push(glove, 3, [&] { return again.forces()[1] == 0; }));
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("ignored_lines") > 0; }));
}

// A killed driver leaves the brakes as they are. The next one frees them with its first line, without an input.
TEST_F(OpenGlovesProcess, IsFreeWhenAKilledDriverIsBack) {
  const int port = start_tcp();
  std::optional<Glove> glove(port);
  ASSERT_TRUE(push(*glove, 2, [&] { return glove->forces()[1] == 500; }));
  driver_->end(SIGKILL);
  const Nanoseconds killed = now();
  start({"port=" + std::to_string(port)});
  glove.emplace(port);
  glove->send_curl(1000);
  while (glove->lines() == 0 && now() - killed < 5'000'000'000) glove->forces();
  std::printf("SIGKILL and restart: zero after %.1f ms\n", static_cast<double>(now() - killed) * 1e-6);
  EXPECT_GT(glove->lines(), 0);
  EXPECT_EQ(glove->forces()[1], 0);
}

// The fingers of the glove on the wrist of another tracker, in the hand that the simulation follows.
TEST_F(OpenGlovesProcess, GivesItsFingersToAFusion) {
  std::vector<std::string> arguments{"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml"};
  auto glove_arguments = arguments, fusion_arguments = arguments;
  for (const char* each : {"--set", "haptic_opengloves.port=0", "--user", "2"}) glove_arguments.emplace_back(each);
  for (const char* each : {"--module", "fusion"}) fusion_arguments.emplace_back(each);
  driver_.emplace("softhand-haptic-opengloves", glove_arguments, true);
  const testing::Process fusion("softhand-tracker-fusion", fusion_arguments, false);
  Glove glove(driver_->number_after("TCP port "));
  bus::Writer<Skeleton> camera(listener_.participant, bus::topics::tracked_skeleton);
  Skeleton wrist;
  wrist.hand = {1, 1};
  wrist.confidence = 1;
  wrist.stamp.epoch = 5;
  wrist.stamp.clock_id = clock_id();
  wrist.joints[1].position = {0.3, 1, 0};
  wrist.joints[1].flags = kJointValid | kJointTracked;
  const auto curled = [&](int value) {
    return listener_.until(
        [&] {
          glove.send_curl(value);
          ++wrist.stamp.sequence;
          wrist.stamp.sample_time = wrist.stamp.publish_time = wrist.stamp.chain.tracker_sample = now();
          camera.write(wrist);
        },
        [&] {
          const Skeleton& hand = listener_.hands[1];
          const double reach = (to_vector(hand.joints[10].position) - to_vector(hand.joints[1].position)).norm();
          return std::abs(hand.joints[1].position[0] - 0.3) < 1e-6 && (value == 0 ? reach > 0.15 : reach < 0.12) &&
                 hand.joints[10].flags == (kJointValid | kJointTracked);
        });
  };
  EXPECT_TRUE(curled(0));
  EXPECT_TRUE(curled(4095));
  EXPECT_TRUE(curled(0));
  // The wrench is about the hand of the scene's user, although the glove tracks as user 2.
  EXPECT_TRUE(push(glove, 8, [&] { return glove.forces()[1] == 1000; }));
}

TEST_F(OpenGlovesProcess, LatencyAdded) {
  const Glove glove(start_tcp());
  glove.send_curl(0);
  testing::check_latency(listener_, "opengloves, TCP", [&] { glove.send_curl(1000); });
}

}  // namespace
}  // namespace softhand::opengloves_process_test
