// Frames between gateway and page: every field is at its documented offset, and bad requests are refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "messages/convert.hpp"
#include "viewer/frames.hpp"

namespace softhand::viewer {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

template <typename T>
T at(const Frame& frame, std::size_t payload_offset) {
  T value;
  EXPECT_LE(kHeaderBytes + payload_offset + sizeof value, frame->size());
  std::memcpy(&value, frame->data() + kHeaderBytes + payload_offset, sizeof value);
  return value;
}

void expect_header(const Frame& frame, FrameType type, std::uint32_t instance) {
  ASSERT_NE(frame, nullptr);
  std::uint32_t words[4];
  ASSERT_GE(frame->size(), sizeof words);
  std::memcpy(words, frame->data(), sizeof words);
  EXPECT_EQ(words[0], kMagic);
  EXPECT_EQ(words[1], kVersion | static_cast<std::uint32_t>(type) << 16);
  EXPECT_EQ(words[2], frame->size() - kHeaderBytes);
  EXPECT_EQ(words[3], instance);
  EXPECT_EQ(frame->size() % 4, 0u);
}

std::unique_ptr<TissueSurface> surface() {
  auto out = std::make_unique<TissueSurface>();
  out->hand = {3, 0};
  out->stamp.sample_time = 1'500'000'000;
  out->stamp.sequence = 7;
  out->wrist_position = {1, 2, 3};
  for (int i = 0; i < 101; ++i) {
    const float x = 0.001f * static_cast<float>(i);
    out->nodes.push_back({x, -0.19f + x, 0.05f * std::sin(x * 100)});
  }
  return out;
}

TEST(ViewerFrames, NodesRoundTripWithinTheQuantisationStep) {
  const auto in = surface();
  for (const bool quantised : {false, true}) {
    const Frame frame = encode(*in, quantised);
    expect_header(frame, FrameType::nodes, 6);
    EXPECT_EQ(at<double>(frame, 0), 1.5);
    EXPECT_EQ(at<double>(frame, 16), 7);
    EXPECT_EQ(at<float>(frame, 28), 2);
    ASSERT_EQ(at<std::uint32_t>(frame, 36), in->nodes.size());
    EXPECT_EQ(at<std::uint32_t>(frame, 40), quantised ? 1u : 0u);
    const float step = at<float>(frame, 44);
    float worst = 0;
    for (std::size_t i = 0; i < in->nodes.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const float out = quantised ? step * static_cast<float>(at<std::int16_t>(frame, 48 + 2 * (3 * i + k)))
                                    : at<float>(frame, 48 + 4 * (3 * i + k));
        worst = std::max(worst, std::abs(out - in->nodes[i][k]));
      }
    }
    if (quantised) {
      EXPECT_LT(worst, 4e-6f);
      EXPECT_LT(frame->size(), 16u + 48 + 6 * in->nodes.size() + 4);
    } else {
      EXPECT_EQ(worst, 0);
    }
  }
}

