// NatNet: packets to the byte, captured and generated, the talk with Motive, hands of skeletons, and malformed packets.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "messages/convert.hpp"
#include "support/captured_packets.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/moving_hand.hpp"
#include "support/tracker_sink.hpp"
#include "trackers/natnet/motive.hpp"
#include "trackers/natnet/simulated_motive.hpp"

namespace softhand::natnet_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;
constexpr std::uint64_t kTicks = 10'000'000;  // per second
constexpr std::array<NatNetVersion, 4> kVersions{{{3, 0}, {3, 1}, {4, 0}, {4, 1}}};

HandModel shipped_hand() { return load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"); }
std::string_view payload_of(const std::string& packet) { return std::string_view(packet).substr(4); }

std::string from_hex(std::string_view hex) {
  std::string out;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    out += static_cast<char>(std::stoi(std::string(hex.substr(i, 2)), nullptr, 16));
  return out;
}

using Sink = testing::TrackerSamples;

// One rigid body at (0.1, 1.2, -0.3), 1.5 s, ticks 100, 110, 120.
MotiveScene sample_scene() {
  MotiveScene scene;
  scene.number = 7;
  scene.bodies = {{1, {Vector3(0.1, 1.2, -0.3), Quaternion::Identity()}, true}};
  scene.time = 1.5;
  scene.ticks = {100, 110, 120};
  return scene;
}

TEST(NatNet, TheSamplePayloadIsReadToItsLastByte) {
  // In 3.0, made up by hand from the description of the protocol.
  const std::string payload = from_hex(
      "07000000"
      "00000000"
      "00000000"
      "01000000"
      "01000000"
      "cdcccc3d"
      "9a99993f"
      "9a9999be"
      "000000000000000000000000"
      "0000803f"
      "6f12033a"
      "0100"
      "00000000"
      "00000000"
      "00000000"
      "00000000"
      "0000000000000000"
      "000000000000f83f"
      "6400000000000000"
      "6e00000000000000"
      "7800000000000000"
      "0000"
      "00000000");
  ASSERT_EQ(payload.size(), 116u);
  EXPECT_EQ(motive_frame({3, 0}, sample_scene()), from_hex("07007400") + payload);
  EXPECT_EQ(motive_frame({4, 1}, sample_scene()).size(), 4u + 160);
  for (const NatNetVersion version : kVersions) {
    const std::string packet = motive_frame(version, sample_scene());
    const auto frame = read_frame(payload_of(packet), version);
    ASSERT_TRUE(frame) << version.major << version.minor;
    EXPECT_EQ(frame->number, 7);
    ASSERT_EQ(frame->bodies.size(), 1u);
    const NatNetBody body = frame->bodies[0];
    EXPECT_EQ(body.id, 1);
    EXPECT_TRUE(body.is_tracked);
    EXPECT_LT((body.pose.position - Vector3(0.1, 1.2, -0.3)).norm(), 1e-6);
    EXPECT_EQ(body.pose.orientation.w(), 1);
    EXPECT_EQ(frame->time, 1.5);
    EXPECT_EQ(frame->exposure, 100u);
    EXPECT_EQ(frame->received, 110u);
    EXPECT_EQ(frame->transmit, 120u);
  }
}

TEST(NatNet, EverySectionIsReadAndNothingShorterOrLongerIs) {
  MotiveScene scene = sample_scene();
  scene.has_extras = true;
  scene.parameters = 10;
  scene.skeletons = {{4, {}}, {5, {{1, {Vector3(1, 2, 3), Quaternion::Identity()}, true}, {2, {}, false}}}};
  for (const NatNetVersion version : kVersions) {
    const std::string packet = motive_frame(version, scene);
    const std::string_view payload = payload_of(packet);
    const auto frame = read_frame(payload, version);
    ASSERT_TRUE(frame) << version.major << version.minor;
    EXPECT_EQ(frame->marker_sets, 1u);
    EXPECT_EQ(frame->other_markers, 1u);
    EXPECT_EQ(frame->labelled_markers, 1u);
    EXPECT_EQ(frame->force_plates, 1u);
    EXPECT_EQ(frame->devices, 1u);
    EXPECT_EQ(frame->assets, version >= kNewestNatNet ? 1u : 0u);
    EXPECT_EQ(frame->parameters, 10);
    EXPECT_EQ(frame->skeleton(4).size(), 0u);
    ASSERT_EQ(frame->skeleton(5).size(), 2u);
    EXPECT_EQ(frame->skeleton(5)[0].id, 5 << 16 | 1);
    EXPECT_EQ(frame->skeleton(5)[0].pose.position, Vector3(1, 2, 3));
    EXPECT_FALSE(frame->skeleton(5)[1].is_tracked);
    EXPECT_EQ(frame->skeleton(6).size(), 0u);
    for (std::size_t size = 0; size < payload.size(); ++size)
      EXPECT_FALSE(read_frame(payload.substr(0, size), version)) << size;
    EXPECT_FALSE(read_frame(std::string(payload) + '\0', version));
    EXPECT_FALSE(read_frame(std::string(payload) + std::string(payload), version));
    // The other generation has other sections.
    EXPECT_FALSE(read_frame(payload, version >= NatNetVersion{4, 1} ? NatNetVersion{3, 0} : NatNetVersion{4, 1}));
  }
}

TEST(NatNet, ModelDefinitionsAreReadAndNothingShorterOrLongerIs) {
  for (const NatNetVersion version : kVersions) {
    const std::string packet = motive_models(version, "Actor", 5, true);
    const std::string_view payload = payload_of(packet);
    std::vector<std::string> names;
    ASSERT_TRUE(read_models(payload, version,
                            [&](const NatNetBone& bone) {
                              EXPECT_EQ(bone.skeleton, "Actor");
                              EXPECT_EQ(bone.skeleton_id, 5);
                              EXPECT_EQ(bone.id, static_cast<int>(names.size()) + 1);
                              names.emplace_back(bone.name);
                            }))
        << version.major << version.minor;
    ASSERT_EQ(names.size(), motive_bones().size());
    EXPECT_EQ(names.front(), "Actor_Hip");
    EXPECT_EQ(names.back(), "Actor_RPinky3");
    const auto nothing = [](const NatNetBone&) { ADD_FAILURE(); };
    for (std::size_t size = 0; size < payload.size(); ++size)
      ASSERT_FALSE(read_models(payload.substr(0, size), version, nothing)) << size;
    EXPECT_FALSE(read_models(std::string(payload) + '\0', version, nothing));
  }
}

TEST(NatNet, BonesOfHandsHaveMotivesAndFbxNames) {
  const auto is = [](std::string_view name, Side side, int finger, int joint) {
    const auto bone = bone_of_hand(name);
    return bone && bone->side == side && bone->finger == finger && bone->joint == joint;
  };
  EXPECT_TRUE(is("LHand", Side::left, -1, 0));
  EXPECT_TRUE(is("RThumb1", Side::right, 0, 0));
  EXPECT_TRUE(is("RPinky3", Side::right, 4, 2));
  EXPECT_TRUE(is("LeftHand", Side::left, -1, 0));
  EXPECT_TRUE(is("RightHandIndex2", Side::right, 1, 1));
  for (const char* other : {"Hip", "Head", "LFArm", "LeftForeArm", "LThumb4", "LThumb", "RIndex12", "", "LToe"})
    EXPECT_FALSE(bone_of_hand(other)) << other;
}

TEST(NatNet, CapturedPacketsAreReadToTheirLastByte) {
  constexpr const char* kFirst = "natnet/mocapframe_packet_v3.bin";
  if (!testing::has_captured(kFirst)) GTEST_SKIP() << "no " << testing::captured_path(kFirst);
  const auto packet = [](const char* name) { return testing::captured("natnet/" + std::string(name) + "_v3.bin"); };
  const std::string frame_packet = packet("mocapframe_packet"), occluded = packet("mocapframe_packet_occluded");
  ASSERT_TRUE(read_natnet(frame_packet));
  const auto frame = read_frame(payload_of(frame_packet), {3, 0});
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->number, 162734);
  EXPECT_EQ(frame->labelled_markers, 6u);
  EXPECT_EQ(frame->other_markers, 5u);
  ASSERT_EQ(frame->bodies.size(), 1u);
  EXPECT_EQ(frame->bodies[0].id, 2);
  EXPECT_NEAR(frame->bodies[0].pose.position.y(), 1.45, 0.005);
  const auto other = read_frame(payload_of(occluded), {3, 0});
  ASSERT_TRUE(other);
  EXPECT_EQ(other->marker_sets, 2u);
  EXPECT_EQ(other->labelled_markers, 4u);
  int bones = 0;
  EXPECT_TRUE(read_models(payload_of(packet("modeldef_packet")), {3, 0}, [&](const NatNetBone&) { ++bones; }));
  EXPECT_EQ(bones, 0);
  const auto server = read_server_info(payload_of(packet("serverinfo_packet")));
  ASSERT_TRUE(server);
  EXPECT_EQ(server->version, (NatNetVersion{3, 0}));
  EXPECT_EQ(server->ticks_per_second, 3'312'787u);
  for (const char* name :
       {"connect_packet", "discovery_packet", "echorequest_packet", "echoresponse_packet", "requestmodeldef_packet"})
    EXPECT_TRUE(read_natnet(packet(name))) << name;
  EXPECT_EQ(natnet_packet(NatNetMessage::request_models, ""), packet("requestmodeldef_packet"));
}

