// The hand file: JSON, version 2, described in docs/hand-file.md. Numbers are rounded on writing (1e-7 m, eight
// significant digits for physical quantities). So the file is small and diffs are readable. A file that is read and
// written again has the same bytes.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "model/hand_model.hpp"
#include "model/json_fields.hpp"

namespace softhand {
namespace {

constexpr int kHandVersion = 2;
constexpr const char* kHandFormat = "softhand-hand";

const std::map<JointKind, std::string> kKindNames{
    {JointKind::free, "free"}, {JointKind::ball, "ball"}, {JointKind::saddle, "saddle"}, {JointKind::hinge, "hinge"}};

Json body_json(const HandModel& hand, int b) {
  const BodyModel& body = hand.bodies[static_cast<std::size_t>(b)];
  const auto kind = kKindNames.at(body.joint.kind);
  const Matrix3& i = body.inertia;
  return Json{
      {"name", kBodyNames[static_cast<std::size_t>(b)]},
      {"mass", quantity(body.mass)},
      {"centre_of_mass", vector_json(body.joint_from_body.position, metres)},
      {"orientation", quaternion_json(body.joint_from_body.orientation)},
      {"inertia", Json::array({quantity(i(0, 0)), quantity(i(1, 1)), quantity(i(2, 2)), quantity(i(0, 1)),
                               quantity(i(0, 2)), quantity(i(1, 2))})},
      {"bone",
       {{"start", vector_json(body.bone_start, metres)},
        {"end", vector_json(body.bone_end, metres)},
        {"start_radius", metres(body.bone_start_radius)},
        {"end_radius", metres(body.bone_end_radius)}}},
      {"joint",
       {{"kind", kind},
        {"position_stiffness", quantity(body.joint.position_stiffness)},
        {"orientation_stiffness", quantity(body.joint.orientation_stiffness)},
        {"limit_stiffness", quantity(body.joint.limit_stiffness)},
        {"flexion_range", Json::array({quantity(body.joint.flexion_range[0]), quantity(body.joint.flexion_range[1])})},
        {"abduction_range",
         Json::array({quantity(body.joint.abduction_range[0]), quantity(body.joint.abduction_range[1])})}}},
      {"coupling",
       {{"linear_stiffness", quantity(body.coupling_linear_stiffness)},
        {"angular_stiffness", quantity(body.coupling_angular_stiffness)},
        {"force_cap", quantity(body.coupling_force_cap)},
        {"torque_cap", quantity(body.coupling_torque_cap)}}}};
}

BodyModel read_body(const FieldReader& reader) {
  reader.expect_keys({"name", "mass", "centre_of_mass", "orientation", "inertia", "bone", "joint", "coupling"});
  BodyModel body;
  body.mass = reader["mass"].number();
  body.joint_from_body = {reader["centre_of_mass"].vector(), reader["orientation"].quaternion()};
  const FieldReader inertia = reader["inertia"];
  if (inertia.size() != 6) inertia.fail("6 numbers: xx yy zz xy xz yz");
  const auto i = [&inertia](std::size_t k) { return inertia.at(k).number(); };
  body.inertia << i(0), i(3), i(4), i(3), i(1), i(5), i(4), i(5), i(2);
  const FieldReader bone = reader["bone"];
  bone.expect_keys({"start", "end", "start_radius", "end_radius"});
  body.bone_start = bone["start"].vector();
  body.bone_end = bone["end"].vector();
  body.bone_start_radius = bone["start_radius"].number();
  body.bone_end_radius = bone["end_radius"].number();
  const FieldReader joint = reader["joint"];
  joint.expect_keys(
      {"kind", "position_stiffness", "orientation_stiffness", "limit_stiffness", "flexion_range", "abduction_range"});
  const std::string kind = joint["kind"].string();
  const auto found =
      std::find_if(kKindNames.begin(), kKindNames.end(), [&kind](const auto& entry) { return entry.second == kind; });
  if (found == kKindNames.end()) joint["kind"].fail("free, ball, saddle or hinge");
  body.joint = {found->first,
                joint["position_stiffness"].number(),
                joint["orientation_stiffness"].number(),
                joint["limit_stiffness"].number(),
                joint["flexion_range"].range(),
                joint["abduction_range"].range()};
  const FieldReader coupling = reader["coupling"];
  coupling.expect_keys({"linear_stiffness", "angular_stiffness", "force_cap", "torque_cap"});
  body.coupling_linear_stiffness = coupling["linear_stiffness"].number();
  body.coupling_angular_stiffness = coupling["angular_stiffness"].number();
  body.coupling_force_cap = coupling["force_cap"].number();
  body.coupling_torque_cap = coupling["torque_cap"].number();
  return body;
}

}  // namespace

void save_hand(const HandModel& hand, const std::string& path) {
  Json json;
  json["format"] = kHandFormat;
  json["version"] = kHandVersion;
  json["units"] = kUnits;
  json["name"] = hand.name;
  json["side"] = hand.side == Side::left ? "left" : "right";
  json["notice"] = hand.notice;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    json["joints"].push_back({{"name", kJointNames[j]},
                              {"position", vector_json(hand.rest_joints[j].position, metres)},
                              {"orientation", quaternion_json(hand.rest_joints[j].orientation)},
                              {"radius", metres(hand.joint_radii[j])}});
  }
  for (int b = 0; b < kBodyCount; ++b) json["bodies"].push_back(body_json(hand, b));
  for (const Material& m : hand.materials) {
    Json material{{"name", m.name},
                  {"density", quantity(m.density)},
                  {"youngs_modulus", quantity(m.youngs_modulus)},
                  {"poisson_ratio", quantity(m.poisson_ratio)},
                  {"strain_limit_energy", quantity(m.strain_limit_energy)},
                  {"strain_limit_stiffness", quantity(m.strain_limit_stiffness)}};
    if (m.strain_limit_ramp != 0) material["strain_limit_ramp"] = quantity(m.strain_limit_ramp);
    json["materials"].push_back(std::move(material));
  }
  // Large arrays are flat, each on its own line.
  const auto flat = [&json](const char* key, const auto& fill) {
    Json array = Json::array();
    fill(array);
    json[key] = std::move(array);
  };
  flat("nodes", [&](Json& a) {
    for (const Vector3& x : hand.nodes)
      for (int k = 0; k < 3; ++k) a.push_back(metres(x[k]));
  });
  flat("tetrahedra", [&](Json& a) {
    for (const auto& t : hand.tetrahedra)
      for (const auto n : t) a.push_back(n);
  });
  flat("tetrahedron_material", [&](Json& a) {
    for (const auto m : hand.tetrahedron_material) a.push_back(m);
  });
  flat("surface", [&](Json& a) {
    for (const auto& t : hand.surface)
      for (const auto n : t) a.push_back(n);
  });
  flat("node_body", [&](Json& a) {
    for (const auto b : hand.node_body) a.push_back(b);
  });
  flat("attachment_body", [&](Json& a) {
    for (const auto& x : hand.attachments) a.push_back(x.body);
  });
  flat("attachment_tetrahedron", [&](Json& a) {
    for (const auto& x : hand.attachments) a.push_back(x.tetrahedron);
  });
  // The last weight is 1 minus the other rounded weights, so that a reader finds a sum of 1.
  const auto push_weights = [](Json& a, const std::array<double, 4>& weights, double (*round)(double)) {
    double rest = 1;
    for (std::size_t k = 0; k < 3; ++k) {
      const double w = round(weights[k]);
      a.push_back(w);
      rest -= w;
    }
    a.push_back(round(rest));
  };
  flat("attachment_weights", [&](Json& a) {
    for (const auto& x : hand.attachments) push_weights(a, x.weights, fraction);
  });
  flat("attachment_stiffness", [&](Json& a) {
    for (const auto& x : hand.attachments) a.push_back(short_decimal(x.stiffness, "%.5g"));
  });
  flat("contact_tetrahedron", [&](Json& a) {
    for (const auto& x : hand.contact_points) a.push_back(x.tetrahedron);
  });
  flat("contact_weights", [&](Json& a) {
    for (const auto& x : hand.contact_points)
      push_weights(a, x.weights, [](double w) { return short_decimal(w, "%.4f"); });
  });
  flat("contact_area", [&](Json& a) {
    for (const auto& x : hand.contact_points) a.push_back(short_decimal(x.area, "%.4g"));
  });
  flat("contact_body", [&](Json& a) {
    for (const auto& x : hand.contact_points) a.push_back(x.body);
  });
  flat("skin_tetrahedron", [&](Json& a) {
    for (const auto& x : hand.skin_vertices) a.push_back(x.tetrahedron);
  });
  flat("skin_weights", [&](Json& a) {
    for (const auto& x : hand.skin_vertices)
      for (const auto w : x.weights) a.push_back(short_decimal(static_cast<double>(w), "%.4f"));
  });
  flat("skin_triangles", [&](Json& a) {
    for (const auto& t : hand.skin_triangles)
      for (const auto n : t) a.push_back(n);
  });