TEST(ViewerFrames, DoesNotSendFramesWithNaNOrInfinity) {
  auto nodes = surface();
  nodes->nodes[50][1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(encode(*nodes, true), nullptr);
  EXPECT_EQ(encode(*nodes, false), nullptr);
  nodes = surface();
  nodes->wrist_position[0] = kNan;
  EXPECT_EQ(encode(*nodes, true), nullptr);

  Skeleton skeleton;
  skeleton.joints[4].position = {kNan, 0, 0};
  skeleton.joints[4].radius = kNan;
  EXPECT_NE(encode(FrameType::tracked_skeleton, skeleton), nullptr) << "values of an invalid joint are not checked";
  skeleton.joints[4].radius = 0;
  skeleton.joints[4].flags = kJointValid;
  EXPECT_EQ(encode(FrameType::tracked_skeleton, skeleton), nullptr);

  Contacts contacts;
  contacts.fingers[2].force[1] = kNan;
  EXPECT_EQ(encode(contacts), nullptr);
  LoopStatus status;
  status.residual = std::numeric_limits<double>::infinity();
  EXPECT_EQ(encode(status, 0), nullptr);
}

TEST(ViewerFrames, AFlexibleObjectHasTheFramesOfASkin) {
  SoftBody body;
  body.nodes = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}};
  body.tetrahedra = {{0, 1, 2, 3}, {1, 4, 2, 3}};
  SoftObjectDescription described;
  described.object = kFirstSoftObject + 2;
  described.node_count = 5;
  const Frame frame = encode(described, &body);
  expect_header(frame, FrameType::soft_object_description, 2);
  EXPECT_EQ(at<std::uint32_t>(frame, 0), 5u);
  EXPECT_EQ(at<std::uint32_t>(frame, 4), 5u) << "vertices: all nodes are on the surface";
  EXPECT_EQ(at<std::uint32_t>(frame, 8), 6u) << "triangles";
  EXPECT_EQ(at<std::uint32_t>(frame, 12), 5u) << "nodes at rest";
  EXPECT_EQ(at<float>(frame, 16 + 12 * 5), 1) << "a vertex follows one node";
  EXPECT_EQ(at<float>(frame, 16 + 12 * 5 + 4), 0);

  described.node_count = 6;
  EXPECT_EQ(encode(described, &body), nullptr) << "another file";
  EXPECT_EQ(encode(described, nullptr), nullptr) << "no file";
  described.removed = 1;
  EXPECT_EQ(at<std::uint32_t>(encode(described, nullptr), 0), 0u);
  described.object = 3;
  EXPECT_EQ(encode(described, nullptr), nullptr) << "not the id of a flexible object";

  auto state = std::make_unique<SoftObjectState>();
  state->object = kFirstSoftObject + 2;
  state->centre = {1, 2, 3};
  state->nodes.push_back({0.25f, 0, -0.125f});
  const Frame nodes = encode(*state, false);
  expect_header(nodes, FrameType::soft_object_nodes, 2);
  EXPECT_EQ(at<float>(nodes, 28), 2);
  EXPECT_EQ(at<std::uint32_t>(nodes, 36), 1u);
  EXPECT_EQ(at<float>(nodes, 48), 0.25f);
  state->nodes[0][1] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(encode(*state, true), nullptr);
  state->nodes[0][1] = 0;
  state->object = kFirstSoftObject + 1000;
  EXPECT_EQ(encode(*state, true), nullptr) << "anybody can write any id";
}

TEST(ViewerFrames, DescriptionHoldsSkinAndRestNodes) {
  auto in = std::make_unique<HandDescription>();
  in->node_count = 5;
  for (std::uint32_t v = 0; v < 3; ++v) {
    in->vertex_nodes.push_back({v, v + 1, v + 2, 0});
    in->vertex_weights.push_back({0.5f, 0.25f, 0.125f, 0.125f});
  }
  in->triangles.push_back({0, 1, 2});
  const std::vector<Vector3> rest(5, Vector3(0.1, 0.2, 0.3));
  const Frame frame = encode(*in, rest);
  expect_header(frame, FrameType::hand_description, 1);
  EXPECT_EQ(at<std::uint32_t>(frame, 0), 5u);
  EXPECT_EQ(at<std::uint32_t>(frame, 4), 3u);
  EXPECT_EQ(at<std::uint32_t>(frame, 8), 1u);
  EXPECT_EQ(at<std::uint32_t>(frame, 12), 5u);
  EXPECT_FLOAT_EQ(at<float>(frame, 16 + 12 * 4 + 4), 0.2f);
  const std::size_t weights = 16 + 60;
  EXPECT_EQ(at<float>(frame, weights + 16 + 4), 0.25f);
  const std::size_t nodes = weights + 48;
  EXPECT_EQ(at<std::uint16_t>(frame, nodes + 2 * 8 + 2), 3u);
  EXPECT_EQ(at<std::uint16_t>(frame, nodes + 24 + 4), 2u);

  EXPECT_EQ(at<std::uint32_t>(encode(*in, {}), 12), 0u);
  in->vertex_nodes[1][2] = 5;
  EXPECT_EQ(encode(*in, rest), nullptr) << "node index out of range";
}

// Gives each number of a status another value. Lists the numbers.
struct NumberFields {
  std::vector<std::pair<std::string, double>> list;

  template <typename T>
  void field(const char* name, T& value) {
    if constexpr (std::is_arithmetic_v<T>) {
      value = static_cast<T>(list.size() + 1);
      list.emplace_back(name, value);
    }
  }
  void key(const char*, auto&) {}
};

