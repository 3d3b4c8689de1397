#include "scene/soft_objects.hpp"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "energies/friction.hpp"
#include "math/tetrahedron.hpp"
#include "messages/convert.hpp"
#include "model/skeleton.hpp"

namespace softhand {
namespace {

// Whether object `i` touches a part of the skin for which `select(part)` is true.
template <typename Select>
bool touches_part(const SkinContact& skin, int i, Select&& select) {
  const int part = kFirstSoftPart + i;
  return std::ranges::any_of(skin.anchors(), [&](const SkinAnchor& anchor) {
    const int of_point = skin_part(skin.points()[anchor.point].body);
    return (of_point == part && select(anchor.slot)) || (anchor.slot == part && select(of_point));
  });
}

}  // namespace

SoftObjects::SoftObjects(const TissueModel& hands, std::vector<SoftObject> objects) : objects_(std::move(objects)) {
  if (objects_.size() > kMaxSoftObjects)
    throw std::invalid_argument(std::to_string(objects_.size()) + " flexible objects, expected at most " +
                                std::to_string(kMaxSoftObjects));
  all_ = hands;
  alone_.materials = hands.materials;
  first_.push_back(hands.node_count());
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    const SoftBody& body = *objects_[i].body;
    const auto node_body = static_cast<std::uint8_t>(static_cast<std::size_t>(kMostHands * kBodyCount) + i);
    all_.nodes.insert(all_.nodes.end(), body.nodes.begin(), body.nodes.end());
    all_.node_body.insert(all_.node_body.end(), body.nodes.size(), node_body);
    first_triangle_.push_back(alone_.surface.size());
    append_body(all_, body, first_.back(), node_body);
    append_body(alone_, body, first_.back(), node_body);
    first_.push_back(all_.node_count());
  }
  first_triangle_.push_back(alone_.surface.size());
  alone_.nodes = all_.nodes;
  alone_.node_body = all_.node_body;
  masses_ = lumped_masses(all_);
  memory_ = {std::vector<double>(objects_.size()), std::vector<double>(objects_.size())};
  for (std::vector<std::uint8_t>* marks : {&moved_, &around_, &tried_}) marks->resize(all_.nodes.size());
  before_.resize(3, all_.node_count());
  start_.setZero(3, first_.back());
  for (int i = 0; i < count(); ++i) {
    for (int n = first_node(i); n < first_node(i + 1); ++n)
      start_.col(n) = object(i).pose * all_.nodes[static_cast<std::size_t>(n)];
  }
}

std::span<const std::array<std::int32_t, 3>> SoftObjects::surface(int i) const {
  const auto k = static_cast<std::size_t>(i);
  return std::span(alone_.surface).subspan(first_triangle_[k], first_triangle_[k + 1] - first_triangle_[k]);
}

double SoftObjects::mass(int i) const {
  double sum = 0;
  for (int n = first_node(i); n < first_node(i + 1); ++n) sum += masses_[static_cast<std::size_t>(n)];
  return sum;
}

SoftObjects::Ball SoftObjects::ball(int i, const State& state) const {
  Eigen::AlignedBox3d box;
  for (int n = first_node(i); n < first_node(i + 1); ++n) box.extend(Vector3(state.node_positions.col(n)));
  Ball ball{box.center(), 0};
  double square = 0;
  for (int n = first_node(i); n < first_node(i + 1); ++n)
    square = std::max(square, (state.node_positions.col(n) - ball.centre).squaredNorm());
  ball.radius = std::sqrt(square);
  return ball;
}

Vector3 SoftObjects::centre_of_mass(int i, const State& state) const {
  Vector3 sum = Vector3::Zero();
  for (int n = first_node(i); n < first_node(i + 1); ++n)
    sum += masses_[static_cast<std::size_t>(n)] * state.node_positions.col(n);
  return sum / mass(i);
}

double SoftObjects::fastest(int i, const State& state) const {
  return std::sqrt(state.node_velocities.middleCols(first_node(i), node_count(i)).colwise().squaredNorm().maxCoeff());
}