  std::ofstream out(path);
  out << "{\n";
  bool first = true;
  for (const auto& [key, value] : json.items()) {
    out << (first ? "" : ",\n") << '"' << key << "\": ";
    first = false;
    const bool records = value.is_array() && !value.empty() && value.front().is_object();
    if (!records) {
      out << value.dump();
      continue;
    }
    out << "[\n";
    for (std::size_t i = 0; i < value.size(); ++i)
      out << "  " << value[i].dump() << (i + 1 < value.size() ? ",\n" : "\n]");
  }
  out << "\n}\n";
  out.flush();
  if (!out) throw std::runtime_error(path + ": cannot be written");
}

HandModel load_hand(const std::string& path) {
  std::ifstream in(path);
  if (!in || std::filesystem::is_directory(path)) throw std::runtime_error(path + ": cannot be opened");
  return parse_hand({std::istreambuf_iterator<char>(in), {}}, path);
}

HandModel parse_hand(const std::string& text, const std::string& path) {
  Json json;
  try {
    json = Json::parse(text);
  } catch (const Json::exception& error) {  // a number too large for a double is not a parse_error
    throw std::runtime_error(path + ": not a hand file: " + error.what());
  }
  const FieldReader root(json, path, "");
  if (root["format"].string() != kHandFormat) root["format"].fail(std::string("'") + kHandFormat + "'");
  if (root["version"].index() != kHandVersion) {
    root["version"].fail(
        std::to_string(kHandVersion) +
        "; `softhand-build-hand --mesh` adds the contact points that version 1 has not (docs/hand-builder.md)");
  }
  if (root["units"].string() != kUnits) root["units"].fail(std::string("'") + kUnits + "'");
  root.expect_keys({"format",
                    "version",
                    "units",
                    "name",
                    "side",
                    "notice",
                    "joints",
                    "bodies",
                    "materials",
                    "nodes",
                    "tetrahedra",
                    "tetrahedron_material",
                    "surface",
                    "node_body",
                    "attachment_body",
                    "attachment_tetrahedron",
                    "attachment_weights",
                    "attachment_stiffness",
                    "contact_tetrahedron",
                    "contact_weights",
                    "contact_area",
                    "contact_body",
                    "skin_tetrahedron",
                    "skin_weights",
                    "skin_triangles"});
  HandModel hand;
  hand.name = root["name"].string();
  hand.notice = root["notice"].string();
  const std::string side = root["side"].string();
  if (side != "left" && side != "right") root["side"].fail("left or right");
  hand.side = side == "left" ? Side::left : Side::right;

  const FieldReader joints = root["joints"];
  if (joints.size() != kJointCount) joints.fail("26 joints");
  for (std::size_t j = 0; j < kJointCount; ++j) {
    joints.at(j).expect_keys({"name", "position", "orientation", "radius"});
    if (joints.at(j)["name"].string() != kJointNames[j])
      joints.at(j)["name"].fail("'" + std::string(kJointNames[j]) + "'");
    hand.rest_joints[j] = {joints.at(j)["position"].vector(), joints.at(j)["orientation"].quaternion()};
    hand.joint_radii[j] = joints.at(j)["radius"].number();
  }
  const FieldReader bodies = root["bodies"];
  if (bodies.size() != kBodyCount) bodies.fail("21 bodies");
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    if (bodies.at(b)["name"].string() != kBodyNames[b])
      bodies.at(b)["name"].fail("'" + std::string(kBodyNames[b]) + "'");
    hand.bodies[b] = read_body(bodies.at(b));
  }
  const FieldReader materials = root["materials"];
  for (std::size_t m = 0; m < materials.size(); ++m) {
    const FieldReader r = materials.at(m);
    r.expect_keys({"name", "density", "youngs_modulus", "poisson_ratio", "strain_limit_energy",
                   "strain_limit_stiffness", "strain_limit_ramp"});
    hand.materials.push_back({r["name"].string(), r["density"].number(), r["youngs_modulus"].number(),
                              r["poisson_ratio"].number(), r["strain_limit_energy"].number(),
                              r["strain_limit_stiffness"].number(),
                              r.has("strain_limit_ramp") ? r["strain_limit_ramp"].number() : 0});
  }

  const FieldReader nodes = root["nodes"];
  for (std::size_t n = 0; n < nodes.records(3); ++n) {
    hand.nodes.emplace_back(nodes.at(3 * n).number(), nodes.at(3 * n + 1).number(), nodes.at(3 * n + 2).number());
  }
  const auto read_indices = [&root](const char* key, auto& out) {
    const FieldReader field = root[key];
    constexpr std::size_t width = std::tuple_size_v<typename std::remove_reference_t<decltype(out)>::value_type>;
    out.resize(field.records(width));
    for (std::size_t i = 0; i < out.size(); ++i) {
      for (std::size_t k = 0; k < width; ++k) out[i][k] = field.at(width * i + k).index();
    }
  };
  const auto read_bytes = [&root](const char* key, std::vector<std::uint8_t>& out) {
    const FieldReader field = root[key];
    for (std::size_t i = 0; i < field.size(); ++i) {
      const std::int32_t value = field.at(i).index();
      if (value > 255) field.at(i).fail("an index below 256");
      out.push_back(static_cast<std::uint8_t>(value));
    }
  };
  read_indices("tetrahedra", hand.tetrahedra);
  read_bytes("tetrahedron_material", hand.tetrahedron_material);
  read_indices("surface", hand.surface);
  read_bytes("node_body", hand.node_body);

  const auto read_weights = [](const FieldReader& field, std::size_t i) {
    std::array<double, 4> weights{};
    double sum = 0;
    for (std::size_t k = 0; k < 4; ++k) sum += weights[k] = field.at(4 * i + k).number();
    if (!(std::abs(sum - 1.0) < 1e-4)) field.at(4 * i).fail("four weights with sum 1");
    for (double& w : weights) w /= sum;
    return weights;
  };
  const FieldReader attachment_body = root["attachment_body"];
  const FieldReader attachment_tetrahedron = root["attachment_tetrahedron"];
  const FieldReader attachment_weights = root["attachment_weights"];
  const FieldReader attachment_stiffness = root["attachment_stiffness"];
  hand.attachments.resize(attachment_body.size());
  if (attachment_tetrahedron.size() != hand.attachments.size())
    attachment_tetrahedron.fail("as many items as attachment_body");
  if (attachment_weights.records(4) != hand.attachments.size())
    attachment_weights.fail("four items for each item of attachment_body");
  if (attachment_stiffness.size() != hand.attachments.size())
    attachment_stiffness.fail("as many items as attachment_body");
  for (std::size_t a = 0; a < hand.attachments.size(); ++a) {
    Attachment& attachment = hand.attachments[a];
    attachment.body = attachment_body.at(a).index();
    attachment.tetrahedron = attachment_tetrahedron.at(a).index();
    attachment.stiffness = attachment_stiffness.at(a).number();
    attachment.weights = read_weights(attachment_weights, a);
  }
  const FieldReader contact_tetrahedron = root["contact_tetrahedron"];
  const FieldReader contact_weights = root["contact_weights"];
  const FieldReader contact_area = root["contact_area"];
  std::vector<std::uint8_t> contact_body;
  read_bytes("contact_body", contact_body);
  hand.contact_points.resize(contact_tetrahedron.size());
  if (contact_weights.records(4) != hand.contact_points.size())
    contact_weights.fail("four items for each item of contact_tetrahedron");
  if (contact_area.size() != hand.contact_points.size()) contact_area.fail("as many items as contact_tetrahedron");
  if (contact_body.size() != hand.contact_points.size())
    root["contact_body"].fail("as many items as contact_tetrahedron");
  for (std::size_t p = 0; p < hand.contact_points.size(); ++p) {
    hand.contact_points[p] = {contact_tetrahedron.at(p).index(), read_weights(contact_weights, p),
                              contact_area.at(p).number(), contact_body[p]};
  }
  const FieldReader skin_tetrahedron = root["skin_tetrahedron"];
  const FieldReader skin_weights = root["skin_weights"];
  hand.skin_vertices.resize(skin_tetrahedron.size());
  if (skin_weights.records(4) != hand.skin_vertices.size())
    skin_weights.fail("four items for each item of skin_tetrahedron");
  for (std::size_t v = 0; v < hand.skin_vertices.size(); ++v) {
    hand.skin_vertices[v].tetrahedron = skin_tetrahedron.at(v).index();
    for (std::size_t k = 0; k < 4; ++k)
      hand.skin_vertices[v].weights[k] = static_cast<float>(skin_weights.at(4 * v + k).number());
  }
  read_indices("skin_triangles", hand.skin_triangles);
  try {
    drop_loose_nodes(hand);
    validate(hand, path);
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(error.what());
  }
  return hand;
}

}  // namespace softhand
