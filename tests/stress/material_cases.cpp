// Tissue cases: nearly incompressible, stiff and strain-limited materials. Meshes are also released from states that a
// real hand never reaches.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "math/tetrahedron.hpp"
#include "stress/cases.hpp"
#include "stress/grasp.hpp"
#include "stress/hand_events.hpp"
#include "support/box_mesh.hpp"

namespace softhand::stress {
namespace {

Findings with_material(const std::function<void(Material&)>& change, bool held = true) {
  Grasp setting;
  setting.held = held;
  setting.hand = [&change](HandModel& hand) {
    for (Material& material : hand.materials) change(material);
  };
  return grasp_findings(setting);
}

// Pads and knuckles keep their material. Palm and back become `ratio` times stiffer than the softest material.
Findings stiffness_ratio(double ratio) {
  Grasp setting;
  setting.held = false;
  setting.hand = [ratio](HandModel& hand) {
    const auto softer = [](const Material& a, const Material& b) { return a.youngs_modulus < b.youngs_modulus; };
    const double softest = std::min_element(hand.materials.begin(), hand.materials.end(), softer)->youngs_modulus;
    for (Material& material : hand.materials) {
      if (material.name == "palm" || material.name == "back") material.youngs_modulus = ratio * softest;
    }
  };
  return grasp_findings(setting);
}

// Holds a grip beyond the strain limit. The stiffness jumps at this limit, and the tissue must not chatter there.
Findings strain_limit(double c) {
  constexpr double kChatter = 0.01;  // mm RMS
  Grasp setting;
  setting.hand = [c](HandModel& hand) {
    for (Material& material : hand.materials) material.strain_limit_stiffness = c * material.strain_limit_energy;
  };
  Grasped result = grasp(setting);
  result.findings.demand("no chatter", "movement of the held cube about its mean over the last 0.4 s, RMS",
                         result.jitter(1.6, 2) * 1e3, kChatter, "mm");
  return result.findings;
}

Findings refused_strain_limit(double energy) {
  Grasp setting;
  setting.hand = [energy](HandModel& hand) { hand.materials[0].strain_limit_energy = energy; };
  return refused(setting);
}

double inverted_share(const HandModel& hand, const Eigen::Matrix3Xd& x) {
  const auto inverted = std::count_if(hand.tetrahedra.begin(), hand.tetrahedra.end(),
                                      [&x](const auto& t) { return tetrahedron_volume(x, t) < 0; });
  return static_cast<double>(inverted) / static_cast<double>(hand.tetrahedra.size());
}

Vector3 middle_of(const State& state) { return state.node_positions.rowwise().mean(); }

// Moves every node by a linear map about the centre of the tissue.
Findings mapped(const Matrix3& map, double noise = 0, const SimulationOptions& options = {}) {
  Release release;
  release.options = options;
  release.disturb = [&](State& state) {
    const Vector3 middle = middle_of(state);
    testing::Random random(7);
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
      state.node_positions.col(n) =
          middle + map * Vector3(state.node_positions.col(n) - middle) + noise * random.vector();
    }
  };
  return let_go(release);
}

Matrix3 diagonal(double x, double y, double z) { return Vector3(x, y, z).asDiagonal(); }

// All of the tissue keeps a tenth of its stress.
SimulationOptions most_relaxes() {
  SimulationOptions options;
  options.relaxation.active = true;
  options.relaxation.pulp = options.relaxation.palm = options.relaxation.back =
      options.relaxation.knuckle = {0.3, 0.3, 0.3};
  return options;
}

// The hand moves by `depth` into a table within 0.1 s, stays for 0.5 s, and returns as fast.
Findings pressed_and_let_go(double depth) {
  constexpr double kMove = 0.1, kHold = 0.5;
  Event event;
  event.options = most_relaxes();
  event.seconds = 1.5;
  event.object.shape = box_shape({0.3, 0.01, 0.3});
  const double lowest = pad_of(event.hand, Finger::middle).y();
  event.object.pose.position = {0, lowest - 0.012, -0.1};
  event.bones = [depth](double time) {
    const double share = std::clamp(std::min(time, 2 * kMove + kHold - time) / kMove, 0.0, 1.0);
    const double speed = share <= 0 || share >= 1 ? 0 : (time < kMove ? -1 : 1) * depth / kMove;
    return Displacement{{0, -(0.002 + depth) * share, 0}, {0, speed, 0}};
  };
  return run(event);
}

// A pinch, while all of the tissue relaxes by `share` with each time constant.
Findings relaxing_grasp(double share, const std::string& time_constants, bool held) {
  Grasp setting;
  setting.held = held;
  setting.overrides = {"hand.simulation.relaxation.active=true",
                       "hand.simulation.relaxation.time_constants=" + time_constants};
  for (const char* material : {"pulp", "palm", "back", "knuckle"})
    setting.overrides.push_back(
        fmt::format("hand.simulation.relaxation.{}=[{}, {}, {}]", material, share, share, share));
  return share < 1.0 / 3 ? grasp_findings(setting) : refused(setting);
}

// Reflects one node of a tetrahedron through the opposite face.
Findings reflected_node() {
  Release release;
  const auto nodes = release.hand.tetrahedra[release.hand.tetrahedra.size() / 2];
  release.disturb = [&](State& state) {
    const auto at = [&](std::size_t k) { return Vector3(state.node_positions.col(nodes[k])); };
    const Vector3 normal = (at(1) - at(0)).cross(at(2) - at(0)).normalized();
    state.node_positions.col(nodes[3]) -= 2 * normal.dot(at(3) - at(0)) * normal;
  };
  return let_go(release);
}

// Reflects nodes one after the other in a fixed random order, until the share of inverted tetrahedra is reached. A
// share of 1 mirrors the whole hand.
Findings inverted(double share) {
  if (share == 1) return mapped(diagonal(1, 1, -1));
  Release release;
  double reached = 0;
  release.disturb = [&](State& state) {
    testing::Random random(3);
    while (reached < share) {
      const auto& t = release.hand.tetrahedra[static_cast<std::size_t>(
          0.5 * (1 + random()) * static_cast<double>(release.hand.tetrahedra.size()))];
      const auto at = [&](std::size_t k) { return Vector3(state.node_positions.col(t[k])); };
      const Vector3 normal = (at(1) - at(0)).cross(at(2) - at(0)).normalized();
      if (normal.dot(at(3) - at(0)) > 0) state.node_positions.col(t[3]) -= 2 * normal.dot(at(3) - at(0)) * normal;
      reached = inverted_share(release.hand, state.node_positions);
    }
  };
  Findings findings = let_go(release);
  findings.demand_at_least("set up", "share of inverted tetrahedra at the start", reached, share, "1");
  return findings;
}

Findings random_nodes(std::size_t seed) {
  Release release;
  release.disturb = [seed](State& state) {
    const Vector3 low = state.node_positions.rowwise().minCoeff(), high = state.node_positions.rowwise().maxCoeff();
    testing::Random random(seed);
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
      state.node_positions.col(n) = 0.5 * (low + high) + (high - low).cwiseProduct(random.vector());
    }
  };
  return let_go(release);
}