void SoftObjects::add_terms(const TermOptions& options, std::vector<std::unique_ptr<Energy>>& terms) {
  auto tissue = std::make_unique<Tissue>(alone_, widest_instruction_set(), "soft_tissue");
  tissue_ = tissue.get();
  if (options.helper != nullptr) tissue->use(*options.helper);
  if (options.single_hessian) tissue->use_single_hessian();
  terms.push_back(std::move(tissue));
  if (options.slots > 0) {
    contacts_ =
        std::make_unique<ContactSet>(ContactPoints(alone_, masses_), all_.node_count(), options.contact_stiffness,
                                     options.first_body, options.mirrored_slots, options.slots);
    terms.push_back(std::make_unique<ContactEnergy>(*contacts_, "soft_contact"));
    terms.push_back(std::make_unique<FrictionEnergy>(*contacts_, "soft_friction"));
  }
}

std::vector<double> SoftObjects::frictions() const {
  std::vector<double> frictions;
  for (const SoftObject& each : objects_) frictions.push_back(each.body->friction);
  return frictions;
}

bool SoftObjects::overlaps_hands(int i, const State& state) const {
  Eigen::AlignedBox3d box;
  for (int n = first_node(i); n < first_node(i + 1); ++n) box.extend(state.node_positions.col(n));
  for (int n = 0; n < first_node(0); ++n) {
    if (box.contains(state.node_positions.col(n))) return true;
  }
  return false;
}

void SoftObjects::update_passing(const State& state, bool all) {
  for (int i = 0; i < count(); ++i) skin_->set_passing(i, all || (skin_->passing(i) && overlaps_hands(i, state)));
}

int SoftObjects::passing() const {
  int sum = 0;
  for (int i = 0; i < count(); ++i) sum += skin_->passing(i) ? 1 : 0;
  return sum;
}

bool SoftObjects::touches_hand(int i) const {
  return touches_part(*skin_, i, [](int part) { return part < kFirstSoftPart; });
}

bool SoftObjects::touches_soft_object(int i) const {
  return touches_part(*skin_, i, [](int part) { return part >= kFirstSoftPart; });
}

bool SoftObjects::is_inverted(int i, const std::array<std::int32_t, 4>& corners, const State& state) const {
  const auto at = [&](std::size_t k) -> Vector3 { return state.node_positions.col(first_node(i) + corners[k]); };
  return (at(1) - at(0)).cross(at(2) - at(0)).dot(at(3) - at(0)) < 0;
}

int SoftObjects::inverted_count(int i, const State& state) const {
  return static_cast<int>(std::ranges::count_if(objects_[static_cast<std::size_t>(i)].body->tetrahedra,
                                                [&](const auto& corners) { return is_inverted(i, corners, state); }));
}

// Moves the nodes in `moved_` to their rest places, mapped by an affine map. It is the least-squares fit of the nodes
// in `around_` (Mueller et al. 2005, Meshless Deformations Based on Shape Matching). Returns false if these nodes
// define no map that keeps the orientation.
bool SoftObjects::place_by_surroundings(int i, State& state) const {
  const std::vector<Vector3>& rest = objects_[static_cast<std::size_t>(i)].body->nodes;
  const auto node = [&](std::size_t k) { return static_cast<std::size_t>(first_node(i)) + k; };
  Vector3 centre = Vector3::Zero(), rest_centre = Vector3::Zero();
  double count = 0;
  for (std::size_t k = 0; k < rest.size(); ++k) {
    if (around_[node(k)] == 0) continue;
    centre += state.node_positions.col(static_cast<Eigen::Index>(node(k)));
    rest_centre += rest[k];
    ++count;
  }
  if (count < 4) return false;
  centre /= count, rest_centre /= count;
  Matrix3 covariance = Matrix3::Zero(), of_rest = Matrix3::Zero();
  for (std::size_t k = 0; k < rest.size(); ++k) {
    if (around_[node(k)] == 0) continue;
    const Vector3 arm = rest[k] - rest_centre;
    covariance += (state.node_positions.col(static_cast<Eigen::Index>(node(k))) - centre) * arm.transpose();
    of_rest += arm * arm.transpose();
  }
  constexpr double kFlat = 1e-6;  // relative; the surroundings lie in a plane
  if (!(of_rest.determinant() > kFlat * std::pow(of_rest.trace() / 3, 3))) return false;
  const Matrix3 map = covariance * of_rest.inverse();
  if (!(map.determinant() > 0)) return false;
  for (std::size_t k = 0; k < rest.size(); ++k) {
    if (moved_[node(k)] != 0)
      state.node_positions.col(static_cast<Eigen::Index>(node(k))) = centre + map * (rest[k] - rest_centre);
  }
  return true;
}

