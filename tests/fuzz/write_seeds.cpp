// Writes the inputs that the fuzzers begin with. Each is checked: its decoder accepts it.
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "bus/cdr.hpp"
#include "bus/topics.hpp"
#include "bus/user_data.hpp"
#include "flight/flight_header.hpp"
#include "flight/hand_flight.hpp"
#include "flight/world_flight.hpp"
#include "fuzz/flight_fuzzer.hpp"
#include "fuzz/fuzzer.hpp"
#include "fuzz/tracker_fuzzer.hpp"
#include "haptics/haply/haply_messages.hpp"
#include "haptics/opengloves/alpha_line.hpp"
#include "haptics/opengloves/simulated_glove.hpp"
#include "mesh_files/mesh_file.hpp"
#include "model/hand_model.hpp"
#include "model/object_model.hpp"
#include "model/state.hpp"
#include "runtime/record_file.hpp"
#include "support/block_hand.hpp"
#include "support/webxr_frame.hpp"
#include "tactile/bhaptics/player_messages.hpp"
#include "tactile/weart/simulated_touchdiver.hpp"
#include "tactile/weart/weart_messages.hpp"
#include "trackers/landmarks/landmarks.hpp"
#include "trackers/leap/leap_hands.hpp"
#include "trackers/leap/leap_message.hpp"
#include "trackers/leap/leapc_service.hpp"
#include "trackers/leap/simulated_leap.hpp"
#include "trackers/natnet/simulated_motive.hpp"
#include "trackers/openxr/openxr_hands.hpp"
#include "trackers/osc/simulated_performer.hpp"
#include "trackers/replay/recording.hpp"
#include "trackers/streamer/simulated_streamer.hpp"
#include "trackers/streamer/streamer.hpp"
#include "trackers/vrpn/simulated_vrpn.hpp"
#include "trackers/vrpn/vrpn_server.hpp"
#include "trackers/webxr/webxr_frames.hpp"
#include "viewer/frames.hpp"

namespace softhand::fuzz {
namespace {

namespace fs = std::filesystem;

std::string text_of(const std::vector<std::byte>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
template <typename T>
std::string bytes_of(T value) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}

class Seeds {
 public:
  explicit Seeds(fs::path folder) : folder_(std::move(folder)) {}
  /// Path of a new seed.
  std::string path(const std::string& decoder) {
    fs::create_directories(folder_ / decoder);
    return folder_ / decoder / std::to_string(count_++);
  }
  void add(const std::string& decoder, const std::string& bytes) {
    std::ofstream(path(decoder), std::ios::binary) << bytes;
  }