TEST(ViewerFrames, StatusHasEveryFieldUnderItsName) {
  LoopStatus in;
  NumberFields numbers;
  visit_fields(numbers, in);
  set_text(in.module, "hand");
  set_text(in.second_writer, "objects: world, process 7 on lab-pc");
  const auto named = [](const char* name, double value) {
    NamedValue out;
    set_text(out.name, name);
    out.value = value;
    return out;
  };
  in.energies.push_back(named("tissue", 0.5));
  in.ledger.push_back(named("work", 0.75));
  add_counter(in, "chord_steps", 7);
  const Frame frame = encode(in, 4);
  expect_header(frame, FrameType::loop_status, 4);
  std::size_t place = 24;
  const auto text = [&frame](std::size_t offset) {
    return std::string(reinterpret_cast<const char*>(frame->data() + kHeaderBytes + offset));
  };
  EXPECT_EQ(text(place), "hand");
  place += 64;
  const auto expect_count = [&](std::size_t count) {
    EXPECT_EQ(at<std::uint32_t>(frame, place), count);
    place += 8;
  };
  const auto expect_name = [&](const std::string& name) {
    EXPECT_EQ(text(place), name);
    place += 32;
  };
  const auto expect_numbers = [&](const std::vector<std::pair<std::string, double>>& expected) {
    expect_count(expected.size());
    for (const auto& [name, value] : expected) {
      expect_name(name);
      EXPECT_EQ(at<double>(frame, place), value) << name;
      place += 8;
    }
  };
  EXPECT_EQ(numbers.list.front(), std::pair(std::string("process_id"), 1.0));
  EXPECT_EQ(numbers.list.back(), std::pair(std::string("passivity_energy"), in.passivity_energy));
  expect_numbers(numbers.list);
  expect_count(1);
  expect_name("second_writer");
  EXPECT_EQ(text(place), "objects: world, process 7 on lab-pc");
  place += 128;
  expect_count(3);
  expect_name("energies");
  expect_numbers({{"tissue", 0.5}});
  expect_name("ledger");
  expect_numbers({{"work", 0.75}});
  expect_name("counters");
  expect_numbers({{"chord_steps", 7}});
  EXPECT_EQ(frame->size(), kHeaderBytes + place);
}

TEST(ViewerFrames, ChoicesOfARig) {
  RigChoices in;
  set_text(in.module, "rig");
  for (const char* name : {"pinch", "lift"}) {
    RigChoice choice;
    set_text(choice.what, "scene");
    set_text(choice.choice, name);
    choice.running = name[0] == 'l' ? 1 : 0;
    in.choices.push_back(choice);
  }
  const Frame frame = encode(in, 9);
  expect_header(frame, FrameType::rig_choices, 9);
  const auto text = [&frame](std::size_t offset) {
    return std::string(reinterpret_cast<const char*>(frame->data() + kHeaderBytes + offset));
  };
  EXPECT_EQ(text(0), "rig");
  EXPECT_EQ(at<std::uint32_t>(frame, 64), 2u);
  constexpr std::size_t second = 72 + 136;
  EXPECT_EQ(text(second), "scene");
  EXPECT_EQ(text(second + 64), "lift");
  EXPECT_EQ(at<std::uint32_t>(frame, second + 128), 1u);
  EXPECT_EQ(at<std::uint32_t>(frame, 72 + 128), 0u);
  EXPECT_EQ(frame->size(), kHeaderBytes + 72 + 2 * 136);
}

TEST(ViewerFrames, EveryTopicHasAMatchingHeader) {
  expect_header(encode(FrameType::simulated_skeleton, Skeleton{}), FrameType::simulated_skeleton, 1);
  expect_header(encode(Contacts{}), FrameType::contacts, 1);
  expect_header(encode(WorldObjects{}), FrameType::objects, 0);
  expect_header(encode(BoneWrench{}), FrameType::bone_wrench, 1);
  expect_header(encode(MessageReply{}, 2), FrameType::message_reply, 2);
  expect_header(encode(GatewayState{}), FrameType::gateway, 0);
  ObjectDescription description;
  description.object = 5;
  expect_header(encode(description), FrameType::object_description, 5);
}

TEST(ViewerFrames, ObjectsOfTwoWorldsAreTwoInstances) {
  WorldObjects objects;
  ObjectDescription description;
  objects.world = description.world = 65535;
  description.object = 65535;
  expect_header(encode(objects), FrameType::objects, 65535);
  expect_header(encode(description), FrameType::object_description, 0xffffffff);
  description.object = 65536;
  EXPECT_EQ(encode(description), nullptr) << "its instance would be that of another object";
  description.object = 1;
  objects.world = description.world = 65536;
  EXPECT_EQ(encode(description), nullptr);
  EXPECT_EQ(encode(objects), nullptr);
}

