#include "human/fingertip.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "energies/contact.hpp"
#include "energies/friction.hpp"
#include "energies/inertia.hpp"
#include "energies/skeleton_tissue.hpp"
#include "energies/tissue.hpp"
#include "math/rotation.hpp"
#include "support/box_mesh.hpp"
#include "support/contact_message.hpp"
#include "verification/supports.hpp"

namespace softhand::human {
namespace {

constexpr double kInclination = 30 * M_PI / 180;
constexpr double kPlateStep = 0.125e-3;  // m, largest step between two states of rest
// rounds per plate position, because contacts are found only at the end of a step
constexpr int kContactRounds = 4;

std::size_t pulp_index(const HandModel& hand) {
  for (std::size_t m = 0; m < hand.materials.size(); ++m) {
    if (hand.materials[m].name == "pulp") return m;
  }
  throw std::invalid_argument("hand '" + hand.name + "' has no material named pulp");
}

// The part of the hand whose nodes lie nearest to one of two bones, without display data.
HandModel cut_out(const HandModel& hand, Body one, Body other) {
  HandModel part;
  part.rest_joints = hand.rest_joints;
  part.joint_radii = hand.joint_radii;
  part.bodies = hand.bodies;
  part.materials = hand.materials;
  std::vector<std::int32_t> renamed(hand.nodes.size(), -1);
  const auto chosen = [&](std::int32_t n) {
    const int body = hand.node_body[static_cast<std::size_t>(n)];
    return body == index_of(one) || body == index_of(other);
  };
  const auto rename = [&](auto corners) {
    for (std::int32_t& n : corners) {
      std::int32_t& name = renamed[static_cast<std::size_t>(n)];
      if (name < 0) {
        name = part.node_count();
        part.nodes.push_back(hand.nodes[static_cast<std::size_t>(n)]);
        part.node_body.push_back(hand.node_body[static_cast<std::size_t>(n)]);
      }
      n = name;
    }
    return corners;
  };
  std::vector<std::int32_t> part_tetrahedron(hand.tetrahedra.size(), -1);
  for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
    if (!std::all_of(hand.tetrahedra[t].begin(), hand.tetrahedra[t].end(), chosen)) continue;
    part_tetrahedron[t] = static_cast<std::int32_t>(part.tetrahedra.size());
    part.tetrahedra.push_back(rename(hand.tetrahedra[t]));
    part.tetrahedron_material.push_back(hand.tetrahedron_material[t]);
  }
  for (const auto& triangle : hand.surface) {
    const auto known = [&](std::int32_t n) { return renamed[static_cast<std::size_t>(n)] >= 0; };
    if (std::all_of(triangle.begin(), triangle.end(), known)) part.surface.push_back(rename(triangle));
  }
  for (SkinPoint point : hand.contact_points) {
    point.tetrahedron = part_tetrahedron[static_cast<std::size_t>(point.tetrahedron)];
    if (point.tetrahedron >= 0) part.contact_points.push_back(point);
  }
  for (Attachment attachment : hand.attachments) {
    attachment.tetrahedron = part_tetrahedron[static_cast<std::size_t>(attachment.tetrahedron)];
    if (attachment.tetrahedron >= 0) part.attachments.push_back(attachment);
  }
  return part;
}

}  // namespace

PulpMaterial pulp_of(const HandModel& hand) {
  const Material& pulp = hand.materials[pulp_index(hand)];
  return {pulp.youngs_modulus, pulp.strain_limit_energy, pulp.strain_limit_stiffness / pulp.strain_limit_energy};
}

Fingertip::Fingertip(const HandModel& hand, double contact_stiffness)
    : tip_(cut_out(hand, Body::index_distal, Body::index_intermediate)),
      pulp_(pulp_index(hand)),
      contact_stiffness_(contact_stiffness) {}

