// viewer_publisher HAND_FILE [VERTICES [RATE]] publishes test data on this process's domain. The tests know its
// figures:
// - A hand at rest that sways by 5 cm at 0.5 Hz. Its skin is refined to VERTICES vertices.
// - Objects, contacts and the status of modules.
// - A second world, after the message `second_world`: `there` or `removed`. Its object has the cube's id.
// - A flexible ball, after the message `ball` with another value than `removed`: `round` or `flat`.
//
// RATE is the number of samples per second (60). Every other sample comes a third of a period late, as on a busy
// machine.
//
// Output on stdout: a line when tissue_surface gets or loses its readers, and a line for each message that arrives.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "messages/convert.hpp"
#include "model/hand_model.hpp"
#include "runtime/clock.hpp"
#include "runtime/object_store.hpp"
#include "runtime/signals.hpp"

namespace {
using namespace softhand;

/// Splits the longest edges of the skin in two until the skin has `vertices` vertices. Each new vertex is embedded in
/// the tetrahedron of one end of its edge.
void refine_skin(HandModel& hand, std::size_t vertices) {
  const auto corners = [&hand](const SkinVertex& vertex) {
    const auto& nodes = hand.tetrahedra[static_cast<std::size_t>(vertex.tetrahedron)];
    Eigen::Matrix4d out;
    for (int k = 0; k < 4; ++k)
      out.col(k) << hand.nodes[static_cast<std::size_t>(nodes[static_cast<std::size_t>(k)])], 1.0;
    return out;
  };
  std::vector<Eigen::Vector4d> places;  // homogeneous, m
  for (const SkinVertex& vertex : hand.skin_vertices) {
    const auto& w = vertex.weights;
    places.emplace_back(corners(vertex) * Eigen::Vector4f(w[0], w[1], w[2], w[3]).cast<double>());
  }
  while (hand.skin_vertices.size() < vertices) {
    double longest = 0;
    std::array<std::size_t, 2> edge{};
    for (const auto& triangle : hand.skin_triangles) {
      for (std::size_t k = 0; k < 3; ++k) {
        const std::array<std::size_t, 2> ends{static_cast<std::size_t>(triangle[k]),
                                              static_cast<std::size_t>(triangle[(k + 1) % 3])};
        const double length = (places[ends[0]] - places[ends[1]]).squaredNorm();
        if (length <= longest) continue;
        longest = length;
        edge = ends;
      }
    }
    const std::size_t middle = places.size();
    places.emplace_back((places[edge[0]] + places[edge[1]]) / 2);
    SkinVertex vertex = hand.skin_vertices[edge[0]];
    const Eigen::Vector4d weights = corners(vertex).fullPivLu().solve(places[middle]);
    for (std::size_t k = 0; k < 4; ++k) vertex.weights[k] = static_cast<float>(weights(static_cast<Eigen::Index>(k)));
    hand.skin_vertices.push_back(vertex);
    const std::size_t triangles = hand.skin_triangles.size();
    for (std::size_t t = 0; t < triangles; ++t) {
      for (std::size_t k = 0; k < 3; ++k) {
        auto& triangle = hand.skin_triangles[t];
        const auto a = static_cast<std::size_t>(triangle[k]);
        const auto b = static_cast<std::size_t>(triangle[(k + 1) % 3]);
        if (!(a == edge[0] && b == edge[1]) && !(a == edge[1] && b == edge[0])) continue;
        auto half = triangle;
        triangle[(k + 1) % 3] = half[k] = static_cast<std::int32_t>(middle);
        hand.skin_triangles.push_back(half);
        break;
      }
    }
  }
}

std::unique_ptr<HandDescription> description_of(const HandModel& hand) {
  auto out = std::make_unique<HandDescription>();
  out->node_count = static_cast<std::uint32_t>(hand.nodes.size());
  for (const SkinVertex& vertex : hand.skin_vertices) {
    std::array<std::uint32_t, 4> nodes{};
    for (std::size_t k = 0; k < 4; ++k)
      nodes[k] = static_cast<std::uint32_t>(hand.tetrahedra[static_cast<std::size_t>(vertex.tetrahedron)][k]);
    out->vertex_nodes.push_back(nodes);
    out->vertex_weights.push_back(vertex.weights);
  }
  for (const auto& t : hand.skin_triangles)
    out->triangles.push_back(
        {static_cast<std::uint32_t>(t[0]), static_cast<std::uint32_t>(t[1]), static_cast<std::uint32_t>(t[2])});
  return out;
}

ObjectDescription box(std::uint32_t id, const char* name, const Vec3& half_extents, bool is_static) {
  ObjectDescription out;
  out.object = id;
  set_text(out.name, name);
  out.is_static = is_static ? 1 : 0;
  out.mass = is_static ? 0 : 0.05;
  out.friction = 0.8;
  out.shape.kind = static_cast<std::uint32_t>(ShapeKind::box);
  out.shape.size = half_extents;
  return out;
}

// The shipped ball in its rest shape, or with half of its height.
void shape_ball(const SoftBody& body, bool is_flat, SoftObjectState& out) {
  out.object = kFirstSoftObject;
  out.centre = {-0.05, 0.03, 0};
  out.nodes.clear();
  for (const Vector3& node : body.nodes)
    out.nodes.push_back({static_cast<float>(node.x()), static_cast<float>((is_flat ? 0.5 : 1) * node.y()),
                         static_cast<float>(node.z())});
}

void run(const std::string& hand_file, std::size_t vertices, double rate_hz) {
  HandModel hand = load_hand(hand_file);
  refine_skin(hand, vertices);
  const bus::Participant participant("viewer_publisher");
  bus::Writer descriptions(participant, bus::topics::hand_description);
  bus::Writer object_descriptions(participant, bus::topics::object_description);
  bus::Writer surfaces(participant, bus::topics::tissue_surface);
  bus::Writer simulated(participant, bus::topics::simulated_skeleton);
  bus::Writer contact_writer(participant, bus::topics::contacts);
  bus::Writer objects(participant, bus::topics::objects);
  bus::Writer wrenches(participant, bus::topics::bone_wrench);
  bus::Writer statuses(participant, bus::topics::loop_status);
  bus::Writer choices_writer(participant, bus::topics::rig_choices);
  bus::Writer soft_descriptions(participant, bus::topics::soft_object_description);
  bus::Writer soft_states(participant, bus::topics::soft_object_state);
  bus::Reader messages(participant, bus::topics::message);
  bus::Writer replies(participant, bus::topics::message_reply);
  descriptions.write(*description_of(hand));
  object_descriptions.write(box(1, "table", {0.4, 0.02, 0.4}, true));
  object_descriptions.write(box(2, "cube", {0.02, 0.02, 0.02}, false));

  const auto ball_file = find_object("sponge_ball", "", {SOFTHAND_SOURCE_DIR "/config/objects"});
  const SoftBody& ball = ball_file.value().model.soft.value();
  SoftObjectDescription ball_description;
  ball_description.object = kFirstSoftObject;
  set_text(ball_description.name, "ball");
  set_text(ball_description.file.name, "sponge_ball");
  set_text(ball_description.file.sha256, ball_file->sha256);
  ball_description.node_count = static_cast<std::uint32_t>(ball.nodes.size());
  auto ball_state = std::make_unique<SoftObjectState>();
  std::string ball_shape = "removed";

  auto surface = std::make_unique<TissueSurface>();
  auto contacts = std::make_unique<Contacts>();
  auto world = std::make_unique<WorldObjects>();
  Skeleton skeleton;
  BoneWrench wrench;
  LoopStatus status;
  double pace = 1;  // this value and the next ones change by message
  std::string chosen = "demo";
  std::string other = "pinch_lift";  // the scene besides demo
  std::string offered;
  bool motors = true;
  bool listed = true;  // the cube is among the objects
  // Another world, whose object has the id of the cube.
  auto second_world = std::make_unique<WorldObjects>();
  second_world->world = 1;
  ObjectDescription second_cube = box(2, "second_world", {0.02, 0.02, 0.02}, false);
  second_cube.world = second_world->world;
  bool watched = false;
  const StopSignal stop;
  const Nanoseconds start = now();
  const auto begin = std::chrono::steady_clock::now();
  for (std::uint64_t step = 1; !stop.requested(); ++step) {
    Stamp stamp;
    stamp.sequence = step;
    stamp.sample_time = stamp.publish_time = now();
    const double time = static_cast<double>(stamp.sample_time - start) * 1e-9;
    const Vector3 wrist(0.05 * std::sin(std::numbers::pi * time), 0.06, 0.08);

    surface->stamp = skeleton.stamp = contacts->stamp = world->stamp = wrench.stamp = status.stamp = stamp;
    surface->wrist_position = to_wire(wrist);
    surface->nodes.clear();
    for (const Vector3& node : hand.nodes)
      surface->nodes.push_back(
          {static_cast<float>(node.x()), static_cast<float>(node.y()), static_cast<float>(node.z())});
    surfaces.write(*surface);
    for (std::size_t j = 0; j < skeleton.joints.size(); ++j) {
      skeleton.joints[j].position = to_wire(Vector3(wrist + hand.rest_joints[j].position));
      skeleton.joints[j].orientation = to_wire(hand.rest_joints[j].orientation);
      skeleton.joints[j].flags = kJointValid | kJointTracked;
    }
    simulated.write(skeleton);
    Contact contact;
    contact.node = static_cast<std::uint32_t>(hand.nodes.size() / 2);
    contact.finger = 1;
    contact.point = to_wire(Vector3(wrist + hand.nodes[contact.node]));
    contact.force = {0, 1.5, 0};
    contact.normal = {0, 1, 0};
    contact.area = 1e-4;
    contact.penetration = 0.0004;
    contacts->contacts.clear();
    contacts->contacts.push_back(contact);
    // Light contacts all over the fingers, so that pressure shows from every side.
    Contact light = contact;
    light.force = {0, 0.05, 0};
    light.area = 1e-5;
    for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
      if (hand.nodes[n].z() > -0.08) continue;
      light.node = static_cast<std::uint32_t>(n);
      light.point = to_wire(Vector3(wrist + hand.nodes[n]));
      contacts->contacts.push_back(light);
    }
    contacts->fingers[1] = {contact.force, contact.point, contact.normal, contact.area, 0, 2, 1};
    contact_writer.write(*contacts);
    world->objects.clear();
    ObjectState table;
    table.object = 1;
    table.position = {0, -0.02, 0};
    world->objects.push_back(table);
    ObjectState cube;
    cube.object = 2;
    cube.position = {0.02, 0.02, 0};
    if (listed) world->objects.push_back(cube);
    objects.write(*world);
    if (!second_world->objects.empty()) {
      second_world->stamp = stamp;
      objects.write(*second_world);
    }
    if (ball_shape != "removed") {
      shape_ball(ball, ball_shape == "flat", *ball_state);
      ball_state->stamp = stamp;
      soft_states.write(*ball_state);
    }
    wrench.simulated_valid = 1;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      wrench.bones[b].intermediate_position =
          skeleton.joints[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(b))))].position;
      wrench.bones[b].coupling_force = {2, 0, 0};
    }
    wrenches.write(wrench);
    if (step % 10 == 0) {
      set_text(status.module, "hand");
      status.rate_hz = 89.6;
      status.nominal_rate_hz = 90;
      status.step_ms_p50 = 2.75;
      status.step_ms_p99 = 8.25;
      status.step_ms_p999 = 9.75;
      status.input_drops = 4;
      status.deadline_misses = step;  // differs in each status, so that a test can match a shown row with its status
      status.input_age_ms = 12.5;
      status.residual = 0.0125;
      status.iterations = 3;
      status.contact_count = 1;
      status.inverted_elements = 2;
      status.penetration = 0.0004;
      status.coupling_stretch = 0.00175;
      status.steps = step;
      status.energies.clear();
      add_named(status.energies, "tissue", 0.012);
      add_named(status.energies, "contact", 0.003);
      status.ledger.clear();
      add_named(status.ledger, "work", 1.25);
      add_named(status.ledger, "residual", 2e-9);
      status.counters.clear();
      add_counter(status, "chord_steps", 17);
      add_counter(status, "pace", pace);
      statuses.write(status);
      // What the page offers for choosing. Written only after a change.
      if (const std::string both = chosen + "/" + other; offered != both) {
        offered = both;
        RigChoices rig;
        set_text(rig.module, "rig");
        for (const std::string_view scene : {std::string_view("demo"), std::string_view(other)}) {
          RigChoice choice;
          set_text(choice.what, "scene");
          set_text(choice.choice, scene);
          choice.running = scene == chosen ? 1 : 0;
          rig.choices.push_back(choice);
        }
        choices_writer.write(rig);
      }
      // A module whose counter the page offers for switching.
      LoopStatus haptic;
      set_text(haptic.module, "haptic");
      haptic.nominal_rate_hz = 1000;
      haptic.input_age_ms = 1'234'567.8;  // age for a hand that has not published for a long time
      haptic.passivity_energy = -0.25;
      add_counter(haptic, "motors", motors ? 1 : 0);
      add_counter(haptic, "second_writer", 42);
      set_text(haptic.second_writer, "bone_wrench: tracking, process 4711 on lab-pc");
      statuses.write(haptic);
    }
    messages.take_all([&](const Message& message) {
      std::printf("message %s %s %s\n", message.module.data(), message.key.data(), message.value.data());
      if (get_text(message.key) == "pace") pace = std::strtod(message.value.data(), nullptr);
      if (get_text(message.key) == "scene") chosen = get_text(message.value);
      if (get_text(message.key) == "offer") other = get_text(message.value);
      if (get_text(message.key) == "cube") listed = get_text(message.value) == "listed";
      if (get_text(message.key) == "second_world") {
        second_cube.removed = get_text(message.value) == "removed" ? 1 : 0;
        object_descriptions.write(second_cube);
        second_world->objects.clear();
        cube.position = {-0.12, 0.02, 0};
        if (second_cube.removed == 0) second_world->objects.push_back(cube);
      }
      if (get_text(message.key) == "ball") {
        ball_shape = get_text(message.value);
        ball_description.removed = ball_shape == "removed" ? 1 : 0;
        // No file of this name is shipped.
        set_text(ball_description.file.name, ball_shape.starts_with("unknown") ? "late_ball" : "sponge_ball");
        soft_descriptions.write(ball_description);
      }
      if (get_text(message.key) == "motors") motors = get_text(message.value) == "on";
      if (get_text(message.module) == "viewer") return;  // the viewer answers
      MessageReply reply;
      reply.id = message.id;
      set_text(reply.module, "hand");
      reply.result = kReplyApplied;
      set_text(reply.text, "done as asked");
      replies.write(reply);
    });
    if (watched != surfaces.has_readers()) {
      watched = !watched;
      std::printf("surface %s\n", watched ? "read" : "unread");
    }
    std::fflush(stdout);
    const double periods = static_cast<double>(step) + (step % 2 == 1 ? 1.0 / 3 : 0);
    std::this_thread::sleep_until(begin + std::chrono::nanoseconds(static_cast<Nanoseconds>(1e9 * periods / rate_hz)));
  }
}
}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 4) return 2;
  run(argv[1], argc > 2 ? std::stoul(argv[2]) : 0, argc > 3 ? std::stod(argv[3]) : 60);
}