 private:
  fs::path folder_;
  int count_ = 0;
};

void add_topics(Seeds& seeds) {
  int topic = 0;
  bus::topics::for_each([&]<typename T>(const bus::Topic<T>&) {
    const auto message = std::make_unique<T>();
    std::vector<std::byte> bytes(bus::encoded_size(*message));
    bus::encode(*message, bytes);
    expect(bus::decode(bytes, *message), "topics: the seed is accepted");
    seeds.add("topics", static_cast<char>(topic++) + text_of(bytes));
  });
}

// Two tetrahedra with a hinge.
void add_object_file(Seeds& seeds) {
  ObjectModel object;
  object.name = "pair";
  ObjectLink link;
  link.mesh.vertices = {{0, 0, 0}, {0.02, 0, 0}, {0, 0.02, 0}, {0, 0, 0.02}};
  link.mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  link.mass = 0.01;
  link.centre_of_mass = Vector3::Constant(0.005);
  link.inertia = 1e-6 * Matrix3::Identity();
  link.friction = 0.8;
  link.pieces = {link.mesh.vertices};
  for (const char* name : {"one", "two"}) {
    link.name = name;
    object.links.push_back(link);
  }
  LinkJoint hinge;
  hinge.child = 1;
  hinge.law.kind = ObjectJointKind::hinge;
  object.joints.push_back(hinge);
  const std::string path = seeds.path("object_file");
  save_object(object, path);
  std::ifstream in(path);
  parse_object(std::string(std::istreambuf_iterator<char>(in), {}), path);
}

void add_topic_recording(Seeds& seeds) {
  const std::string path = seeds.path("topic_recording");
  RecordWriter writer(path);
  const std::vector<std::byte> payload(40);
  for (const char* topic : {"softhand/v1/objects", "softhand/v1/contacts"}) {
    const std::uint16_t channel = writer.add_channel({topic, "cdr", "softhand::v1::Any", "omgidl", "struct Any {};"});
    for (std::uint32_t i = 0; i < 3; ++i) writer.write(channel, i, 1000 + i, 900 + i, payload);
  }
  writer.finish();
  RecordReader reader(path);
  RecordedMessage message;
  int messages = 0;
  while (reader.next(message)) ++messages;
  expect(messages == 6, "topic_recording: the seed is accepted");
}

void add_hand_recording(Seeds& seeds) {
  std::string names = "t_s", row;
  for (int j = 0; j < static_cast<int>(kJointCount); ++j) {
    const std::string_view name = webxr_name(static_cast<Joint>(j));
    if (name.empty()) continue;
    for (const char* column : {"px", "py", "pz", "qx", "qy", "qz", "qw", "r"})
      names += "," + std::string(name) + "." + column;
    row += ",0.1," + std::to_string(0.01 * j) + ",-0.2,0,0,0,1,0.008";
  }
  const std::string text = names + "\n0" + row + "\n0.011" + row + "\n";
  std::istringstream in(text);
  Recording::parse(in, "seed");
  seeds.add("hand_recording", text);
}

void add_landmarks(Seeds& seeds) {
  std::string points;
  for (int i = 0; i < 21; ++i) points += (i > 0 ? ",[0.1," : "[0.1,") + std::to_string(0.01 * i) + ",-0.2]";
  const std::string start = R"({"version":1,"hand":"left","coordinates":)", end = R"("landmarks":[)" + points + "]}";
  const auto add = [&seeds](const std::string& text) {
    LandmarksMessage message;
    expect(decode_landmarks(text, message) == LandmarksRefusal::none, "landmarks: the seed is accepted");
    seeds.add("landmarks", text);
  };
  add(start + R"("world","score":0.9,"sample_time_ms":10,"sent_time_ms":30,)" + end);
  add(start + R"("image","aspect":1.5,)" + end);
}

void add_webxr(Seeds& seeds) {
  const std::string frame = testing::webxr_frame(10, 30);
  WebXrSample sample;
  expect(decode_webxr(frame, sample) == WebXrRefusal::none, "webxr: the seed is accepted");
  seeds.add("webxr", frame);
}

void add_streamer(Seeds& seeds) {
  const JointFrames joints = shipped_hand().rest_joints;
  const StreamerHeader header{1, 5};
  for (const std::string& text :
       {streamer_hand(Side::right, joints), streamer_hand(Side::right, joints, header) + "\n",
        streamer_head({Vector3(1, 2, 3), Quaternion::Identity()}), streamer_head({}, header)}) {
    StreamerDecoder decoder(shipped_hand());
    CheckedSink sink;
    decoder.take({text, kArrival, 0, false}, sink);
    expect(sink.count == 1, "streamer: the seed is accepted");
    seeds.add("streamer", text);
  }
}

void add_osc(Seeds& seeds) {
  const HandModel left = mirrored(shipped_hand());
  const auto add = [&seeds](const std::string& packet, int samples) {
    PerformerDecoder decoder(shipped_hand(), {.left_tracker = 1, .right_tracker = 2});
    CheckedSink sink;
    decoder.take({packet, kArrival, 0, false}, sink);
    expect(sink.count == samples, "osc: the seed is accepted");
    seeds.add("osc", packet);
  };
  add(osc_bundle(performer_frame(1, {}, {}, {left.rest_joints, shipped_hand().rest_joints})), 3);
  add(osc_bundle({osc_message("/tracking/trackers/1/position", "", {0.1, 1, 0.2}),
                  osc_message("/tracking/trackers/1/rotation", "", {10, 20, 30})}),
      1);
  add(osc_bundle(plain_hand(Side::right, {}, {0, 0.5, 1, 0.5, 0})), 1);
  add(osc_message("/hand/left/splays", "", {0.1, 0, 0, -0.1, -0.2}), 0);
}

void add_natnet(Seeds& seeds) {
  NatNetOptions options;
  options.skeleton = "Actor";
  options.bones = "local";
  for (const NatNetVersion version : {NatNetVersion{3, 0}, NatNetVersion{4, 1}}) {
    MotiveScene scene;
    scene.has_extras = true;
    scene.bodies = {{1, {}, true}, {3, {}, true}};
    scene.skeletons = {{1, motive_skeleton({mirrored(shipped_hand()).rest_joints, shipped_hand().rest_joints}, true)}};
    const std::string models = motive_models(version, "Actor", 1, true), frame = motive_frame(version, scene);
    MotiveDecoder decoder(shipped_hand(), options);
    CheckedSink sink;
    for (const std::string& packet : {motive_server_info(version, 10'000'000), models, frame})
      decoder.take({packet, kArrival, 0, false}, sink);
    expect(sink.count == 2, "natnet: the seed is accepted");
    seeds.add("natnet", static_cast<char>((version.major - 3) << 4 | version.minor) + models + frame);
  }
}

void add_vrpn(Seeds& seeds) {
  VrpnOptions options;
  options.left.sensor = 0;
  VrpnDecoder decoder(options);
  CheckedSink sink;
  const std::string stream = vrpn_greeting() + vrpn_pose(5, 3, 1'000'000, 0, {}) + vrpn_pose(5, 3, 2'000'000, 1, {});
  for (std::string_view rest = stream; !rest.empty();) {
    const std::size_t size = vrpn_packet_size(rest);
    decoder.take({rest.substr(0, size), kArrival, 1, false}, sink);
    rest.remove_prefix(size);
  }
  expect(sink.count == 1, "vrpn: the seed is accepted");
  seeds.add("vrpn", stream);
}

void add_leap(Seeds& seeds) {
  for (const LeapService service : {LeapService::old, LeapService::beta}) {
    const std::string message = leap_frame_message(
        5, {{Side::left, mirrored(shipped_hand()).rest_joints}, {Side::right, shipped_hand().rest_joints}}, service);
    LeapDecoder decoder(shipped_hand(), false);
    CheckedSink sink;
    LeapFrame frame;
    expect(read_leap_message(message, frame), "leap: the seed is a frame");
    decoder.take({frame.bytes(), kArrival, 1, true}, sink);
    expect(sink.count == 2 && decoder.refusals().total() == 0, "leap: the seed is accepted");
    seeds.add("leap", message);
  }
  const std::vector<leapc::Hand> hands{leapc_hand({Side::left, mirrored(shipped_hand()).rest_joints}),
                                       leapc_hand({Side::right, shipped_hand().rest_joints})};
  const leapc::TrackingEvent event{nullptr, 1, 5000, 1, 2, hands.data(), 90};
  LeapDecoder decoder(shipped_hand(), false);
  CheckedSink sink;
  decoder.take({read_leapc(event, kArrival).bytes(), kArrival, 1, true}, sink);
  expect(sink.count == 2 && decoder.refusals().total() == 0, "leapc: the seed is accepted");
  leapc::TrackingEvent seed = event;
  seed.hands = nullptr;  // the address of this run would make each seed another one
  seeds.add("leapc", bytes_of(seed) + bytes_of(hands[0]) + bytes_of(hands[1]));
}

// The first four bytes are read by packets_fuzzer.cpp.
void add_packets(Seeds& seeds) {
  using std::string_literals::operator""s;
  seeds.add("packets",
            "\x00\x20\x03\x02"s + "one~two~a packet that is longer than the largest one may be, by far~~end");
  seeds.add("packets", "\x01\x20\x03\x02"s + "\x05\x00one\x02\x00\x07\x00three"s);
  seeds.add("packets", "\x02\xf0\x03\x02"s + vrpn_greeting() + vrpn_pose(5, 3, 1'000'000, 0, {}));
}

void add_openxr(Seeds& seeds) {
  OpenXrFrame frame;
  frame.time = kArrival - 1;
  frame.head.flags = 15;
  std::string bytes = bytes_of(frame.time) + bytes_of(frame.head);
  for (OpenXrHand& hand : frame.hands) {
    hand.is_active = true;
    hand.joints.fill({15, {0, 0, 0, 1}, {0.1f, 1, 0.2f}, 0.01f});
    hand.velocities.fill({3, {1, 0, 0}, {0, 1, 0}});
    bytes += '\1' + bytes_of(hand.joints) + bytes_of(hand.velocities);
  }
  OpenXrDecoder decoder;
  CheckedSink sink;
  decoder.take({frame.bytes(), kArrival, 1, true}, sink);
  expect(sink.count == 3, "openxr: the seed is accepted");
  seeds.add("openxr", bytes);
}

void add_opengloves(Seeds& seeds) {
  const std::array<int, 5> values{0, 1000, 2047, 3000, 4095};
  const auto add = [&seeds](const std::string& lines) {
    AlphaDecoder decoder(Side::right, 4095);
    int used = 0;
    for_each_line(lines, [&](const Arrival& line) { used += decoder.take(line) != nullptr ? 1 : 0; });
    expect(used > 0 && decoder.refusals().total() == 0, "opengloves: the seed is accepted");
    seeds.add("opengloves", lines);
  };
  add(glove_line(values) + glove_line(values));
  add("Z(ZV)42(ZG)0(ZH)1\n" + glove_line(values, &values) + glove_line(values, &values));
  add("A1023(AB)2047(AAB)2047(AAC)3071(AAD)4095B0JLM\nA1023(AB)2047(AAB)2047(AAC)3071(AAD)4095B0JLM\n");
  add("0&1023&512&0&0&512&512&0&0&0&0&1&0\n0&1023&512&0&0&512&512&0&0&0&0&1&0\n");
}

void add_haply(Seeds& seeds) {
  const auto add_report = [&seeds](const std::string& text) {
    const HaplyReport report = decode_haply_report(text, "049D");
    expect(report.refusal == HaplyRefusal::none && report.has_device, "haply: the seed is accepted");
    seeds.add("haply", text);
  };
  add_report(
      R"({"session_id":7,"inverse3":[{"device_id":"049D","config":{"type":"inverse3"},"state":{"cursor_position":)"
      R"({"x":0.01,"y":-0.12,"z":0.15},"cursor_velocity":{"x":0.1,"y":0.2,"z":0.3},"current_cursor_force":{"x":0,)"
      R"("y":0,"z":1.5}},"status":{}}],"verse_grip":[]})");
  add_report(R"({"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":0,"y":0,"z":0}}}]})");
  const std::string event =
      R"({"name":"device-safety-triggered","category":"device","level":"error","data":{"device_id":"049D",)"
      R"("safety_type":"ebrake_triggered"},"message":"text"})";
  expect(decode_haply_event(event).kind == HaplyEventKind::brake, "haply: the event is accepted");
  seeds.add("haply", event);
}

void add_bhaptics(Seeds& seeds) {
  for (const char* const text :
       {R"({"ConnectedDeviceCount":1,"ConnectedPositions":["GloveR"],"Status":{"GloveR":[0,1,2,3,4,5]}})",
        R"({"connectedPositions":[204],"status":{"GloveR":[0,0,0,0,0,100]}})"}) {
    const PlayerReport report = decode_player_report(text, Side::right);
    expect(report.is_connected && report.has_motors, "bhaptics: the seed is accepted");
    seeds.add("bhaptics", text);
  }
}

void add_weart(Seeds& seeds) {
  const std::string bending =
      R"({"type":"TRACKING_BENDING_G2","ts":1,"data":{"handSide":"RIGHT","index":{"closure":1,"abduction":0.5}}})";
  const std::string status = R"({"type":"MW_STATUS","ts":1,"data":{"status":"RUNNING","statusCode":0}})";
  const std::string devices = R"({"type":"DEVICES_STATUS","ts":1,"data":{"devices":[{"handSide":"RIGHT"}]}})";
  for (const std::string& text :
       {weart_tracking(0, 100, 255), std::string("CalibrationStatus:1:2~CalibrationResult:1:0~"),
        bending + "~" + status + "~", devices + "~"}) {
    for_each_packet(text, kWeartEnd, [](const Arrival& packet) {
      const WeartReport report = decode_weart(packet.bytes, Side::right);
      expect(report.refusal == WeartRefusal::none && report.kind != WeartKind::other, "weart: the seed is accepted");
    });
    seeds.add("weart", text);
  }
}

void add_page(Seeds& seeds) {
  const auto add = [&seeds](viewer::FrameType type, const std::string& payload) {
    const std::string frame =
        bytes_of(viewer::kMagic) + bytes_of(viewer::kVersion) + bytes_of(static_cast<std::uint16_t>(type)) +
        bytes_of(static_cast<std::uint32_t>(payload.size())) + bytes_of(std::uint32_t{0}) + payload;
    viewer::PageRequest request;
    expect(viewer::decode({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()}, request) ==
               viewer::Refusal::none,
           "page: the seed is accepted");
    seeds.add("page", frame);
  };
  add(viewer::FrameType::show, bytes_of(std::uint32_t{2}) + bytes_of(30.0f));
  std::string message(8 + 3 * sizeof(ShortText), '\0');
  message[8] = message[8 + sizeof(ShortText)] = 'a';
  add(viewer::FrameType::message, message);
}

void add_mesh_files(Seeds& seeds) {
  const auto add = [&seeds](char kind, const std::string& bytes) {
    const ScratchFile file(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(),
                           kMeshSuffixes[static_cast<std::size_t>(kind)]);
    load_mesh(file.path());
    seeds.add("mesh_file", kind + bytes);
  };
  add(0, "# a comment\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1/1 2/2/2 4\nf -4 -1 -2\n");
  add(1,
      "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
      "endfacet\nendsolid s\n");
  std::string binary(80, ' ');
  binary += bytes_of(std::uint32_t{1});
  for (int i = 0; i < 12; ++i) binary += bytes_of(i % 4 == 0 ? 1.0f : 0.0f);
  add(1, binary + bytes_of(std::uint16_t{0}));
  // A triangle: three positions, then three indices.
  std::string buffer;
  for (int i = 0; i < 9; ++i) buffer += bytes_of(i == 3 || i == 7 ? 1.0f : 0.0f);
  for (const std::uint16_t i : {0, 1, 2, 0}) buffer += bytes_of(i);
  const std::string rest =
      R"("bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],"accessors":)"
      R"([{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},{"bufferView":1,"componentType":5123,"count":)"
      R"(3,"type":"SCALAR"}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],"nodes":[{"mesh":0,)"
      R"("translation":[1,0,0]}],"scenes":[{"nodes":[0]}],"scene":0,"asset":{"version":"2.0"}})";
  std::string json = R"({"buffers":[{"byteLength":44}],)" + rest;
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const auto chunk = [](const char* type, const std::string& bytes) {
    return bytes_of(static_cast<std::uint32_t>(bytes.size())) + std::string(type, 4) + bytes;
  };
  const std::string chunks = chunk("JSON", json) + chunk("BIN\0", buffer);
  add(2, "glTF" + bytes_of(std::uint32_t{2}) + bytes_of(static_cast<std::uint32_t>(12 + chunks.size())) + chunks);
  // The same buffer in base64.
  add(3, R"({"buffers":[{"byteLength":44,"uri":"data:application/octet-stream;base64,)"
         "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAABAAIAAAA="
         R"("}],)" +
             rest);
}