// The tip, the plate and the terms between them.
struct Fingertip::Rig {
  Rig(HandModel model, double contact_stiffness, const PronySeries& relaxation)
      : tip(std::move(model)),
        masses(lumped_masses(tip)),
        state(testing::rest_state(tip)),
        inertia(masses, kBodyCount + 1),
        tissue(tip, widest_instruction_set(), "tissue", relaxation),
        relaxing(tip, relaxation),
        contacts(tip, masses, contact_stiffness, kBodyCount, 0, 1),
        contact(contacts),
        friction(contacts) {
    for (int b = 0; b < kBodyCount; ++b) state.body_poses.push_back(tip.body_rest_pose(static_cast<Body>(b)));
    // In the distal joint's frame, the pad is at -Y and the tip at -Z.
    const Quaternion finger = tip.rest_joints[static_cast<std::size_t>(index_of(Joint::index_distal))].orientation;
    normal = finger * Vector3(0, std::cos(kInclination), std::sin(kInclination));
    const ContactPoints skin(tip, masses);
    for (int i = 0; i < skin.count(); ++i) lowest = std::min(lowest, normal.dot(skin.at(i, state.node_positions)));
    state.body_poses.emplace_back();
    state.body_velocities.resize(state.body_poses.size());
    place_plate(-1e-6);
    Shape shape;
    shape.kind = static_cast<std::uint32_t>(ShapeKind::plane);
    plate = std::make_unique<ShapeGeometry>(shape);
    contacts.set_object(0, plate.get(), 0, 1, ContactObject::fixed);
    attachments = std::make_unique<SkeletonTissue>(tip, state.layout());
    std::vector<Energy*> terms{&inertia, &tissue, &relaxing, attachments.get(), &contact, &friction};
    SolverOptions options;
    options.max_iterations = 200;
    options.residual_tolerance = 1e-7;
    options.increment_tolerance = 1e-14;
    options.factor = "double";
    solver = std::make_unique<NewtonSolver>(std::move(terms), state.layout(), options);
  }
  void place_plate(double indentation) {
    state.body_poses.back() = {(lowest + indentation) * normal, Quaternion::FromTwoVectors(Vector3::UnitY(), normal)};
  }
  double force() const { return -normal.dot(contacts.wrench(0).force); }

  HandModel tip;
  std::vector<double> masses;
  State state;
  Vector3 normal = Vector3::Zero();
  double lowest = std::numeric_limits<double>::infinity();  // m, of the skin along the normal
  Inertia inertia;
  Tissue tissue;
  RelaxingTissue relaxing;
  std::unique_ptr<ShapeGeometry> plate;
  std::unique_ptr<SkeletonTissue> attachments;
  ContactSet contacts;
  ContactEnergy contact;
  FrictionEnergy friction;
  std::unique_ptr<NewtonSolver> solver;
};

HandModel Fingertip::with(const PulpMaterial& pulp) const {
  HandModel tip = tip_;
  tip.materials[pulp_].youngs_modulus = pulp.youngs_modulus;
  tip.materials[pulp_].strain_limit_energy = pulp.limit_energy;
  tip.materials[pulp_].strain_limit_stiffness = pulp.limit_ratio * pulp.limit_energy;
  return tip;
}

std::vector<Press> Fingertip::press(const PulpMaterial& pulp, std::span<const double> indentations) const {
  Rig rig(with(pulp), contact_stiffness_, {});
  std::vector<Press> presses;
  double at = 0;
  for (const double indentation : indentations) {
    const int steps = std::max(1, static_cast<int>(std::ceil((indentation - at) / kPlateStep - 1e-9)));
    for (int i = 1; i <= steps; ++i) {
      rig.place_plate(at + (indentation - at) * i / steps);
      for (int round = 0; round < kContactRounds; ++round) verification::settle(*rig.solver, rig.state, 1);
    }
    at = indentation;
    const Contacts touched = testing::contact_message(rig.contacts, rig.state, {0});
    Press press;
    press.indentation = indentation;
    press.force = rig.force();
    press.area = touched.fingers[static_cast<std::size_t>(Finger::index)].area;
    presses.push_back(press);
  }
  return presses;
}

