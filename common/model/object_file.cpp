// The object file: JSON, version 1, described in docs/object-file.md. Numbers are rounded on writing (1e-6 m, eight
// significant digits for physical quantities).
#include <Eigen/Eigenvalues>
#include <cmath>
#include <fstream>
#include <numbers>
#include <set>
#include <stdexcept>

#include "model/json_fields.hpp"
#include "model/object_model.hpp"

namespace softhand {
namespace {

constexpr int kObjectVersion = 1;
constexpr const char* kObjectFormat = "softhand-object";
constexpr double kLargest = 10;  // m, of a coordinate

double micrometres(double value) { return short_decimal(to_grid(value, 1e-6), "%.6f"); }

Json pose_json(const Pose& pose) {
  return {{"position", vector_json(pose.position, metres)}, {"orientation", quaternion_json(pose.orientation)}};
}

template <typename Points>
Json flat_json(const Points& points) {
  Json out = Json::array();
  for (const Vector3& p : points)
    for (int k = 0; k < 3; ++k) out.push_back(micrometres(p[k]));
  return out;
}

Pose read_pose(const FieldReader& reader) {
  reader.expect_keys({"position", "orientation"});
  return {reader["position"].vector(), reader["orientation"].quaternion()};
}

std::vector<Vector3> read_points(const FieldReader& reader) {
  std::vector<Vector3> out(reader.records(3));
  for (std::size_t i = 0; i < out.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) out[i][static_cast<Eigen::Index>(k)] = reader.at(3 * i + k).number();
  return out;
}

Json link_json(const ObjectLink& link) {
  const Matrix3& i = link.inertia;
  Json out{{"name", link.name},
           {"mass", quantity(link.mass)},
           {"centre_of_mass", vector_json(link.centre_of_mass, metres)},
           {"inertia", Json::array({quantity(i(0, 0)), quantity(i(1, 1)), quantity(i(2, 2)), quantity(i(0, 1)),
                                    quantity(i(0, 2)), quantity(i(1, 2))})},
           {"friction", quantity(link.friction)},
           {"grid_spacing", micrometres(link.grid_spacing)},
           {"vertices", flat_json(link.mesh.vertices)}};
  Json triangles = Json::array();
  for (const auto& t : link.mesh.triangles)
    for (const auto v : t) triangles.push_back(v);
  out["triangles"] = std::move(triangles);
  out["pieces"] = Json::array();
  for (const auto& piece : link.pieces) out["pieces"].push_back(flat_json(piece));
  return out;
}

ObjectLink read_link(const FieldReader& reader) {
  reader.expect_keys(
      {"name", "mass", "centre_of_mass", "inertia", "friction", "grid_spacing", "vertices", "triangles", "pieces"});
  ObjectLink link;
  link.name = reader["name"].string();
  link.mass = reader["mass"].number();
  link.centre_of_mass = reader["centre_of_mass"].vector();
  const FieldReader inertia = reader["inertia"];
  if (inertia.size() != 6) inertia.fail("6 numbers: xx yy zz xy xz yz");
  const auto i = [&inertia](std::size_t k) { return inertia.at(k).number(); };
  link.inertia << i(0), i(3), i(4), i(3), i(1), i(5), i(4), i(5), i(2);
  link.friction = reader["friction"].number();
  link.grid_spacing = reader["grid_spacing"].number();
  link.mesh.vertices = read_points(reader["vertices"]);
  const FieldReader triangles = reader["triangles"];
  link.mesh.triangles.resize(triangles.records(3));
  for (std::size_t t = 0; t < link.mesh.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) link.mesh.triangles[t][k] = triangles.at(3 * t + k).index();
  const FieldReader pieces = reader["pieces"];
  for (std::size_t p = 0; p < pieces.size(); ++p) link.pieces.push_back(read_points(pieces.at(p)));
  return link;
}

Json soft_json(const SoftBody& body) {
  Json tetrahedra = Json::array();
  for (const auto& t : body.tetrahedra)
    for (const auto n : t) tetrahedra.push_back(n);
  Json out{{"density", quantity(body.material.density)},
           {"youngs_modulus", quantity(body.material.youngs_modulus)},
           {"poisson_ratio", quantity(body.material.poisson_ratio)},
           {"strain_limit_energy", quantity(body.material.strain_limit_energy)},
           {"strain_limit_stiffness", quantity(body.material.strain_limit_stiffness)},
           {"friction", quantity(body.friction)},
           {"nodes", flat_json(body.nodes)},
           {"tetrahedra", std::move(tetrahedra)}};
  if (body.material.strain_limit_ramp != 0) out["strain_limit_ramp"] = quantity(body.material.strain_limit_ramp);
  return out;
}

SoftBody read_soft(const FieldReader& reader) {
  reader.expect_keys({"density", "youngs_modulus", "poisson_ratio", "strain_limit_energy", "strain_limit_stiffness",
                      "strain_limit_ramp", "friction", "nodes", "tetrahedra"});
  SoftBody body;
  body.material.name = "soft";
  body.material.density = reader["density"].number();
  body.material.youngs_modulus = reader["youngs_modulus"].number();
  body.material.poisson_ratio = reader["poisson_ratio"].number();
  body.material.strain_limit_energy = reader["strain_limit_energy"].number();
  body.material.strain_limit_stiffness = reader["strain_limit_stiffness"].number();
  if (reader.has("strain_limit_ramp")) body.material.strain_limit_ramp = reader["strain_limit_ramp"].number();
  body.friction = reader["friction"].number();
  body.nodes = read_points(reader["nodes"]);
  const FieldReader tetrahedra = reader["tetrahedra"];
  body.tetrahedra.resize(tetrahedra.records(4));
  for (std::size_t t = 0; t < body.tetrahedra.size(); ++t)
    for (std::size_t k = 0; k < 4; ++k) body.tetrahedra[t][k] = tetrahedra.at(4 * t + k).index();
  return body;
}

Json joint_json(const ObjectModel& object, const LinkJoint& joint) {
  const JointLaw& law = joint.law;
  Json out{{"kind", std::string(to_string(law.kind))},
           {"parent", object.links[joint.parent].name},
           {"child", object.links[joint.child].name},
           {"parent_from_joint", pose_json(joint.parent_from_joint)},
           {"child_from_joint", pose_json(joint.child_from_joint)}};
  if (law.kind == ObjectJointKind::screw) out["pitch"] = quantity(law.pitch);
  if (std::isfinite(law.minimum)) out["minimum"] = quantity(law.minimum);
  if (std::isfinite(law.maximum)) out["maximum"] = quantity(law.maximum);
  if (law.friction != 0) out["friction"] = quantity(law.friction);
  if (law.load_friction != 0) out["load_friction"] = quantity(law.load_friction);
  if (law.damping != 0) out["damping"] = quantity(law.damping);
  if (law.stiffness != 0) {
    out["stiffness"] = quantity(law.stiffness);
    out["rest"] = quantity(law.rest);
  }
  for (const Detent& well : law.wells()) {
    out["detents"].push_back({{"at", quantity(well.at)},
                              {"depth", quantity(well.depth)},
                              {"width", quantity(well.width)},
                              {"period", quantity(well.period)}});
  }
  return out;
}

LinkJoint read_joint(const FieldReader& reader, const ObjectModel& object) {
  reader.expect_keys({"kind", "parent", "child", "parent_from_joint", "child_from_joint", "pitch", "minimum", "maximum",
                      "friction", "load_friction", "damping", "stiffness", "rest", "detents"});
  LinkJoint joint;
  const auto link = [&](const char* key) {
    const std::string name = reader[key].string();
    for (std::size_t i = 0; i < object.links.size(); ++i)
      if (object.links[i].name == name) return i;
    reader[key].fail("the name of a link, found '" + name + "'");
  };
  joint.parent = link("parent");
  joint.child = link("child");
  joint.parent_from_joint = read_pose(reader["parent_from_joint"]);
  joint.child_from_joint = read_pose(reader["child_from_joint"]);
  joint.law = read_joint_law(reader);
  return joint;
}

// Writes a message with the field if `holds` is false.
struct ObjectChecker {
  const std::string& file;
  void operator()(bool holds, const std::string& field, const std::string& expected) const {
    if (!holds) throw std::runtime_error(file + ": " + field + ": expected " + expected);
  }
};

bool is_name(const std::string& name) {
  return !name.empty() && name.size() <= 63 &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-") ==
             std::string::npos;
}

void check_points(const ObjectChecker& check, const std::vector<Vector3>& points, const std::string& field) {
  for (const Vector3& p : points)
    check(p.allFinite() && p.cwiseAbs().maxCoeff() <= kLargest, field, "coordinates from -10 to 10 m");
}

void check_mesh(const ObjectChecker& check, const TriangleMesh& mesh, const std::string& where) {
  check_points(check, mesh.vertices, where + ".vertices");
  check(mesh.triangles.size() >= 4 && mesh.triangles.size() <= kMaxLinkTriangles, where + ".triangles",
        "4 to " + std::to_string(kMaxLinkTriangles) + " triangles");
  std::set<std::array<std::int32_t, 2>> edges;
  std::vector<bool> used(mesh.vertices.size(), false);
  double volume = 0;
  for (const auto& t : mesh.triangles) {
    for (const auto v : t) {
      check(v >= 0 && static_cast<std::size_t>(v) < mesh.vertices.size(), where + ".triangles", "indices of vertices");
      used[static_cast<std::size_t>(v)] = true;
    }
    const auto x = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(t[k])]; };
    check((x(1) - x(0)).cross(x(2) - x(0)).norm() > 0, where + ".triangles", "triangles with an area");
    volume += x(0).dot(x(1).cross(x(2))) / 6;
    for (std::size_t k = 0; k < 3; ++k)
      check(edges.insert({t[k], t[(k + 1) % 3]}).second, where + ".triangles",
            "at most one triangle on each side of an edge, all with the same orientation");
  }
  for (const auto& edge : edges)
    check(edges.count({edge[1], edge[0]}) == 1, where + ".triangles",
          "a closed surface, but an edge has only one triangle");
  for (const bool u : used) check(u, where + ".vertices", "every vertex to belong to a triangle");
  check(volume > 0, where + ".triangles", "outward orientation, but the volume is not above 0");
}