// Twists the tissue about the hand's long axis. The angle grows from the wrist to the fingertips.
Findings twisted(double angle) {
  Release release;
  release.disturb = [angle](State& state) {
    const double near = state.node_positions.row(2).maxCoeff(), far = state.node_positions.row(2).minCoeff();
    const Vector3 middle = middle_of(state);
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
      Vector3 x = state.node_positions.col(n);
      const Vector3 axis(middle.x(), middle.y(), x.z());
      x = axis + Eigen::AngleAxisd(angle * (near - x.z()) / (near - far), Vector3::UnitZ()) * Vector3(x - axis);
      state.node_positions.col(n) = x;
    }
  };
  return let_go(release);
}

// Adds to the hand a tetrahedron that a mesher may produce and that no simulation can use.
Findings bad_element(const std::array<Vector3, 4>& corners) {
  Grasp setting;
  setting.hand = [&corners](HandModel& hand) {
    const auto first = static_cast<std::int32_t>(hand.nodes.size());
    for (const Vector3& corner : corners) {
      hand.nodes.push_back(corner);
      hand.node_body.push_back(0);
    }
    hand.tetrahedra.push_back({first, first + 1, first + 2, first + 3});
    hand.tetrahedron_material.push_back(0);
  };
  return refused(setting);
}