// The server's side of a captured session, in its times. The client's stamps become those of the capture.
TEST(NatNet, FollowsACapturedSession) {
  constexpr const char* kTraffic = "natnet/traffic.pcapng";
  if (!testing::has_captured(kTraffic)) GTEST_SKIP() << "no " << testing::captured_path(kTraffic);
  NatNetOptions options;
  options.right.body = 2;
  MotiveDecoder decoder(shipped_hand(), options);
  Sink sink;
  std::map<std::string, Nanoseconds> asked;
  std::map<std::int32_t, Vector3> seen;
  double latency = 0;
  int frames = 0;
  const auto packets = testing::captured_packets(kTraffic);
  const Nanoseconds start = packets.at(0).time - 1000 * kMillisecond;
  for (const testing::CapturedPacket& packet : packets) {
    const Nanoseconds time = packet.time - start;
    const auto natnet = read_natnet(packet.payload);
    ASSERT_TRUE(natnet);
    if (packet.to == 1510) {
      if (natnet->message == NatNetMessage::echo_request) asked[std::string(natnet->payload)] = time;
      continue;
    }
    std::string bytes = packet.payload;
    if (natnet->message == NatNetMessage::echo_response)
      std::memcpy(bytes.data() + 4, &asked.at(bytes.substr(4, 8)), 8);
    const int before = sink.count;
    decoder.take({bytes, time, 0, false}, sink);
    if (natnet->message != NatNetMessage::frame) continue;
    ++frames;
    if (sink.count == before) continue;
    const Skeleton& hand = sink.hands[1];
    seen[read_frame(payload_of(bytes), {3, 0})->number] = to_vector(hand.joints[slot_of(Joint::wrist)].position);
    latency += static_cast<double>(time - hand.stamp.sample_time) * 1e-6;
  }
  EXPECT_EQ(frames, 518);
  // Every frame after the server's answer is a sample, and nothing else was refused.
  LoopStatus status;
  decoder.refusals().fill_status(status, 0);
  EXPECT_EQ(static_cast<double>(sink.count), 518 - testing::counter_of(status, "refused_version"));
  EXPECT_EQ(static_cast<double>(decoder.refusals().total()), testing::counter_of(status, "refused_version"));
  // Motive reports 5.3 to 5.5 ms from the exposure to the sending; the network adds some.
  std::printf("captured session: mean age %.2f ms at arrival\n", latency / sink.count);
  EXPECT_GT(latency / sink.count, 4);
  EXPECT_LT(latency / sink.count, 12);
  // What the client of the capture printed of its frames.
  std::istringstream text(testing::captured("natnet/SampleClient_output.txt"));
  int number = 0, compared = 0;
  bool is_body = false;
  for (std::string line; std::getline(text, line);) {
    double x = 0, y = 0, z = 0, qx = 0, qy = 0, qz = 0, qw = 0;
    std::sscanf(line.c_str(), "FrameID : %d", &number);
    if (line.starts_with("Rigid Body [ID=2")) is_body = true;
    if (!is_body || std::sscanf(line.c_str(), " %lf %lf %lf %lf %lf %lf %lf", &x, &y, &z, &qx, &qy, &qz, &qw) != 7)
      continue;
    is_body = false;
    const auto found = seen.find(number);
    if (found == seen.end()) continue;
    ++compared;
    EXPECT_LT((found->second - Vector3(x, y, z)).cwiseAbs().maxCoeff(), 0.0051) << number;
  }
  EXPECT_GT(compared, 200);
}