void check_link(const ObjectChecker& check, const ObjectLink& link, const std::string& where) {
  check(is_name(link.name), where + ".name", "1 to 63 letters, digits, _ or -");
  check(link.grid_spacing >= 1e-4 && link.grid_spacing <= 0.1, where + ".grid_spacing", "0.0001 to 0.1 m");
  check_mesh(check, link.mesh, where);
  check(link.mass > 0 && link.mass <= 1000, where + ".mass", "a number above 0 and up to 1000 kg");
  check(link.friction >= 0 && link.friction <= 10, where + ".friction", "0 to 10");
  Vector3 low = link.mesh.vertices[0], high = low;
  for (const Vector3& v : link.mesh.vertices) {
    low = low.cwiseMin(v);
    high = high.cwiseMax(v);
  }
  const Vector3& centre = link.centre_of_mass;
  check((centre.array() >= low.array()).all() && (centre.array() <= high.array()).all(), where + ".centre_of_mass",
        "a point inside the box around the vertices");
  const Matrix3& inertia = link.inertia;
  check(inertia.allFinite(), where + ".inertia", "finite numbers");
  const Vector3 moments = Eigen::SelfAdjointEigenSolver<Matrix3>(inertia).eigenvalues();
  check(moments[0] > 0 && moments[0] + moments[1] >= 0.999 * moments[2], where + ".inertia",
        "a positive definite inertia, whose largest moment is not above the sum of the others");
  // No body inside the box has a larger moment.
  check(moments[2] <= link.mass * (high - low).squaredNorm(), where + ".inertia",
        "at most mass times the squared diagonal of the box around the vertices");
  check(link.pieces.size() <= kMaxLinkPieces, where + ".pieces", "at most " + std::to_string(kMaxLinkPieces));
  for (std::size_t p = 0; p < link.pieces.size(); ++p) {
    const std::string piece = where + ".pieces[" + std::to_string(p) + "]";
    check(link.pieces[p].size() >= 4 && link.pieces[p].size() <= kMaxPieceVertices, piece,
          "4 to " + std::to_string(kMaxPieceVertices) + " vertices");
    check_points(check, link.pieces[p], piece);
  }
}