TEST(ViewerFrames, TheStateOfTheGatewayHasItsEpoch) {
  GatewayState state;
  state.epoch = 0x123456789abcdef0;
  state.pages = 3;
  state.refused.back() = 7;
  const Frame frame = encode(state);
  EXPECT_EQ(at<std::uint64_t>(frame, 8), state.epoch);
  EXPECT_EQ(at<std::uint32_t>(frame, 16), 3u);
  EXPECT_EQ(at<double>(frame, 56 + 8 * (state.refused.size() - 1)), 7);
}

TEST(ViewerFrames, ALinkOfAnObjectFileIsSentWithItsTrianglesInTheBodyFrame) {
  ObjectDescription description;
  description.object = 5;
  description.shape.kind = static_cast<std::uint32_t>(ShapeKind::file);
  ShapeFile file;
  file.position = {0, 1, 0};
  description.shape.file.push_back(file);
  TriangleMesh mesh;
  mesh.vertices = {Vector3(0, 0, 0), Vector3(1, 0, 0), Vector3(0, 0, 2)};
  mesh.triangles = {{0, 2, 1}};
  const Frame frame = encode(description, &mesh);
  expect_header(frame, FrameType::object_description, 5);
  EXPECT_EQ(at<std::uint32_t>(frame, 8), 6u);
  EXPECT_EQ(at<std::uint32_t>(frame, 12), 3u);
  constexpr std::size_t kVertices = 100;
  EXPECT_EQ(at<float>(frame, kVertices + 4), 1) << "y of the first vertex";
  EXPECT_EQ(at<float>(frame, kVertices + 32), 2) << "z of the third one";
  EXPECT_EQ(at<std::uint32_t>(frame, kVertices + 36), 1u);
  EXPECT_EQ(at<std::uint32_t>(frame, kVertices + 44), 2u) << "second corner";
  EXPECT_EQ(encode(description), nullptr) << "a file that is not loaded is not shown";
  description.removed = 1;
  expect_header(encode(description), FrameType::object_description, 5);
}

TEST(ViewerFrames, DrawsHeldObjectsWhereTheHandHasThem) {
  auto world = std::make_unique<WorldObjects>();
  world->stamp.sample_time = 1'000'000'000;
  for (const std::uint32_t id : {1u, 2u}) {
    ObjectState object;
    object.object = id;
    object.owned = id == 2 ? 1 : 0;
    object.owner_side = 1;
    world->objects.push_back(object);
  }
  ObjectCoupling coupling;
  coupling.stamp.sample_time = 990'000'000;
  for (const std::uint32_t id : {1u, 2u}) {
    ObjectTwin twin;
    twin.object = id;
    twin.owned = 1;
    twin.position = {0.5, 0, 0};
    coupling.twins.push_back(twin);
  }
  const auto drawn_x = [&world](const ObjectCoupling& from) {
    WorldObjects drawn = *world;
    draw_held(drawn, from);
    return std::pair(drawn.objects[0].position[0], drawn.objects[1].position[0]);
  };
  EXPECT_EQ(drawn_x(coupling), std::pair(0.0, 0.5)) << "in the world, nobody owns the first object";
  ObjectCoupling other = coupling;
  other.hand.side = 0;
  EXPECT_EQ(drawn_x(other), std::pair(0.0, 0.0)) << "the coupling is that of another hand";
  world->world = 1;
  EXPECT_EQ(drawn_x(coupling), std::pair(0.0, 0.0)) << "the hand holds an object of the rig's world";
  world->world = kRigWorld;
  const Nanoseconds present = coupling.stamp.sample_time;
  coupling.stamp.sample_time = present + 3'600'000'000'000;
  EXPECT_EQ(drawn_x(coupling), std::pair(0.0, 0.0)) << "the coupling is from the future";
  coupling.stamp.sample_time = 800'000'000;
  EXPECT_EQ(drawn_x(coupling), std::pair(0.0, 0.0)) << "the hand stopped publishing";
}

// ---- from the page ----

using Bytes = std::vector<std::uint8_t>;

Bytes request(FrameType type, const Bytes& payload) {
  Bytes bytes(kHeaderBytes + payload.size());
  const std::uint32_t magic = kMagic;
  const std::uint16_t version = kVersion;
  const auto kind = static_cast<std::uint16_t>(type);
  const auto length = static_cast<std::uint32_t>(payload.size());
  std::memcpy(bytes.data(), &magic, 4);
  std::memcpy(bytes.data() + 4, &version, 2);
  std::memcpy(bytes.data() + 6, &kind, 2);
  std::memcpy(bytes.data() + 8, &length, 4);
  std::copy(payload.begin(), payload.end(), bytes.begin() + kHeaderBytes);
  return bytes;
}