// Places clusters of inverted tetrahedra by the nodes around them, or, if that releases no energy, with one or two
// rings more. Returns the number of nodes that were moved.
int SoftObjects::unfold(int i, State& state) {
  constexpr int kMostRings = 2;
  constexpr int kMostClusters = 4;  // each costs up to four evaluations of the tissue's energy
  const auto& tetrahedra = objects_[static_cast<std::size_t>(i)].body->tetrahedra;
  const auto node = [&](std::int32_t corner) { return static_cast<std::size_t>(first_node(i) + corner); };
  const auto any = [&](const auto& corners, const std::vector<std::uint8_t>& marks) {
    return std::ranges::any_of(corners, [&](std::int32_t corner) { return marks[node(corner)] != 0; });
  };
  const auto mark = [&](const auto& corners, std::vector<std::uint8_t>& marks) {
    for (const std::int32_t corner : corners) marks[node(corner)] = 1;
  };
  std::ranges::fill(tried_, std::uint8_t{0});
  int moved = 0, clusters = 0;
  for (const auto& seed : tetrahedra) {
    if (clusters == kMostClusters) break;
    if (!is_inverted(i, seed, state) || any(seed, tried_)) continue;
    ++clusters;
    std::ranges::fill(moved_, std::uint8_t{0});
    mark(seed, moved_);
    for (bool grows = true; grows;) {
      const auto marked = std::ranges::count(moved_, 1);
      for (const auto& corners : tetrahedra)
        if (any(corners, moved_) && is_inverted(i, corners, state)) mark(corners, moved_);
      grows = std::ranges::count(moved_, 1) > marked;
    }
    for (std::size_t n = 0; n < moved_.size(); ++n) tried_[n] |= moved_[n];
    const double energy = tissue_->value(state);
    before_ = state.node_positions;
    for (int rings = 0; rings <= kMostRings; ++rings) {
      around_ = moved_;
      for (const auto& corners : tetrahedra)
        if (any(corners, moved_)) mark(corners, around_);
      for (std::size_t n = 0; n < moved_.size(); ++n) around_[n] ^= moved_[n];
      if (place_by_surroundings(i, state) && tissue_->value(state) < energy) {
        Vector3 velocity = Vector3::Zero();  // mean of the surroundings
        for (std::size_t n = 0; n < around_.size(); ++n)
          if (around_[n] != 0) velocity += state.node_velocities.col(static_cast<Eigen::Index>(n));
        velocity /= static_cast<double>(std::ranges::count(around_, 1));
        for (std::size_t n = 0; n < moved_.size(); ++n)
          if (moved_[n] != 0) state.node_velocities.col(static_cast<Eigen::Index>(n)) = velocity;
        if (contacts_) contacts_->release(moved_);
        moved += static_cast<int>(std::ranges::count(moved_, 1));
        break;
      }
      state.node_positions = before_;
      for (std::size_t n = 0; n < moved_.size(); ++n) moved_[n] |= around_[n];
    }
  }
  return moved;
}

void SoftObjects::stop_deformation(int i, State& state) const {
  const Vector3 centre = centre_of_mass(i, state);
  Vector3 momentum = Vector3::Zero(), angular_momentum = Vector3::Zero();
  Matrix3 inertia = Matrix3::Zero();
  for (int n = first_node(i); n < first_node(i + 1); ++n) {
    const double m = masses_[static_cast<std::size_t>(n)];
    const Vector3 lever = state.node_positions.col(n) - centre;
    momentum += m * state.node_velocities.col(n);
    angular_momentum += m * lever.cross(Vector3(state.node_velocities.col(n)));
    inertia += m * (lever.squaredNorm() * Matrix3::Identity() - lever * lever.transpose());
  }
  const Vector3 linear = momentum / mass(i), angular = inertia.ldlt().solve(angular_momentum);
  for (int n = first_node(i); n < first_node(i + 1); ++n)
    state.node_velocities.col(n) = linear + angular.cross(Vector3(state.node_positions.col(n) - centre));
}