// A node that no tetrahedron uses, in the hand's file, as a mesher may write it.
Findings unreferenced_node() {
  const std::string path =
      (std::filesystem::temp_directory_path() / fmt::format("softhand_stress_{}.hand.json", getpid())).string();
  HandModel loose = shipped_hand();
  loose.nodes.insert(loose.nodes.begin(), loose.nodes[0]);
  loose.node_body.insert(loose.node_body.begin(), std::uint8_t{0});
  const auto shift = [](auto& list) {
    for (auto& nodes : list) {
      for (std::int32_t& node : nodes) ++node;
    }
  };
  shift(loose.tetrahedra);
  shift(loose.surface);
  save_hand(loose, path);
  Grasp setting;
  setting.hand = [&path](HandModel& hand) { hand = load_hand(path); };
  Findings findings = grasp_findings(setting);
  std::filesystem::remove(path);
  return findings;
}

}  // namespace

std::vector<Case> material_cases() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<double> vanishing{0.0, -0.0, 1e-16, 1e-12, 1e-8};
  CaseList cases("Material");

  auto* rows =
      &cases.add("poisson_ratio",
                 "the cube is lifted and held, except at 0.4999: linear tetrahedra lock there, and the fingers are "
                 "too stiff to close");
  for (const double nu : {0.45, 0.49, 0.499, 0.4999}) {
    rows->push_back({named("nu", nu),
                     [nu] { return with_material([nu](Material& m) { m.poisson_ratio = nu; }, nu < 0.4999); },
                     {},
                     nu == 0.499});
  }
  rows = &cases.add("stiffness_ratio", "palm and back are `ratio` times stiffer than the softest tissue");
  for (const double ratio : {1e2, 1e4, 1e8})
    rows->push_back({named("ratio", ratio), [ratio] { return stiffness_ratio(ratio); }, {}, ratio == 1e4});
  rows = &cases.add("strain_limit", "k_s = c W_max; the held cube moves less than 10 um RMS");
  for (const double c : {0.0, 1.0, 10.0, 1e3, 1e6})
    rows->push_back({named("c", c), [c] { return strain_limit(c); }, {}, c == 0 || c == 1e6});
  rows = &cases.add("strain_limit_energy", "0, negative values and NaN are refused");
  for (const double energy : {1.0, 1e12}) {
    rows->push_back({named("W_max", energy, "J/m^3"), [energy] {
                       return with_material([energy](Material& m) { m.strain_limit_energy = energy; }, false);
                     }});
  }
  for (const double energy : {0.0, -1.0, nan})
    rows->push_back({named("W_max", energy, "J/m^3"), [energy] { return refused_strain_limit(energy); }, {}, true});

  const std::string times = "[0.004, 0.07, 1.4]";
  rows = &cases.add("relaxation",
                    "all of the tissue relaxes by a share of the stress with each of three time constants; the cube is "
                    "lifted and held, and disturbed tissue recovers");
  for (const double share : {0.1, 0.25, 0.33})
    rows->push_back({named("share", share), [=] { return relaxing_grasp(share, times, true); }, {}, share == 0.25});
  rows->push_back({"share = 0.34", [=] { return relaxing_grasp(0.34, times, true); }, {}, true});
  rows->push_back({"0.1 ms each", [] { return relaxing_grasp(0.25, "[1e-4, 1e-4, 1e-4]", true); }});
  rows->push_back({"1000 s each", [] { return relaxing_grasp(0.25, "[1000, 1000, 1000]", true); }});
  rows->push_back({"share = 0.3, mirrored", [] { return mapped(diagonal(1, 1, -1), 0, most_relaxes()); }, {}, true});
  rows->push_back({"share = 0.3, to a point", [] { return mapped(Matrix3::Zero(), 0, most_relaxes()); }});
  rows->push_back({"share = 0.3, x 5 along the hand", [] { return mapped(diagonal(1, 1, 5), 0, most_relaxes()); }});
  for (const double depth : {5e-3, 15e-3})
    rows->push_back(
        {fmt::format("share = 0.3, pressed by {:g} mm", 1e3 * depth), [=] { return pressed_and_let_go(depth); }});
  rows->push_back(
      {"share = 0.3, x 0.05 through the hand", [] { return mapped(diagonal(1, 0.05, 1), 0, most_relaxes()); }});

  cases.add("reflected_node", "recovers").push_back({"one node", [] { return reflected_node(); }, {}, true});
  rows = &cases.add("inverted", "recovers");
  for (const double share : {0.25, 1.0}) rows->push_back({named("share", share), [share] { return inverted(share); }});
  rows = &cases.add("collapsed", "the whole tissue; recovers");
  for (const double noise : {0.0, 1e-12}) {
    rows->push_back({fmt::format("to a plane, +{:g} m", noise),
                     [noise] { return mapped(diagonal(1, 0, 1), noise); },
                     {},
                     noise == 0});
    rows->push_back({fmt::format("to a line, +{:g} m", noise), [noise] { return mapped(diagonal(0, 0, 1), noise); }});
    rows->push_back({fmt::format("to a point, +{:g} m", noise), [noise] { return mapped(Matrix3::Zero(), noise); }});
  }
  rows = &cases.add("random_nodes", "random nodes in a box of twice the size: recovers");
  for (std::size_t seed = 1; seed <= 20; ++seed)
    rows->push_back({fmt::format("seed = {}", seed), [seed] { return random_nodes(seed); }});
  rows = &cases.add("singular_values", "singular values of the whole tissue's deformation gradient: recovers");
  rows->push_back({"0.7 three times", [] { return mapped(0.7 * Matrix3::Identity()); }});
  for (const double s : vanishing)
    rows->push_back({fmt::format("1, 1, {:g}", s), [s] { return mapped(diagonal(1, s, 1)); }});
  for (const double s : vanishing)
    rows->push_back({fmt::format("1, 1, -1 + {:g}", s), [s] { return mapped(diagonal(1, -1 + s, 1)); }});
  rows = &cases.add("stretched", "recovers");
  rows->push_back({"x 5 along the hand", [] { return mapped(diagonal(1, 1, 5)); }, {}, true});
  rows->push_back({"x 0.05 through the hand", [] { return mapped(diagonal(1, 0.05, 1)); }});
  rows->push_back({"twisted by 720 degrees", [] { return twisted(720 * kDegree); }});

  rows = &cases.add("elements", "unusable elements are refused, a node that no tetrahedron uses is left out");
  constexpr double a = 5e-3;  // m
  const auto flat = [a](double angle) {
    return std::array<Vector3, 4>{Vector3(0, 0, 0), Vector3(a, 0, 0), Vector3(0, 0, a),
                                  Vector3(a, -a * std::tan(angle), a)};
  };
  rows->push_back({"dihedral 0.1 degrees", [flat] { return bad_element(flat(0.1 * kDegree)); }, {}, true});
  rows->push_back(
      {"edge ratio 1e4",
       [] {
         return bad_element({Vector3(0, 0, 0), Vector3(0, 0, 1e-6), Vector3(1e-2, 0, 0), Vector3(0, 1e-2, 0)});
       },
       {},
       true});
  rows->push_back({"zero volume", [flat] { return bad_element(flat(0)); }, {}, true});
  rows->push_back({"a node that no tetrahedron uses", [] { return unreferenced_node(); }, {}, true});
  return cases.take();
}

}  // namespace softhand::stress