// The tetrahedra have the limits of the tetrahedra of a hand.
void check_soft(const ObjectChecker& check, const SoftBody& body, const std::string& file) {
  check(body.nodes.size() <= kMaxSoftNodes, "soft.nodes", "4 to " + std::to_string(kMaxSoftNodes) + " nodes");
  check(body.friction >= 0 && body.friction <= 10, "soft.friction", "0 to 10");
  TissueModel model;
  model.nodes = body.nodes;
  model.tetrahedra = body.tetrahedra;
  model.tetrahedron_material.assign(body.tetrahedra.size(), 0);
  model.materials = {body.material};
  try {
    validate_tetrahedra(model, file + ": soft");
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(error.what());
  }
}

}  // namespace

JointLaw read_joint_law(const FieldReader& reader) {
  JointLaw law;
  try {
    law.kind = object_joint_kind(reader["kind"].string());
  } catch (const std::invalid_argument&) {
    reader["kind"].fail("fixed, hinge, slider, ball or screw");
  }
  const auto optional = [&reader](const char* key, double& value) {
    if (reader.has(key)) value = reader[key].number();
  };
  optional("pitch", law.pitch);
  optional("minimum", law.minimum);
  optional("maximum", law.maximum);
  optional("friction", law.friction);
  optional("load_friction", law.load_friction);
  optional("damping", law.damping);
  optional("stiffness", law.stiffness);
  optional("rest", law.rest);
  if (reader.has("detents")) {
    const FieldReader detents = reader["detents"];
    law.detent_count = detents.size();
    if (law.detent_count > kMaxDetents) detents.fail("at most " + std::to_string(kMaxDetents));
    for (std::size_t i = 0; i < law.detent_count; ++i) {
      const FieldReader detent = detents.at(i);
      detent.expect_keys({"at", "depth", "width", "period"});
      law.detents[i] = {detent["at"].number(), detent["depth"].number(), detent["width"].number(),
                        detent["period"].number()};
    }
  }
  return law;
}

