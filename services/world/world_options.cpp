#include "world/world_options.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include "messages/messages.hpp"
#include "world/solid.hpp"

namespace softhand {
namespace {

// Rows: position and velocity of A are 0 and 1, those of B are 2 and 3. Rows 4..7 are the same four one period ago, and
// rows 8..11 two periods ago.
using Matrix12 = Eigen::Matrix<double, 12, 12>;

/// Moves the body in rows `own`, `own` + 1 by `steps` implicit steps towards the copy in rows `copy`, `copy` + 1. All
/// constants are per unit of mass.
Matrix12 implicit_steps(int own, int copy, int steps, double k, double b, double step) {
  // v' (1 + T b + T^2 k) = v + T k (x_c - x) + T b v_c, x' = x + T v'.
  Matrix12 one = Matrix12::Identity();
  const double share = 1 / (1 + step * b + step * step * k);
  one.row(own + 1).setZero();
  one(own + 1, own + 1) = share;
  one(own + 1, own) = -step * k * share;
  one(own + 1, copy) = step * k * share;
  one(own + 1, copy + 1) = step * b * share;
  one.row(own) += step * one.row(own + 1);
  Matrix12 all = Matrix12::Identity();
  for (int i = 0; i < steps; ++i) all = one * all;
  return all;
}

bool symmetric_is_stable(double stiffness_per_mass, double damping_ratio, double world_step, double hand_step) {
  return symmetric_growth(stiffness_per_mass, damping_ratio, world_step, hand_step) <= 1 + 1e-5;
}

/// Returns the largest stiffness k, up to `stiffness_per_mass`, such that every symmetric spring up to k is stable.
/// Returns 0 if there is none. Much stiffer springs would pass the test too, because their growth approaches one from
/// above. Under contact their objects are thrown about (`softhand report stress`).
double stiffest_stable(double stiffness_per_mass, double damping_ratio, double world_step, double hand_step) {
  const auto is_stable = [&](double candidate) {
    return symmetric_is_stable(candidate, damping_ratio, world_step, hand_step);
  };
  const double period = std::max(world_step, hand_step);
  double stable = 0;
  for (double next = 1e-3 / (period * period); stable < stiffness_per_mass; next *= 1.2) {
    const double candidate = std::min(next, stiffness_per_mass);
    if (is_stable(candidate)) {
      stable = candidate;
      continue;
    }
    double unstable = candidate;
    for (int halving = 0; halving < 8 && stable > 0; ++halving)
      (is_stable(0.5 * (stable + unstable)) ? stable : unstable) = 0.5 * (stable + unstable);
    break;
  }
  return stable;
}

// Why a symmetric spring is refused.
std::string reason(double stiffness_per_mass, double damping_ratio, double world_step, double hand_step) {
  const double growth = symmetric_growth(stiffness_per_mass, damping_ratio, world_step, hand_step);
  if (growth <= 1 + 1e-5) return "above the largest stable stiffness";
  std::ostringstream text;
  text << "small deviations grow by a factor of " << growth << " per period";
  return text.str();
}

void check_joints(const std::vector<JointOptions>& joints, const std::vector<ObjectOptions>& objects,
                  std::vector<std::string>& wrong) {
  if (joints.size() > kMaxObjectJoints)
    wrong.push_back("joints: " + std::to_string(joints.size()) + " joints, expected at most " +
                    std::to_string(kMaxObjectJoints));
  std::set<std::string> names;
  std::set<std::pair<std::string, std::string>> pairs;
  for (const JointOptions& joint : joints) {
    const auto refuse = [&](const std::string& what) { wrong.push_back("joints." + joint.name + what); };
    const auto find = [&objects](const std::string& name) -> const ObjectOptions* {
      for (const ObjectOptions& object : objects)
        if (object.name == name) return &object;
      return nullptr;
    };
    const ObjectOptions* parent = find(joint.parent);
    const ObjectOptions* child = find(joint.child);
    if (joint.name.empty() || joint.name.size() > 63) refuse(".name: expected 1 to 63 characters");
    if (!names.insert(joint.name).second) refuse(": the name is used twice");
    if (parent == nullptr) refuse(".parent = '" + joint.parent + "': expected the name of an object");
    if (child == nullptr) refuse(".child = '" + joint.child + "': expected the name of an object");
    if (child != nullptr && child->mass == 0)
      refuse(".child = '" + joint.child + "': the object is static; expected an object with a mass (swap them)");
    if (parent != nullptr && parent == child) refuse(": parent and child are the same object");
    if (parent != nullptr && parent != child && !pairs.insert(std::minmax(joint.parent, joint.child)).second)
      refuse(": the objects '" + joint.parent + "' and '" + joint.child + "' have another joint already");
    if (parent != nullptr && child != nullptr && parent->mass > 0 && parent->floating != child->floating)
      refuse(": one of its objects floats and the other does not; set `floating` alike");
    const Vector3 axis(joint.axis[0], joint.axis[1], joint.axis[2]);
    if (!(axis.norm() > 1e-6)) refuse(".axis: length 0, expected a direction");
    try {
      const JointLaw law = joint_law(joint);
      check_joint_law(law);
      if (law.has_coordinate() && law.limited() && (law.minimum > 0 || law.maximum < 0))
        refuse(".limits: the scene places the objects at 0, which is outside; expected lower <= 0 <= upper");
    } catch (const std::invalid_argument& problem) {
      refuse(": " + std::string(problem.what()));
    }
  }
}

}  // namespace

void add_file_objects(const ObjectOptions& entry, std::shared_ptr<const ObjectModel> model, const std::string& sha256,
                      std::vector<ObjectOptions>& objects, std::vector<JointOptions>& joints) {
  if (entry.mass != 0)
    throw std::invalid_argument("objects." + entry.name +
                                ".mass: the object file gives the mass; remove it or set fixed");
  const auto name_of = [&](std::size_t link) {
    return model->links.size() == 1 ? entry.name : entry.name + "." + model->links[link].name;
  };
  for (std::size_t i = 0; i < model->links.size(); ++i) {
    ObjectOptions& link = objects.emplace_back(entry);
    link.name = name_of(i);
    link.mass = i == 0 && entry.fixed ? 0 : model->links[i].mass;
    link.friction = model->links[i].friction;
    link.floating = entry.floating && link.mass > 0;
    link.model = model;
    link.sha256 = sha256;
    link.link = i;
  }
  for (std::size_t j = 0; j < model->joints.size(); ++j) {
    JointOptions& joint = joints.emplace_back();
    const LinkJoint& from = model->joints[j];
    joint.name = entry.name + "." + model->links[from.child].name;
    joint.kind = to_string(from.law.kind);
    joint.parent = name_of(from.parent);
    joint.child = name_of(from.child);
    joint.model = model;
    joint.number = j;
  }
}

JointLaw joint_law(const JointOptions& joint) {
  if (joint.model != nullptr) return joint.model->joints[joint.number].law;
  JointLaw law;
  law.kind = object_joint_kind(joint.kind);
  law.pitch = joint.pitch;
  if (joint.limits[0] != 0 || joint.limits[1] != 0) {
    law.minimum = joint.limits[0];
    law.maximum = joint.limits[1];
  }
  law.friction = joint.friction;
  law.load_friction = joint.load_friction;
  law.damping = joint.damping;
  law.stiffness = joint.stiffness;
  law.rest = joint.rest;
  if (joint.detents.size() > kMaxDetents)
    throw std::invalid_argument("detents: " + std::to_string(joint.detents.size()) + ", expected at most " +
                                std::to_string(kMaxDetents));
  for (const DetentOptions& detent : joint.detents)
    law.detents[law.detent_count++] = {detent.at, detent.depth, detent.width, detent.period};
  return law;
}

double symmetric_growth(double stiffness_per_mass, double damping_ratio, double world_step, double hand_step) {
  const double period = std::max(world_step, hand_step);
  const int hand_steps = std::max(1, static_cast<int>(std::lround(period / hand_step)));
  const int world_steps = std::max(1, static_cast<int>(std::lround(period / world_step)));
  const double damping = 2 * damping_ratio * std::sqrt(stiffness_per_mass);
  Matrix12 map = implicit_steps(0, 10, hand_steps, stiffness_per_mass, damping, period / hand_steps) *
                 implicit_steps(2, 8, world_steps, stiffness_per_mass, damping, period / world_steps);
  map.bottomRows<8>().setZero();
  map.block<8, 8>(4, 0).setIdentity();
  return map.eigenvalues().cwiseAbs().maxCoeff();
}

std::vector<std::string> check_assemblies(const std::vector<ObjectOptions>& objects,
                                          const std::vector<JointOptions>& joints, std::int64_t slots,
                                          std::int64_t places) {
  std::map<std::string, std::string> set;  // by movable object: the first name of its set
  for (const ObjectOptions& object : objects)
    if (object.mass > 0) set[object.name] = object.name;
  for (const JointOptions& joint : joints) {
    if (!set.contains(joint.parent) || !set.contains(joint.child)) continue;
    const std::string from = set[joint.parent], to = set[joint.child];
    for (auto& [name, first] : set)
      if (first == from) first = to;
  }
  std::map<std::string, std::int64_t> links, held;
  for (const auto& [name, first] : set) ++links[first];
  for (const JointOptions& joint : joints)
    if (set.contains(joint.child)) ++held[set[joint.child]];
  std::vector<std::string> wrong;
  for (const auto& [first, count] : held) {
    if (links[first] > slots)
      wrong.push_back("hand.mirrored_objects = " + std::to_string(slots) + ": joints connect '" + first + "' to " +
                      std::to_string(links[first] - 1) +
                      " other movable objects, and a hand takes all of them or none. The nearest value that works: " +
                      std::to_string(links[first]));
    if (count > places)
      wrong.push_back(
          "hand.object_joints = " + std::to_string(places) + ": the objects around '" + first + "' have " +
          std::to_string(count) +
          " joints, and a hand takes all of them or none. The nearest value that works: " + std::to_string(count));
  }
  return wrong;
}

std::vector<std::string> check_world(const WorldOptions& world, const std::vector<ObjectOptions>& objects,
                                     double hand_step, const std::vector<JointOptions>& joints) {
  std::vector<std::string> wrong;
  const auto refuse = [&wrong](const auto&... parts) {
    std::ostringstream text;
    (text << ... << parts);
    wrong.push_back(text.str());
  };
  const double step = 1 / world.rate_hz;
  const auto growing = [&](double stiffness_per_mass) {
    return reason(stiffness_per_mass, world.damping_ratio, step, hand_step);
  };
  if (world.mode == "owner" && world.follow_stiffness > 1)
    refuse("world.follow_stiffness = ", world.follow_stiffness,
           ": above 1 (m/T^2) the world's copy overshoots stale twins. The nearest value that works: 1");
  if (objects.size() > kMaxObjects) refuse("objects: ", objects.size(), " objects, expected at most ", kMaxObjects);
  std::set<std::string> names;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const ObjectOptions& object = objects[i];
    const std::string where = "objects." + object.name;
    if (object.name.empty() || object.name.size() > 63) refuse("objects[", i, "].name: expected 1 to 63 characters");
    if (!names.insert(object.name).second) refuse(where, ": the name is used twice");
    if (object.shape == "plane" && object.mass != 0)
      refuse(where, ".mass = ", object.mass, ": a plane is static; expected 0");
    if (object.mass != 0 && !(object.mass >= 1e-4))
      refuse(where, ".mass = ", object.mass,
             ": expected 0 (static) or at least 0.0001 kg, because of single precision");
    if (object.shape == "file" && object.model == nullptr) refuse(where, ".file: the object file is not loaded");
    if (object.shape != "file" && !object.file.empty()) refuse(where, ".file: expected shape = \"file\"");
    if (object.shape != "file" && object.fixed) refuse(where, ".fixed: for object files only; set mass = 0");
    if (object.shape == "file" && object.model != nullptr && object.model->links[object.link].pieces.empty())
      refuse(where, ": the link '", object.model->links[object.link].name,
             "' has no convex pieces for the physics engine; make the object file again with pieces");
    if (object.floating && object.mass == 0) refuse(where, ".floating: a static object cannot float; give it a mass");
    const auto& q = object.orientation;
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(std::abs(norm - 1) < 1e-3)) refuse(where, ".orientation: length ", norm, ", expected a unit quaternion xyzw");
    try {
      const Solid solid = make_solid(object);
      if (world.mode != "symmetric" || object.mass == 0) continue;
      const double offered = stiffest_stable(world.stiffness / object.mass, world.damping_ratio, step, hand_step);
      if (offered < world.stiffness / object.mass)
        refuse("world.stiffness = ", world.stiffness, ": ", growing(world.stiffness / object.mass), " on ", where, " (",
               object.mass, " kg, ", world.rate_hz, " Hz against ", 1 / hand_step, " Hz). ",
               offered > 0 ? "The nearest value that works: " + std::to_string(offered * object.mass)
                           : std::string("No stiffness works: use mode owner"));
      for (int axis = 0; axis < 3; ++axis) {
        const double turning = world.angular_stiffness / solid.inertia[axis];
        const double other = stiffest_stable(turning, world.damping_ratio, step, hand_step);
        if (other == turning) continue;
        refuse("world.angular_stiffness = ", world.angular_stiffness, ": ", growing(turning), " on ", where, ". ",
               other > 0 ? "The nearest value that works: " + std::to_string(other * solid.inertia[axis])
                         : std::string("No stiffness works: use mode owner"));
        break;
      }
    } catch (const std::invalid_argument& problem) {
      refuse(where, ": ", problem.what());
    }
  }
  check_joints(joints, objects, wrong);
  return wrong;
}

std::vector<std::string> check_soft_objects(const WorldOptions& world, const std::vector<SoftObject>& objects,
                                            double hand_step) {
  std::vector<std::string> wrong;
  const double step = 1 / world.rate_hz;
  for (const SoftObject& object : objects) {
    if (world.mode != "symmetric" || !object.is_shared) continue;
    const double mass = mass_of(*object.body), asked = world.stiffness / mass;
    const double offered = stiffest_stable(asked, world.damping_ratio, step, hand_step);
    if (offered == asked) continue;
    std::ostringstream text;
    text << "world.stiffness = " << world.stiffness << ": " << reason(asked, world.damping_ratio, step, hand_step)
         << " on objects." << object.name << " (" << mass << " kg, " << world.rate_hz << " Hz against " << 1 / hand_step
         << " Hz). ";
    if (offered > 0) {
      text << "The nearest value that works: " << offered * mass;
    } else {
      text << "No stiffness works: use mode owner";
    }
    wrong.push_back(text.str());
  }
  return wrong;
}

}  // namespace softhand