void add_user_data(Seeds& seeds) {
  const std::string of_participant = bus::detail::user_data_of(7, "demo");
  const bus::detail::Endpoint endpoint{"topic", "softhand::v1::Contacts", "hand", 0x1234567890abcdef, 7};
  const std::string of_endpoint = bus::detail::user_data_of(endpoint);
  expect(bus::detail::peer_of("hand", of_participant).has_value(), "user_data: the peer is accepted");
  expect(bus::detail::endpoint_of(endpoint.topic, endpoint.type, of_endpoint) == endpoint,
         "user_data: the endpoint is accepted");
  seeds.add("user_data", "\x04hand" + of_participant);
  seeds.add("user_data", static_cast<char>(endpoint.type.size()) + endpoint.type + of_endpoint);
}

// `write(ByteWriter&)` writes the part.
template <typename Write>
void add_flight_part(Seeds& seeds, FlightPart part, Write&& write) {
  std::vector<std::byte> memory(1 << 20);
  ByteWriter out(memory);
  write(out);
  memory.resize(out.size());
  seeds.add("flight", static_cast<char>(part) + text_of(memory));
}

void add_flight(Seeds& seeds) {
  const FlightHeader header{"hand", "hand", "/scene.toml", "name = \"scene\"", {"hand.side=right"}, {""}, {"0123"}, {},
                            {},     {}};
  expect(flight_header_from_json(to_json(header)) == header, "flight: the header is accepted");
  seeds.add("flight", static_cast<char>(FlightPart::header) + to_json(header));

  const auto skeleton = std::make_unique<Skeleton>();
  const auto contacts = std::make_unique<Contacts>();
  const auto world = std::make_unique<WorldObjects>();
  const HeadPose head;
  skeleton->stamp.sequence = 1;
  world->objects.push_back({});
  const std::vector<ObjectCoupling> couplings(2);
  const TrackingInput tracking{skeleton.get(), nullptr, &head, contacts.get()};
  add_flight_part(seeds, FlightPart::tracking_step,
                  [&](ByteWriter& out) { FlightTraits<TrackingLoop>::write_input(out, tracking, false); });
  const HandInput hand{skeleton.get(), &head, world.get(), couplings};
  add_flight_part(seeds, FlightPart::hand_step, [&](ByteWriter& out) {
    FlightTraits<HandLoop>::write_input(out, {hand, {}}, false);
  });
  add_flight_part(seeds, FlightPart::world_step,
                  [&](ByteWriter& out) { FlightTraits<WorldLoop>::write_input(out, {{couplings}}, true); });
  add_flight_part(seeds, FlightPart::tracking_snapshot,
                  [](ByteWriter& out) { FlightTraits<TrackingLoop>::save(flight_loop(), out); });
  add_flight_part(seeds, FlightPart::hand_state, [](ByteWriter& out) {
    out.write(State{Eigen::Matrix3Xd::Zero(3, 4), Eigen::Matrix3Xd::Zero(3, 4), {{}}, {{}}});
  });
  add_flight_part(seeds, FlightPart::message, [](ByteWriter& out) { out.write(Message{}); });
  add_flight_part(seeds, FlightPart::object, [](ByteWriter& out) { out.write(ObjectDescription{}); });
  add_flight_part(seeds, FlightPart::joint, [](ByteWriter& out) { out.write(ObjectJointDescription{}); });
  add_flight_part(seeds, FlightPart::result, [](ByteWriter& out) { out.write(FlightResult{}); });
}