std::vector<double> Fingertip::force_in_time(const PulpMaterial& pulp, const RelaxationOptions& relaxation,
                                             std::span<const PlateMove> moves) const {
  const HandModel tip = with(pulp);
  PronySeries series{relaxation.time_constants, {tip.materials.size(), PronySeries::Branches{}}};
  series.weights[pulp_] = relaxation.pulp;
  Rig rig(tip, contact_stiffness_, series);
  std::vector<double> forces;
  double time = 0;
  for (const PlateMove& move : moves) {
    rig.place_plate(move.indentation);
    const StepReport report = rig.solver->step(rig.state, move.time - time);
    if (!report.state_changed) throw std::runtime_error("fingertip: a step failed");
    time = move.time;
    forces.push_back(rig.force());
  }
  return forces;
}

double measured_force(double indentation) {
  constexpr double kSlope = 190, kGrowth = 2100;  // N/m, 1/m
  return kSlope / kGrowth * std::expm1(kGrowth * indentation);
}

double measured_area(double force) { return 100e-6 * std::sqrt(force); }

double residual(std::span<const Fingertip> tips, const PulpMaterial& pulp) {
  double sum = 0;
  for (const Fingertip& tip : tips) {
    for (const Press& press : tip.press(pulp, kCompared)) {
      const double error = std::log(press.force / measured_force(press.indentation));
      sum += error * error;
    }
  }
  return std::sqrt(sum / static_cast<double>(tips.size() * std::size(kCompared)));
}

PulpFit fit_pulp(std::span<const Fingertip> tips, const PulpMaterial& start) {
  using Point = Vector3;
  struct Corner {
    Point point;
    double value = 0;
  };
  const Point least(std::log(5e3), std::log(1.0), std::log(0.1)), most(std::log(5e5), std::log(1e5), std::log(50.0));
  const auto material = [](const Point& p) { return PulpMaterial{std::exp(p.x()), std::exp(p.y()), std::exp(p.z())}; };
  int evaluations = 0;
  const auto corner = [&](const Point& p) {
    const Point inside = p.cwiseMax(least).cwiseMin(most);
    ++evaluations;
    try {
      return Corner{inside, residual(tips, material(inside))};
    } catch (const std::runtime_error&) {  // the tip does not come to rest with this material
      return Corner{inside, 1e3};
    }
  };
  const Point first(std::log(start.youngs_modulus), std::log(start.limit_energy), std::log(start.limit_ratio));
  std::array<Corner, 4> simplex{corner(first), corner(first + Vector3(-0.5, 0, 0)), corner(first + Vector3(0, -1, 0)),
                                corner(first + Vector3(0, 0, -1))};
  constexpr int kMostEvaluations = 150;
  constexpr double kFlat = 1e-4;
  while (evaluations < kMostEvaluations) {
    std::stable_sort(simplex.begin(), simplex.end(),
                     [](const Corner& a, const Corner& b) { return a.value < b.value; });
    if (simplex[3].value - simplex[0].value < kFlat) break;
    const Point centre = (simplex[0].point + simplex[1].point + simplex[2].point) / 3;
    const Point away = centre - simplex[3].point;
    const Corner reflected = corner(centre + away);
    if (reflected.value < simplex[0].value) {
      const Corner expanded = corner(centre + 2 * away);
      simplex[3] = expanded.value < reflected.value ? expanded : reflected;
    } else if (reflected.value < simplex[2].value) {
      simplex[3] = reflected;
    } else {
      const Corner contracted = corner(centre + (reflected.value < simplex[3].value ? 0.5 : -0.5) * away);
      if (contracted.value < std::min(reflected.value, simplex[3].value)) {
        simplex[3] = contracted;
      } else {
        for (std::size_t i = 1; i < 4; ++i) simplex[i] = corner(0.5 * (simplex[0].point + simplex[i].point));
      }
    }
  }
  const auto best = std::min_element(simplex.begin(), simplex.end(),
                                     [](const Corner& a, const Corner& b) { return a.value < b.value; });
  return {material(best->point), best->value, evaluations};
}

}  // namespace softhand::human