// The rotation is the best fit of the rest shape (Kabsch 1976).
void SoftObjects::restore_shape(int i, State& state) const {
  const std::vector<Vector3>& rest = objects_[static_cast<std::size_t>(i)].body->nodes;
  const double whole = mass(i);
  Vector3 centre = centre_of_mass(i, state);
  Vector3 rest_centre = Vector3::Zero();
  for (std::size_t k = 0; k < rest.size(); ++k)
    rest_centre += masses_[static_cast<std::size_t>(first_node(i)) + k] / whole * rest[k];
  Matrix3 covariance = Matrix3::Zero();
  for (std::size_t k = 0; k < rest.size(); ++k) {
    const auto n = first_node(i) + static_cast<Eigen::Index>(k);
    covariance += masses_[static_cast<std::size_t>(n)] * (state.node_positions.col(n) - centre) *
                  (rest[k] - rest_centre).transpose();
  }
  const Eigen::JacobiSVD<Matrix3> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vector3 signs = Vector3::Ones();
  signs.z() = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  const Matrix3 rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  for (std::size_t k = 0; k < rest.size(); ++k)
    state.node_positions.col(first_node(i) + static_cast<Eigen::Index>(k)) =
        centre + rotation * (rest[k] - rest_centre);
  // Out of tables and walls, each time by the longest way of a node that is inside one.
  for (int tries = 0; contacts_ && tries < 4; ++tries) {
    Vector3 longest = Vector3::Zero();
    for (int n = first_node(i); n < first_node(i + 1); ++n) {
      const Vector3 place = state.node_positions.col(n), way = contacts_->stopped(state, n, centre, place) - place;
      if (way.squaredNorm() > longest.squaredNorm()) longest = way;
    }
    if (longest.isZero()) break;
    centre += longest;
    state.node_positions.middleCols(first_node(i), node_count(i)).colwise() += longest;
  }
  if (contacts_) contacts_->reset();
  state.node_velocities.middleCols(first_node(i), node_count(i)).setZero();
}

int SoftObjects::untangle(State& state, double time_step, bool converged) {
  constexpr double kLongest = 0.1;  // s
  // Share of inverted tetrahedra beyond which an object is tangled. A few can be inverted in a firm grip, too.
  constexpr double kShare = 0.005;
  int moved = 0;
  for (int i = 0; i < count(); ++i) {
    double& tangled = memory_.tangled[static_cast<std::size_t>(i)];
    double& inverted = memory_.inverted[static_cast<std::size_t>(i)];
    // Tangles begin in steps that do not converge. So a scene whose steps converge does not pay for the count.
    const bool may_be_inverted = !converged || inverted > 0;
    const int inverted_now = may_be_inverted ? inverted_count(i, state) : 0;
    const bool is_folded =
        inverted_now > kShare * static_cast<double>(objects_[static_cast<std::size_t>(i)].body->tetrahedra.size());
    // The repair of the hand's tissue ends contacts, too. So contact counts only at the start.
    const bool is_tangled = !converged && (tangled > 0 || touches_hand(i)) && is_folded;
    // In some steps of a tangle, fewer tetrahedra are inverted. They do not end it.
    if (is_tangled)
      tangled += time_step;
    else if (converged || inverted_now == 0)
      tangled = 0;
    inverted = inverted_now > 0 && !is_tangled ? inverted + time_step : 0;
    if (inverted >= kLongest) {
      inverted = time_step;
      moved += unfold(i, state);
    }
    if (is_tangled) stop_deformation(i, state);
    if (tangled < kLongest) continue;
    tangled = 0;
    restore_shape(i, state);
    skin_->set_passing(i, true);
    moved += node_count(i);
  }
  return moved;
}

void SoftObjects::forget() {
  std::ranges::fill(memory_.tangled, 0.0);
  std::ranges::fill(memory_.inverted, 0.0);
}

void SoftObjects::load(const Memory& memory) {
  if (memory.tangled.size() != objects_.size() || memory.inverted.size() != objects_.size())
    throw std::invalid_argument("flexible objects: " + std::to_string(memory.tangled.size()) + ", expected " +
                                std::to_string(objects_.size()));
  memory_ = memory;
}