Bytes show_request(std::uint32_t types, float rate) {
  Bytes payload(8);
  std::memcpy(payload.data(), &types, 4);
  std::memcpy(payload.data() + 4, &rate, 4);
  return request(FrameType::show, payload);
}

Bytes message_request(std::uint64_t id, std::string_view module, std::string_view key, std::string_view value) {
  Bytes payload(8 + 3 * 64);
  std::memcpy(payload.data(), &id, 8);
  std::size_t field = 8;
  for (const std::string_view text : {module, key, value}) {
    std::memcpy(payload.data() + field, text.data(), text.size());
    field += 64;
  }
  return request(FrameType::message, payload);
}

Refusal refusal(const Bytes& bytes) {
  PageRequest out;
  return decode(bytes, out);
}

TEST(ViewerRequests, ValidRequestsAreDecoded) {
  PageRequest out;
  ASSERT_EQ(decode(show_request(set_of(FrameType::nodes), 30), out), Refusal::none);
  EXPECT_EQ(std::get<ShowRequest>(out).types, set_of(FrameType::nodes));
  EXPECT_EQ(std::get<ShowRequest>(out).rate_hz, 30);
  ASSERT_EQ(decode(message_request(99, "hand", "reposition", ""), out), Refusal::none);
  EXPECT_EQ(std::get<Message>(out).id, 99u);
  EXPECT_EQ(get_text(std::get<Message>(out).key), "reposition");
}

TEST(ViewerRequests, TruncatedAndOverlongRequestsAreRefused) {
  for (const Bytes& whole : {show_request(4, 0), message_request(1, "hand", "key", "value")}) {
    for (std::size_t length = 0; length < whole.size(); ++length)
      EXPECT_EQ(refusal(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length))), Refusal::size);
    Bytes longer = whole;
    longer.push_back(0);
    EXPECT_EQ(refusal(longer), Refusal::size);
  }
}

TEST(ViewerRequests, WrongHeadersAreRefused) {
  Bytes bytes = show_request(4, 0);
  bytes[0] ^= 1;
  EXPECT_EQ(refusal(bytes), Refusal::magic);
  bytes = show_request(4, 0);
  bytes[4] = kVersion + 1;
  EXPECT_EQ(refusal(bytes), Refusal::version);
  EXPECT_EQ(refusal(request(FrameType::nodes, Bytes(8))), Refusal::type);
  EXPECT_EQ(refusal(request(static_cast<FrameType>(65535), {})), Refusal::type);
  EXPECT_EQ(refusal(request(FrameType::show, Bytes(12))), Refusal::size);
}

TEST(ViewerRequests, WrongContentIsRefused) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const float rate : {nan, std::numeric_limits<float>::infinity(), -1.0f, 1e9f})
    EXPECT_EQ(refusal(show_request(4, rate)), Refusal::content);
  EXPECT_EQ(refusal(show_request(1u << 31, 0)), Refusal::content);
  EXPECT_EQ(refusal(message_request(1, "", "key", "")), Refusal::content);
  EXPECT_EQ(refusal(message_request(1, "hand", "", "")), Refusal::content);
  EXPECT_EQ(refusal(message_request(1, "hand", "key", "line\nbreak")), Refusal::content);
  EXPECT_EQ(refusal(message_request(1, std::string(64, 'x'), "key", "")), Refusal::content) << "no terminating zero";
}

TEST(ViewerFrames, PromptsHaveSecondsAndAText) {
  const auto prompt = read_prompt("2.5 Make a fist");
  ASSERT_TRUE(prompt);
  const Frame frame = encode(*prompt);
  expect_header(frame, FrameType::prompt, 0);
  EXPECT_EQ(at<float>(frame, 0), 2.5f);
  EXPECT_STREQ(reinterpret_cast<const char*>(frame->data()) + kHeaderBytes + 4, "Make a fist");
  EXPECT_EQ(frame->size(), kHeaderBytes + 68);
  ASSERT_TRUE(read_prompt("0 "));
  EXPECT_EQ(read_prompt("0 ")->text[0], 0);
  for (const char* bad : {"", "5", "Make a fist", "-1 x", "601 x", "nan x", "inf x", " x", "5x y"})
    EXPECT_FALSE(read_prompt(bad)) << bad;
}

}  // namespace
}  // namespace softhand::viewer