Vector3 rounded_position(const Vector3& position) {
  return {micrometres(position.x()), micrometres(position.y()), micrometres(position.z())};
}

void validate(const ObjectModel& object, const std::string& file) {
  const ObjectChecker check{file};
  check(is_name(object.name), "name", "1 to 63 letters, digits, _ or -");
  if (object.soft) {
    check(object.links.empty() && object.joints.empty(), "soft", "no links and no joints beside it");
    check_soft(check, *object.soft, file);
    return;
  }
  check(!object.links.empty() && object.links.size() <= kMaxObjectLinks, "links",
        "1 to " + std::to_string(kMaxObjectLinks));
  std::set<std::string> names;
  for (std::size_t i = 0; i < object.links.size(); ++i) {
    const std::string where = "links[" + std::to_string(i) + "]";
    check_link(check, object.links[i], where);
    check(names.insert(object.links[i].name).second, where + ".name", "a name that no other link has");
  }
  check(object.joints.size() + 1 == object.links.size(), "joints",
        "one joint for each link but the first: " + std::to_string(object.links.size() - 1));
  std::vector<bool> placed(object.links.size(), false);
  placed[0] = true;
  for (std::size_t j = 0; j < object.joints.size(); ++j) {
    const LinkJoint& joint = object.joints[j];
    const std::string where = "joints[" + std::to_string(j) + "]";
    check(joint.parent < placed.size() && placed[joint.parent], where + ".parent",
          "the first link, or a link that is the child of an earlier joint");
    check(joint.child < placed.size() && !placed[joint.child], where + ".child",
          "a link that is not the first link and not the child of another joint");
    placed[joint.child] = true;
    for (const Pose* pose : {&joint.parent_from_joint, &joint.child_from_joint})
      check(pose->position.allFinite() && pose->position.cwiseAbs().maxCoeff() <= kLargest,
            where + (pose == &joint.parent_from_joint ? ".parent_from_joint" : ".child_from_joint") + ".position",
            "coordinates from -10 to 10 m");
    try {
      check_joint_law(joint.law);
    } catch (const std::invalid_argument& error) {
      throw std::runtime_error(file + ": " + where + ": " + error.what());
    }
  }
}