class Motive : public ::testing::Test {
 protected:
  void make(const NatNetOptions& options, NatNetVersion version) {
    version_ = version;
    decoder_.emplace(hand_, options);
    models_ = motive_models(version, "Actor", 1, true);
    asked_.clear();
    asks_more_ = true;
    number_ = 0;
    turn();
  }
  void take(const std::string& packet) { decoder_->take({packet, now_, 0, false}, sink_); }
  // The decoder's words and the server's answers, which take 0.1 ms each way.
  void turn() {
    now_ += 400 * kMillisecond;
    std::vector<std::string> words;
    decoder_->speak(now_, [&](std::string_view word) { words.emplace_back(word); });
    const Nanoseconds said = now_;
    for (const std::string& word : words) {
      asked_.push_back(read_natnet(word)->message);
      now_ = said + kMillisecond / 10;
      const std::string answer = motive_answer(word, version_, ticks(), kTicks, models_, false);
      now_ += kMillisecond / 10;
      if (!answer.empty() && is_on_) take(answer);
    }
    if (std::find(asked_.begin(), asked_.end(), NatNetMessage::echo_request) == asked_.end() && asks_more_)
      asks_more_ = false, turn();
  }
  std::uint64_t ticks() const { return static_cast<std::uint64_t>(now_ / 100 + 5'000'000'000); }
  int asked(NatNetMessage message) const { return static_cast<int>(std::count(asked_.begin(), asked_.end(), message)); }
  void show(MotiveScene scene) {
    now_ += 5 * kMillisecond;
    scene.number = ++number_;
    const std::uint64_t exposure = ticks() - 40'000;  // 4 ms ago
    scene.ticks = {exposure, exposure + 20'000, ticks()};
    take(motive_frame(version_, scene));
  }
  double refused(const std::string& name) const {
    LoopStatus status;
    decoder_->refusals().fill_status(status, 0);
    return testing::counter_of(status, "refused_" + name);
  }
  MotiveScene skeleton_scene(bool is_local) const {
    MotiveScene scene;
    scene.has_extras = true;
    scene.skeletons = {{2, {{1, {}, true}}},
                       {1, motive_skeleton({mirrored(hand_).rest_joints, hand_.rest_joints}, is_local)}};
    return scene;
  }
  // Shows the frames of `moving` as a skeleton with local bones and z up, and compares the right hands that arrive.
  testing::Deviations follow(const testing::MovingHand& moving);

  HandModel hand_ = shipped_hand();
  NatNetVersion version_{3, 0};
  std::optional<MotiveDecoder> decoder_;
  std::string models_;
  Sink sink_;
  Nanoseconds now_ = 1'000'000 * kMillisecond;
  std::int32_t number_ = 0;
  std::vector<NatNetMessage> asked_;
  bool is_on_ = true, asks_more_ = true;
};

NatNetOptions body_options() {
  NatNetOptions options;
  options.left.body = 1;
  options.right.body = 2;
  options.right.mount = {{0, -0.05, 0.02}, {0, 0, 1, 0}};
  options.head.body = 3;
  return options;
}
NatNetOptions skeleton_options(const char* bones, const char* up_axis) {
  NatNetOptions options;
  options.skeleton = "Actor";
  options.bones = bones;
  options.up_axis = up_axis;
  return options;
}

testing::Deviations Motive::follow(const testing::MovingHand& moving) {
  hand_ = moving.hand;
  make(skeleton_options("local", "z"), {4, 1});
  testing::Deviations deviations;
  for (const JointFrames& sent : moving.frames) {
    MotiveScene scene;
    scene.skeletons = {{1, motive_skeleton({sent, sent}, true)}};
    for (NatNetBody& bone : scene.skeletons[0].bones) bone.pose = to_z_up(bone.pose);
    show(scene);
    for (std::size_t j = 0; j < kJointCount; ++j) deviations.add(j, to_pose(sink_.hands[1].joints[j]), sent[j]);
  }
  EXPECT_EQ(decoder_->refusals().total(), 0u);
  deviations.print("skeleton");
  return deviations;
}

TEST_F(Motive, RigidBodiesAreWristsAndAHead) {
  for (const NatNetVersion version : kVersions) {
    sink_ = {};
    make(body_options(), version);
    const Quaternion turn(Eigen::AngleAxisd(0.5, Vector3::UnitY()));
    MotiveScene scene;
    scene.bodies = {{1, {Vector3(-0.2, 1, 0), turn}, true},
                    {2, {Vector3(0.2, 1, 0), turn}, true},
                    {3, {Vector3(0, 1.6, 0), turn}, true},
                    {4, {Vector3(5, 5, 5), turn}, true}};
    show(scene);
    ASSERT_EQ(sink_.count, 2) << version.major << version.minor;
    ASSERT_EQ(sink_.heads, 1);
    EXPECT_EQ(sink_.newest_head.valid, 1u);
    const JointSample& left = sink_.hands[0].joints[slot_of(Joint::wrist)];
    EXPECT_EQ(left.flags, kJointValid | kJointTracked);
    EXPECT_EQ(sink_.hands[0].joints[slot_of(Joint::index_tip)].flags, 0u);
    EXPECT_LT((to_vector(left.position) - Vector3(-0.2, 1, 0)).norm(), 1e-6);
    const JointSample& right = sink_.hands[1].joints[slot_of(Joint::wrist)];
    const Pose expected = Pose{Vector3(0.2, 1, 0), turn} * Pose{Vector3(0, -0.05, 0.02), Quaternion(0, 0, 0, 1)};
    EXPECT_LT((to_vector(right.position) - expected.position).norm(), 1e-6);
    EXPECT_LT(to_quaternion(right.orientation).angularDistance(expected.orientation), 1e-6);
    // 4 ms before the sending, within the uncertainty of the clock: half of a round trip, 0.1 ms.
    EXPECT_NEAR(static_cast<double>(now_ - sink_.hands[1].stamp.sample_time) * 1e-6, 4, 0.11);
    scene.bodies[1].is_tracked = false;
    scene.bodies[1].pose.orientation.coeffs().setZero();
    scene.bodies.pop_back();
    scene.bodies.pop_back();
    show(scene);
    EXPECT_EQ(sink_.hands[0].confidence, 1);
    EXPECT_EQ(sink_.hands[1].confidence, 0);
    EXPECT_EQ(sink_.newest_head.valid, 0u);
    EXPECT_EQ(decoder_->refusals().total(), 0u);
  }
}

// The law of FollowsACapturedSession, with a server whose clock we know. The client joins while frames are sent
// already. The clock of the server is faster than ours, and packets take 0.1 to 0.9 ms.
TEST_F(Motive, FollowsAGeneratedSession) {
  NatNetOptions options;
  options.right.body = 2;
  constexpr int kFrames = 518, kJoined = 20;
  constexpr double kDrift = 2e-5;
  const auto ticks_at = [](Nanoseconds time) {
    return 5'000'000'000 + static_cast<std::uint64_t>((1 + kDrift) * static_cast<double>(time) / 100);
  };
  for (const NatNetVersion version : kVersions) {
    version_ = version;
    sink_ = {};
    decoder_.emplace(hand_, options);
    std::minstd_rand random;
    std::uniform_int_distribution<Nanoseconds> delay(kMillisecond / 10, 9 * kMillisecond / 10);
    double age = 0, true_age = 0, worst = 0;
    int on_arrival = 0;
    for (int number = 1; number <= kFrames; ++number) {
      const Nanoseconds exposure = now_;
      const Vector3 place(0.1 * std::sin(0.02 * number), 1.2, 0.001 * number);
      MotiveScene scene;
      scene.number = number;
      scene.bodies = {{2, {place, Quaternion::Identity()}, true}};
      scene.ticks = {ticks_at(exposure), ticks_at(exposure + 3 * kMillisecond), ticks_at(exposure + 5 * kMillisecond)};
      const int before = sink_.count;
      const Nanoseconds arrival = exposure + 5 * kMillisecond + delay(random);
      decoder_->take({motive_frame(version, scene), arrival, 0, false}, sink_);
      ASSERT_EQ(sink_.count - before, number > kJoined ? 1 : 0) << number;
      if (sink_.count > 0) {
        const Skeleton& hand = sink_.hands[1];
        EXPECT_LT((to_vector(hand.joints[slot_of(Joint::wrist)].position) - place).norm(), 1e-6) << number;
        const double error = std::abs(static_cast<double>(hand.stamp.sample_time - exposure)) * 1e-6;
        // At first the offset of the clock is not known, and the time of arrival is used.
        const bool is_on_arrival = hand.stamp.sample_time == arrival;
        on_arrival += is_on_arrival ? 1 : 0;
        worst = std::max(worst, is_on_arrival ? 0 : error);
        age += static_cast<double>(arrival - hand.stamp.sample_time) * 1e-6;
        true_age += static_cast<double>(arrival - exposure) * 1e-6;
      }
      // The client speaks between two frames.
      const Nanoseconds said = exposure + 8 * kMillisecond;
      std::vector<std::string> words;
      if (number >= kJoined) decoder_->speak(said, [&](std::string_view word) { words.emplace_back(word); });
      for (const std::string& word : words) {
        const Nanoseconds heard = said + delay(random);
        const std::string answer = motive_answer(word, version, ticks_at(heard), kTicks, "", false);
        if (!answer.empty()) decoder_->take({answer, heard + delay(random), 0, false}, sink_);
      }
      now_ = exposure + 10 * kMillisecond;
    }
    std::printf("generated session: mean age %.2f ms (true: %.2f ms), worst error %.2f ms\n", age / sink_.count,
                true_age / sink_.count, worst);
    EXPECT_EQ(sink_.count, kFrames - kJoined);
    EXPECT_EQ(refused("version"), kJoined);
    EXPECT_EQ(decoder_->refusals().total(), static_cast<std::uint64_t>(kJoined));
    EXPECT_LE(on_arrival, 2);
    EXPECT_LT(worst, 0.9);  // half of the longest round trip
    EXPECT_NEAR(age / sink_.count, true_age / sink_.count, 0.2);
  }
}

TEST_F(Motive, SkeletonsAreHandsWithAnyAxesOfBones) {
  for (const NatNetVersion version : kVersions) {
    for (const char* bones : {"global", "local"}) {
      for (const char* up_axis : {"y", "z"}) {
        sink_ = {};
        make(skeleton_options(bones, up_axis), version);
        EXPECT_EQ(asked(NatNetMessage::request_models), 1);
        MotiveScene scene = skeleton_scene(bones == std::string("local"));
        if (up_axis == std::string("z"))
          for (NatNetBody& bone : scene.skeletons[1].bones) bone.pose = to_z_up(bone.pose);
        show(scene);
        ASSERT_EQ(sink_.count, 2) << bones << up_axis;
        for (std::size_t side = 0; side < 2; ++side) {
          const HandModel hand = side == 0 ? mirrored(hand_) : hand_;
          for (std::size_t j = 0; j < kJointCount; ++j) {
            const Pose seen = to_pose(sink_.hands[side].joints[j]), &real = hand.rest_joints[j];
            EXPECT_LT((seen.position - real.position).norm(), 0.004) << side << kJointNames[j];
            EXPECT_LT(seen.orientation.angularDistance(real.orientation), 12 * M_PI / 180) << side << kJointNames[j];
          }
          EXPECT_EQ(sink_.hands[side].confidence, 1);
        }
        EXPECT_EQ(decoder_->refusals().total(), 0u);
      }
    }
  }
}

TEST_F(Motive, AWristThatIsNotTrackedIsNoHandAndOtherBonesLowerTheConfidence) {
  make(skeleton_options("global", "y"), {4, 1});
  MotiveScene scene = skeleton_scene(false);
  scene.skeletons[1].bones.back().is_tracked = false;
  show(scene);
  EXPECT_NEAR(sink_.hands[1].confidence, 15.0 / 16, 1e-12);
  const auto guessed = [&](int side) {
    const auto& joints = sink_.hands[static_cast<std::size_t>(side)].joints;
    return std::count_if(joints.begin(), joints.end(),
                         [](const JointSample& joint) { return joint.confidence == kGuessedConfidence; });
  };
  EXPECT_EQ(guessed(0), 0);
  EXPECT_EQ(guessed(1), 1);
  scene.skeletons[1].bones.back().is_tracked = true;
  show(scene);
  EXPECT_EQ(guessed(1), 0);
  scene.skeletons[1].bones.back().is_tracked = false;
  for (NatNetBody& bone : scene.skeletons[1].bones)
    if (motive_bones()[static_cast<std::size_t>(bone.id) - 1].name == "RHand") bone.is_tracked = false;
  show(scene);
  EXPECT_EQ(sink_.hands[1].confidence, 0);
  EXPECT_EQ(sink_.hands[0].confidence, 1);
  scene.skeletons.clear();
  show(scene);
  EXPECT_EQ(sink_.hands[0].confidence, 0);
}

TEST_F(Motive, ModelsAreFetchedAgainWhenTheyChange) {
  make(skeleton_options("global", "y"), {4, 1});
  turn();
  EXPECT_EQ(asked(NatNetMessage::request_models), 1);
  MotiveScene scene = skeleton_scene(false);
  show(scene);
  EXPECT_EQ(sink_.count, 2);
  // The skeleton now has another number.
  models_ = motive_models(version_, "Actor", 9);
  scene.skeletons[1].id = 9;
  scene.parameters = kNatNetModelsChanged;
  show(scene);
  EXPECT_EQ(sink_.hands[0].confidence, 0);
  turn();
  EXPECT_EQ(asked(NatNetMessage::request_models), 2);
  show(scene);
  EXPECT_EQ(sink_.hands[0].confidence, 1);
  turn();
  EXPECT_EQ(asked(NatNetMessage::request_models), 2);
  // After another bitstream the version is asked for.
  const int before = asked(NatNetMessage::connect);
  scene.parameters = kNatNetBitstreamChanged;
  show(scene);
  version_ = {3, 0};
  models_ = motive_models(version_, "Actor", 9);
  turn();
  EXPECT_EQ(asked(NatNetMessage::connect), before + 1);
  show(scene);
  EXPECT_EQ(sink_.hands[0].confidence, 1);
  EXPECT_EQ(decoder_->refusals().total(), 0u);
}

TEST_F(Motive, ANewerServerIsAskedOnceForAnOlderFormat) {
  make(body_options(), {4, 1});
  EXPECT_EQ(asked(NatNetMessage::request), 0);
  take(motive_server_info({4, 3}, kTicks));
  for (int i = 0; i < 2; ++i) turn();
  EXPECT_EQ(asked(NatNetMessage::request), 1);
  show(sample_scene());  // in 4.1
  EXPECT_EQ(sink_.count, 2);
  EXPECT_EQ(decoder_->refusals().total(), 0u);
}

TEST_F(Motive, ASilentServerIsAskedUntilItAnswers) {
  is_on_ = false;
  make(skeleton_options("global", "y"), {3, 0});
  for (int i = 0; i < 4; ++i) turn();
  EXPECT_GE(asked(NatNetMessage::connect), 4);
  EXPECT_EQ(asked(NatNetMessage::keep_alive), 0);
  is_on_ = true;
  for (int i = 0; i < 2; ++i) turn();
  EXPECT_GT(asked(NatNetMessage::keep_alive), 0);
  show(skeleton_scene(false));
  EXPECT_EQ(sink_.count, 2);
  // Off for six seconds. Then a server of another version, with another clock and a new count of frames.
  is_on_ = false;
  for (int i = 0; i < 15; ++i) turn();
  is_on_ = true;
  version_ = {4, 1};
  models_ = motive_models(version_, "Actor", 1);
  number_ = 0;
  for (int i = 0; i < 2; ++i) turn();
  show(skeleton_scene(false));
  EXPECT_EQ(sink_.count, 4);
  EXPECT_EQ(decoder_->refusals().total(), 0u);
}

TEST_F(Motive, AServerThatWasSwitchedOffForAMomentIsGreetedAgain) {
  make(body_options(), {3, 0});
  for (int i = 0; i < 200; ++i) show(sample_scene());
  EXPECT_EQ(sink_.count, 400);
  // It answers questions, but it has forgotten its clients.
  const int before = asked(NatNetMessage::connect);
  for (int i = 0; i < 4; ++i) turn();
  EXPECT_GT(asked(NatNetMessage::connect), before);
  // By multicast its frames arrive, of another version, or from the first number on.
  version_ = {4, 1};
  show(sample_scene());
  EXPECT_EQ(refused("size"), 1);
  turn();
  show(sample_scene());
  EXPECT_EQ(sink_.count, 402);
  number_ = 0;
  show(sample_scene());
  turn();
  turn();
  show(sample_scene());
  EXPECT_EQ(sink_.count, 404);
  EXPECT_EQ(decoder_->refusals().total(), 1u);
}

TEST_F(Motive, RefusesBadPackets) {
  NatNetOptions options = body_options();
  options.skeleton = "Actor";
  version_ = {3, 0};
  decoder_.emplace(hand_, options);
  const std::string good = motive_frame({3, 0}, sample_scene());
  take(good);  // nobody said which version this is
  take(motive_server_info({2, 9}, kTicks));
  EXPECT_EQ(refused("version"), 2);
  turn();
  turn();
  take(good.substr(0, good.size() - 1));  // truncated
  take(good + good);                      // joined
  take(good.substr(20));                  // split
  take("");
  take(natnet_packet(NatNetMessage::echo_response, "short"));
  take(natnet_packet(NatNetMessage::server_info, "short"));
  take(motive_server_info({3, 0}, 0));
  EXPECT_EQ(refused("size"), 7);
  take(natnet_packet(NatNetMessage::models, "12345"));
  EXPECT_EQ(refused("models"), 1);
  take(natnet_packet(NatNetMessage::echo_response, std::string(16, '\1')));
  MotiveScene scene = sample_scene();
  scene.bodies[0].pose.position.x() = std::numeric_limits<double>::quiet_NaN();
  show(scene);
  scene.bodies[0].pose = {Vector3::Zero(), Quaternion(2, 0, 0, 0)};
  show(scene);
  scene.bodies[0].pose = {Vector3(2000, 0, 0), Quaternion::Identity()};
  show(scene);
  EXPECT_EQ(refused("content"), 4);
  EXPECT_EQ(sink_.count, 0);
  show(sample_scene());
  EXPECT_EQ(sink_.count, 2);
  --number_;
  show(sample_scene());  // twice
  EXPECT_EQ(refused("order"), 1);
  EXPECT_EQ(sink_.count, 2);
}

TEST_F(Motive, FollowsAGeneratedHand) { EXPECT_LT(follow(testing::generated_hand(hand_)).distance(1), 0.01); }

TEST_F(Motive, FollowsARecordedHand) {
  if (!std::filesystem::exists(testing::recorded_hand_path())) GTEST_SKIP() << "no " << testing::recorded_hand_path();
  testing::Deviations deviations = follow(testing::recorded_hand(hand_));
  EXPECT_LT(deviations.distance(0.5), 1);
  EXPECT_LT(deviations.distance(0.99), 18);
}

TEST_F(Motive, DoesNotAllocate) {
  NatNetOptions options = skeleton_options("local", "y");
  options.head.body = 3;
  make(options, {4, 1});
  std::string packet = motive_frame(version_, skeleton_scene(true));
  counting = true;
  for (std::int32_t i = 1; i < 200; ++i) {
    now_ += 10 * kMillisecond;
    std::memcpy(packet.data() + 4, &i, sizeof i);
    decoder_->take({models_, now_, 0, false}, sink_);
    decoder_->take({packet, now_, 0, false}, sink_);
    decoder_->speak(now_, [](std::string_view) {});
  }
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(sink_.count, 2 * 199);
}

}  // namespace
}  // namespace softhand::natnet_test