Vector3 SoftObjects::skin_force(int i) const {
  const int part = kFirstSoftPart + i;
  Vector3 sum = Vector3::Zero();
  for (const SkinAnchor& anchor : skin_->anchors()) {
    if (skin_part(skin_->points()[anchor.point].body) == part) sum += anchor.force;
    if (anchor.slot == part) sum -= anchor.force;
  }
  return sum;
}

void SoftObjects::write_contacts(const State& state, int hand, int first_place, ContactReport& report,
                                 Contacts& out) const {
  for (const SkinAnchor& anchor : skin_->anchors()) {
    const int part = skin_part(skin_->points()[anchor.point].body);
    const int of_point = part - kFirstSoftPart, of_skin = anchor.slot - kFirstSoftPart;
    if ((of_point < 0) == (of_skin < 0)) continue;  // two objects or two hands
    if (skin_owner(std::min(part, anchor.slot)) != hand) continue;
    const AnchorOffset offset = skin_->offset(anchor, state);
    Vector3 position = skin_->points().at(anchor.point, state.node_positions);
    const int object = std::max(of_point, of_skin);
    const auto& corners = skin_->search().corners(anchor.triangle);
    Vector3 velocity = Vector3::Zero();
    if (of_skin < 0) {
      velocity = skin_->points().at(anchor.point, state.node_velocities);
    } else {
      for (const std::int32_t node : corners) velocity += state.node_velocities.col(node) / 3;
    }
    Contact row = contact_row(skin_->points(), anchor, offset, position, id(object), velocity);
    row.area /= 2;
    if (of_skin < 0) {
      // The point belongs to the object. The hand is touched at the anchor.
      position -= offset.offset;
      const auto distance = [&](std::int32_t node) { return (state.node_positions.col(node) - position).norm(); };
      const std::int32_t node = *std::min_element(
          corners.begin(), corners.end(), [&](std::int32_t a, std::int32_t b) { return distance(a) < distance(b); });
      row.node = static_cast<std::uint32_t>(node);
      row.body = all_.node_body[static_cast<std::size_t>(node)] % kBodyCount;
      row.finger = static_cast<std::uint32_t>(finger_of(static_cast<Body>(row.body)));
      row.normal = to_wire(Vector3(-offset.normal));
      row.force = to_wire(Vector3(-anchor.force));
    }
    report.add(row, position, first_place + object, out);
  }
}

void SoftObjects::write_state(int i, const State& state, SoftObjectState& out) const {
  out.object = id(i);
  Vector3 centre = Vector3::Zero(), velocity = Vector3::Zero();
  double mass = 0;
  for (int n = first_node(i); n < first_node(i + 1); ++n) {
    const double m = masses_[static_cast<std::size_t>(n)];
    centre += m * state.node_positions.col(n);
    velocity += m * state.node_velocities.col(n);
    mass += m;
  }
  centre /= mass;
  velocity /= mass;
  out.centre = to_wire(centre);
  out.linear_velocity = to_wire(velocity);
  out.nodes.clear();
  out.velocities.clear();
  for (int n = first_node(i); n < first_node(i + 1); ++n) {
    out.nodes.push_back(to_floats(state.node_positions.col(n) - centre));
    out.velocities.push_back(to_floats(state.node_velocities.col(n) - velocity));
  }
  const int part = kFirstSoftPart + i;
  Vector3 force = Vector3::Zero();
  out.contact_count = 0;
  for (const SkinAnchor& anchor : skin_->anchors()) {
    const int of_point = skin_part(skin_->points()[anchor.point].body);
    if (std::max(of_point, anchor.slot) != part || std::min(of_point, anchor.slot) >= kFirstSoftPart) continue;
    ++out.contact_count;
    force += of_point == part ? anchor.force : Vector3(-anchor.force);
  }
  out.hand_force = to_wire(force);
  out.inverted_elements = 0;
  for (auto corners : object(i).body->tetrahedra) {
    for (std::int32_t& corner : corners) corner += first_node(i);
    if (tetrahedron_volume(state.node_positions, corners) < 0) ++out.inverted_elements;
  }
}

}  // namespace softhand