ObjectModel parse_object(std::string_view text, const std::string& file) {
  Json json;
  try {
    json = Json::parse(text);
  } catch (const Json::exception& error) {  // a number too large for a double is not a parse_error
    throw std::runtime_error(file + ": not an object file: " + error.what());
  }
  const FieldReader root(json, file, "");
  if (root["format"].string() != kObjectFormat) root["format"].fail(std::string("'") + kObjectFormat + "'");
  if (root["version"].index() != kObjectVersion) root["version"].fail(std::to_string(kObjectVersion));
  if (root["units"].string() != kUnits) root["units"].fail(std::string("'") + kUnits + "'");
  ObjectModel object;
  object.name = root["name"].string();
  object.notice = root["notice"].string();
  if (root.has("soft")) {
    root.expect_keys({"format", "version", "units", "name", "notice", "soft"});
    object.soft = read_soft(root["soft"]);
    validate(object, file);
    return object;
  }
  root.expect_keys({"format", "version", "units", "name", "notice", "links", "joints"});
  const FieldReader links = root["links"], joints = root["joints"];
  if (links.size() > kMaxObjectLinks) links.fail("1 to " + std::to_string(kMaxObjectLinks));
  for (std::size_t i = 0; i < links.size(); ++i) object.links.push_back(read_link(links.at(i)));
  for (std::size_t i = 0; i < joints.size(); ++i) object.joints.push_back(read_joint(joints.at(i), object));
  validate(object, file);
  return object;
}

void save_object(const ObjectModel& object, const std::string& path) {
  std::ofstream out(path);
  // One field per line.
  const auto write_fields = [&out](const Json& fields) {
    out << "{";
    const char* separator = "";
    for (const auto& [key, value] : fields.items()) {
      out << separator << '"' << key << "\": " << value.dump();
      separator = ",\n ";
    }
  };
  out << "{\n\"format\": \"" << kObjectFormat << "\",\n\"version\": " << kObjectVersion << ",\n\"units\": \"" << kUnits
      << "\",\n\"name\": " << Json(object.name).dump() << ",\n\"notice\": " << Json(object.notice).dump() << ",\n";
  if (object.soft) {
    out << "\"soft\": ";
    write_fields(soft_json(*object.soft));
    out << "}\n}\n";
  } else {
    out << "\"links\": [\n";
    for (std::size_t i = 0; i < object.links.size(); ++i) {
      write_fields(link_json(object.links[i]));
      out << (i + 1 < object.links.size() ? "},\n" : "}\n");
    }
    out << "],\n\"joints\": [\n";
    for (std::size_t i = 0; i < object.joints.size(); ++i)
      out << joint_json(object, object.joints[i]).dump() << (i + 1 < object.joints.size() ? ",\n" : "\n");
    out << "]\n}\n";
  }
  out.flush();
  if (!out) throw std::runtime_error(path + ": cannot be written");
}

std::vector<Pose> link_poses(const ObjectModel& object, const std::vector<double>& coordinates) {
  std::vector<Pose> poses(object.links.size());
  for (std::size_t j = 0; j < object.joints.size(); ++j) {
    const LinkJoint& joint = object.joints[j];
    Pose moved;
    const double q = coordinates.at(j);
    if (joint.law.turns()) moved.orientation = Eigen::AngleAxisd(q, Vector3::UnitY());
    if (joint.law.kind == ObjectJointKind::slider) moved.position.y() = q;
    if (joint.law.kind == ObjectJointKind::screw) moved.position.y() = joint.law.pitch * q / (2 * std::numbers::pi);
    poses[joint.child] = poses[joint.parent] * joint.parent_from_joint * moved * joint.child_from_joint.inverse();
  }
  return poses;
}

}  // namespace softhand