// One line for each message: key, blank, value.
void add_messages(Seeds& seeds) {
  seeds.add("message", "motors on\nmotors off\ngain 0.5\n");
  seeds.add("message", "reposition \nfeedback_ratio 0.05\n");
  seeds.add("message", "pace 0.1\nadvance 0.0111111111\npace 0\nreset \npace 1\n");
  seeds.add("message", "prompt 3 grasp the cube\n");
  seeds.add("message", "object.teleport 0.1 -0.2  3e-2\n");
}

}  // namespace
}  // namespace softhand::fuzz

int main(int argc, char** argv) {
  using namespace softhand;
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_seeds FOLDER\n");
    return 2;
  }
  fuzz::Seeds seeds(argv[1]);
  fuzz::add_topics(seeds);
  const std::string hand = seeds.path("hand_file");
  save_hand(testing::block_hand(), hand);
  load_hand(hand);
  fuzz::add_object_file(seeds);
  fuzz::add_topic_recording(seeds);
  fuzz::add_hand_recording(seeds);
  fuzz::add_landmarks(seeds);
  fuzz::add_webxr(seeds);
  fuzz::add_streamer(seeds);
  fuzz::add_osc(seeds);
  fuzz::add_natnet(seeds);
  fuzz::add_vrpn(seeds);
  fuzz::add_leap(seeds);
  fuzz::add_packets(seeds);
  fuzz::add_openxr(seeds);
  fuzz::add_opengloves(seeds);
  fuzz::add_haply(seeds);
  fuzz::add_bhaptics(seeds);
  fuzz::add_weart(seeds);
  fuzz::add_page(seeds);
  fuzz::add_mesh_files(seeds);
  fuzz::add_user_data(seeds);
  fuzz::add_flight(seeds);
  fuzz::add_messages(seeds);
}
