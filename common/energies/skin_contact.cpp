#include "energies/skin_contact.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "math/tetrahedron.hpp"

namespace softhand {
namespace {

constexpr double kReach = 1e-3;  // m; how far inside points are looked for, unless some are known to be farther inside

double checked(double value, bool is_positive, const char* what) {
  if (!std::isfinite(value) || value < 0 || (is_positive && value == 0)) {
    throw std::invalid_argument(std::string("skin contact: ") + what + " is " + std::to_string(value) +
                                ", expected a finite number " + (is_positive ? "> 0" : ">= 0"));
  }
  return value;
}

// M_j: e changes by dx_p + sum_j M_j dx_j, in axes that turn with the frame.
Matrix3 corner_motion(const SkinFrame& frame, const Vector3& lever, std::size_t corner) {
  return skew(lever) * frame.turn(corner) - Matrix3::Identity() / 3;
}

using Complex = std::complex<double>;
using Complex3 = Eigen::Matrix<Complex, 3, 1>;

// Without the conjugates of Eigen's products.
Complex dot(const Complex3& a, const Complex3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Complex3 cross(const Complex3& a, const Complex3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Complex norm(const Complex3& a) { return std::sqrt(dot(a, a)); }

// The gradient of U with respect to the point and the three corners, as an analytic function. The derivative of an
// analytic function is its change along an imaginary step, without a difference of near numbers.
std::array<Complex3, 4> complex_gradient(const ContactAnchor& anchor, const std::array<Complex3, 4>& x) {
  const Complex3 ab = x[2] - x[1], bc = x[3] - x[2], ca = x[1] - x[3];
  const Complex3 across = cross(ab, bc);
  // With the lower bounds of `SkinFrame`, for collapsed triangles.
  const auto at_least = [](double least, const Complex& size) { return size.real() < least ? Complex(least) : size; };
  const Complex twice_area = at_least(SkinFrame::kLeastTwiceArea, norm(across));
  const Complex length = at_least(SkinFrame::kLeastLength, norm(ab));
  const Complex3 n = across / twice_area, t1 = ab / length, t2 = cross(n, t1);
  const Complex3 lever = x[0] - (x[1] + x[2] + x[3]) / 3.0;
  const Complex3 e = Complex3(dot(t1, lever), dot(t2, lever), dot(n, lever)) - anchor.anchor.cast<Complex>();
  const Complex3 normal = anchor.normal.cast<Complex>();
  const Complex depth = dot(normal, e);
  const Complex3 stretch = e - depth * normal - anchor.stretch_origin.cast<Complex>();
  Complex3 y = Complex3::Zero();
  if (anchor_law::pushes(anchor, depth.real())) y += anchor.stiffness * depth * normal;
  if (anchor.friction_bound > 0) {
    const CoulombSpring spring = anchor_law::friction_of(anchor);
    const Complex size = norm(stretch);
    y += (spring.slides(size.real()) ? spring.bound / size : Complex(spring.stiffness)) * stretch;
  }
  const Complex3 force = t1 * y[0] + t2 * y[1] + n * y[2];
  const Complex3 torque = cross(lever, force);
  const std::array<Complex3, 3> opposite{bc, ca, ab};
  std::array<Complex3, 4> result{force, {}, {}, {}};
  for (std::size_t k = 0; k < 3; ++k) {
    result[k + 1] = -force / 3.0 - n * (dot(opposite[k], torque) / twice_area);
    if (k < 2) result[k + 1] -= t2 * ((k == 0 ? -1.0 : 1.0) * dot(n, torque) / length);
  }
  return result;
}

// By triangle of the surface: the corners of its tetrahedron.
std::vector<std::array<std::int32_t, 4>> behind_triangles(const TissueModel& model) {
  const auto sorted = [](std::array<std::int32_t, 3> face) {
    std::ranges::sort(face);
    return face;
  };
  std::map<std::array<std::int32_t, 3>, std::array<std::int32_t, 4>> of_face;
  for (const auto& t : model.tetrahedra) {
    for (const auto& f : kTetrahedronFaces) of_face[sorted({t[f[0]], t[f[1]], t[f[2]]})] = t;
  }
  std::vector<std::array<std::int32_t, 4>> result;
  for (const auto& triangle : model.surface) result.push_back(of_face.at(sorted(triangle)));
  return result;
}

}  // namespace

SkinContact::SkinContact(const TissueModel& model, const std::vector<double>& node_masses, double stiffness,
                         double friction, std::vector<double> object_frictions, std::string_view name)
    : name_(name),
      stiffness_(0.5 * checked(stiffness, true, "k_c")),
      friction_(checked(friction, false, "friction")),
      object_frictions_(std::move(object_frictions)),
      node_masses_(node_masses),
      points_(model, node_masses),
      blocks_(points_),
      search_(model, points_),
      corner_blocks_(model.surface.size()),
      has_anchor_(static_cast<std::size_t>(points_.count()) * static_cast<std::size_t>(search_.patches().part_count()),
                  0),
      behind_triangle_(behind_triangles(model)) {
  for (const SkinPoint& point : model.contact_points)
    behind_point_.push_back(model.tetrahedra[static_cast<std::size_t>(point.tetrahedron)]);
  for (const double each : object_frictions_) checked(each, false, "friction");
  if (std::max(0, search_.patches().part_count() - kFirstSoftPart) != static_cast<int>(object_frictions_.size()))
    throw std::invalid_argument("skin contact: expected one friction coefficient for each flexible object");
  anchors_.reserve(2 * static_cast<std::size_t>(points_.count()));
  anchors_before_.reserve(anchors_.capacity());
  saved_.anchors.reserve(anchors_.capacity());
}

// Between a point and a part of the skin.
double SkinContact::friction_of(int point, int part) const {
  const auto of_part = [this](int p) { return object_frictions_[static_cast<std::size_t>(p - kFirstSoftPart)]; };
  const int own = skin_part(points_[point].body);
  if (own < kFirstSoftPart) return part < kFirstSoftPart ? friction_ : of_part(part);
  return part < kFirstSoftPart ? of_part(own) : std::sqrt(of_part(own) * of_part(part));
}

void SkinContact::set_passing(int object, bool on) {
  const std::uint32_t bit = 1U << object;
  passing_ = on ? passing_ | bit : passing_ & ~bit;
}

void SkinContact::set_hands_passing(bool on) {
  is_deep_ = is_deep_ || (!on && passing(kHands));
  set_passing(kHands, on);
}

// A point has at most one contact with a part. The hands pass through some flexible objects, or through each other.
bool SkinContact::cannot_begin(int point, int part) {
  if (has_anchor(point, part) != 0) return true;
  if (passing_ == 0) return false;
  const int own = skin_part(points_[point].body), object = std::max(own, part) - kFirstSoftPart;
  if (object < 0) return skin_owner(own) != skin_owner(part) && passing(kHands);
  return std::min(own, part) < kFirstSoftPart && passing(object);
}

// Whether the tissue of a hand behind the point or behind the triangle is inverted at the start of the step. Folded
// flexible objects keep their contacts, because they rest on hands until they get their shape back as a whole.
bool SkinContact::is_inverted(int point, int triangle) const {
  if (std::max(skin_part(points_[point].body), search_.part_of_triangle(triangle)) >= kFirstSoftPart) return false;
  return tetrahedron_volume(search_.starts(), behind_point_[static_cast<std::size_t>(point)]) < 0 ||
         tetrahedron_volume(search_.starts(), behind_triangle_[static_cast<std::size_t>(triangle)]) < 0;
}

void SkinContact::add_pattern(BlockPattern& pattern) const {
  constexpr int kLoosePerPoint = 4;  // a fist has contact at about a tenth of its points, with twelve blocks each
  blocks_.add_pattern(pattern);
  for (std::size_t t = 0; t < corner_blocks_.size(); ++t) {
    const auto& corners = search_.corners(static_cast<int>(t));
    for (std::size_t a = 0; a < 3; ++a) {
      for (std::size_t b = 0; b < a; ++b) pattern.add(corners[a], corners[b]);
    }
  }
  pattern.add_loose(kLoosePerPoint * points_.count());
}

void SkinContact::bind(const BlockMatrix& matrix) {
  blocks_.bind(matrix);
  for (std::size_t t = 0; t < corner_blocks_.size(); ++t) {
    const auto& corners = search_.corners(static_cast<int>(t));
    std::size_t k = 0;
    for (std::size_t a = 0; a < 3; ++a) {
      for (std::size_t b = 0; b <= a; ++b) corner_blocks_[t][k++] = matrix.find(corners[a], corners[b]);
    }
  }
}

SkinAnchor* SkinContact::create(const SkinCandidate& candidate) {
  if (anchors_.size() == anchors_.capacity()) {
    ++dropped_;
    return nullptr;
  }
  if (is_inverted(candidate.point, candidate.triangle)) {
    found_deep_ = true;  // it may be far inside when its tissue is no longer inverted
    return nullptr;
  }
  SkinAnchor anchor;
  anchor.point = candidate.point;
  anchor.triangle = candidate.triangle;
  anchor.slot = search_.part_of_triangle(candidate.triangle);
  anchor.anchor = candidate.place;
  anchor.normal = Vector3::UnitZ();
  anchor.recess = candidate.recess;
  anchor.fresh = anchor.two_sided = candidate.predicted;
  anchor.stiffness = stiffness_ * points_[candidate.point].area;
  anchor.set_friction(friction_of(candidate.point, anchor.slot));
  has_anchor(candidate.point, anchor.slot) = 1;
  anchors_.push_back(anchor);
  return &anchors_.back();
}

template <typename Ends>
void SkinContact::remove_if(Ends&& ends) {
  std::size_t retained = 0;
  for (std::size_t i = 0; i < anchors_.size(); ++i) {
    if (ends(anchors_[i])) continue;
    if (retained != i) anchors_[retained] = anchors_[i];
    ++retained;
  }
  anchors_.erase(anchors_.begin() + static_cast<std::ptrdiff_t>(retained), anchors_.end());
  mark_anchors();
}

// Counts the energy of a contact that ends between two steps. Returns true.
bool SkinContact::clear(const SkinAnchor& anchor) {
  cleared_ += anchor.normal_energy + anchor.friction_energy;
  return true;
}

void SkinContact::mark_anchors() {
  std::fill(has_anchor_.begin(), has_anchor_.end(), std::uint8_t{0});
  for (const SkinAnchor& anchor : anchors_) has_anchor(anchor.point, anchor.slot) = 1;
}

void SkinContact::begin_step(const State& state, double time_step) {
  cancel_step();
  in_step_ = true;
  anchors_before_ = anchors_;
  cleared_before_ = cleared_;
  time_step_ = time_step;
  found_deep_ = false;
  search_.begin_step(state, time_step, is_deep_ ? SkinPatches::deepest : kReach);
  const auto inverted = [this](const SkinAnchor& anchor) { return is_inverted(anchor.point, anchor.triangle); };
  if (std::ranges::any_of(anchors_, inverted)) {
    remove_if([&](const SkinAnchor& anchor) { return inverted(anchor) && clear(anchor); });
    found_deep_ = true;
  }
  search_.for_each_predicted([this](int point, int part) { return cannot_begin(point, part); },
                             [this](const SkinCandidate& candidate) {
                               found_deep_ = found_deep_ || candidate.recess > kReach;
                               create(candidate);
                             });
  for (SkinAnchor& anchor : anchors_) begin_anchor(anchor, points_.at(anchor.point, search_.ends()), search_.ends());
}

// `end`: of the point's path in this step, world.
void SkinContact::begin_anchor(SkinAnchor& anchor, const Vector3& end, const Eigen::Matrix3Xd& end_positions) {
  anchor_law::move_out(anchor, time_step_);
  const Vector3 start =
      to_local(search_.frame(anchor.triangle, search_.starts()).pose, points_.at(anchor.point, search_.starts()));
  const AnchorPath path{start, start, start, to_local(search_.frame(anchor.triangle, end_positions).pose, end)};
  double mobility = 1 / points_.mass(anchor.point);
  for (const std::int32_t node : search_.corners(anchor.triangle))
    mobility += 1 / (9 * node_masses_[static_cast<std::size_t>(node)]);
  const anchor_law::Ahead ahead =
      anchor_law::begin(anchor, path, anchor_law::pressure_at(anchor, start), false, 1 / mobility, time_step_);
  anchor_law::finish_begin(anchor, path, ahead, anchor.normal.dot(start - anchor.anchor), false);
}

template <typename Found>
void SkinContact::find_crossed(const State& state, Found&& found) {
  search_.set_ends(state);
  search_.for_each_crossed([this](int point, int part) { return cannot_begin(point, part); },
                           [&](const SkinCandidate& candidate) {
                             if (SkinAnchor* anchor = create(candidate)) found(*anchor);
                           });
}

bool SkinContact::revise(const State& state) {
  bool changed = false;
  for (SkinAnchor& anchor : anchors_) {
    if (!anchor.two_sided) continue;
    anchor.two_sided = false;
    if (!(offset(anchor, state).depth > 0)) continue;
    anchor.friction_bound = 0;
    changed = true;
  }
  find_crossed(state, [&](SkinAnchor& anchor) {
    anchor.fresh = true;
    begin_anchor(anchor, points_.at(anchor.point, state.node_positions), state.node_positions);
    changed = true;
  });
  return changed;
}

void SkinContact::end_step(State& state) {
  in_step_ = false;
  flow_ = {.work = -std::exchange(cleared_, 0.0)};
  remove_if([&](SkinAnchor& anchor) {
    const SkinFrame frame = search_.frame(anchor.triangle, state.node_positions);
    const AnchorOffset o = anchor_law::offset(anchor, frame.pose, points_.at(anchor.point, state.node_positions));
    const Vector3 push = anchor_law::push(anchor, o), drag = anchor_law::drag(anchor, o);
    anchor.force = push + drag;
    account(anchor, frame, o, push, drag, state);
    const bool stays = slide(anchor, drag.norm(), frame, state);
    const AnchorOffset settled = offset(anchor, state);
    settle(anchor, settled);
    found_deep_ = found_deep_ || anchor.recess > 0;
    if (stays && !anchor_law::ends(anchor, settled.depth)) return false;
    flow_.anchoring -= anchor.normal_energy + anchor.friction_energy;
    return true;
  });
  bool passed = false;
  find_crossed(state, [&](SkinAnchor& anchor) {
    anchor.missed = true;
    // A step that did not converge may leave a point far inside. It moves out as one that starts there.
    const AnchorOffset o = offset(anchor, state);
    if (o.depth < -kReach) {
      anchor.recess = -o.depth;
      anchor.anchor += o.depth * anchor.normal;
      found_deep_ = true;
    }
    passed = passed || anchor.recess > SkinPatches::deepest;
    settle(anchor, offset(anchor, state));
  });
  is_deep_ = found_deep_;
  // Part of a finger was thrown through another one. Nothing pulls it back from the far side.
  if (passed) remove_if([](const SkinAnchor& anchor) { return anchor.recess > SkinPatches::deepest; });
  for (SkinAnchor& anchor : anchors_) {
    anchor.known = true;
    flow_.stored += anchor.normal_energy + anchor.friction_energy;
  }
}

// Adds the contact to the energy ledger, without the effect of sliding. `push` and `drag` act on the point at the
// step's end.
void SkinContact::account(SkinAnchor& anchor, const SkinFrame& frame, const AnchorOffset& end, const Vector3& push,
                          const Vector3& drag, const State& state) {
  // To first order, as in the solver's increment.
  Vector3 moved = points_.at(anchor.point, state.node_positions) - points_.at(anchor.point, search_.starts());
  const auto& corners = search_.corners(anchor.triangle);
  for (std::size_t k = 0; k < 3; ++k) {
    moved +=
        corner_motion(frame, end.lever, k) * (state.node_positions.col(corners[k]) - search_.starts().col(corners[k]));
  }
  const double energy = anchor_law::stored_normal_energy(anchor, end.depth);
  flow_.anchoring += anchor.start_energy - anchor.normal_energy;
  flow_.integrator += anchor.start_energy - energy - push.dot(moved);
  flow_.integrator += anchor.friction_energy - drag.dot(moved);
  anchor.normal_energy = energy;
}

void SkinContact::settle(SkinAnchor& anchor, const AnchorOffset& offset) {
  const anchor_law::Stored stored = anchor_law::stored(anchor, offset);
  flow_.anchoring += stored.normal - anchor.normal_energy + stored.friction - anchor.friction_energy;
  anchor.normal_energy = stored.normal;
  anchor.friction_energy = stored.friction;
}

// Returns false if the anchor has left the skin that the point can touch.
bool SkinContact::slide(SkinAnchor& anchor, double drag, const SkinFrame& frame, const State& state) {
  const anchor_law::Slide slide =
      anchor_law::slide(anchor, drag, frame.pose, points_.at(anchor.point, state.node_positions), time_step_);
  flow_.friction += slide.heat;
  flow_.integrator -= anchor.friction_energy + slide.heat;
  dissipated_ += slide.heat;
  return !slide.moves || follow(anchor, anchor_law::surface_point(anchor) + slide.movement, state);
}

// Moves the anchor to a place in the plane of its triangle, or on where the skin continues from there.
bool SkinContact::follow(SkinAnchor& anchor, const Vector3& place, const State& state) {
  const SkinSearch::Place there = search_.follow(anchor.triangle, place, state.node_positions);
  const int part = search_.part_of_triangle(there.triangle);
  if (!search_.patches().can_touch(search_.patches().patch_of_point(anchor.point),
                                   search_.patches().patch_of_triangle(there.triangle)))
    return false;
  if (part != anchor.slot) {
    if (has_anchor(anchor.point, part) != 0) return false;
    has_anchor(anchor.point, anchor.slot) = 0;
    has_anchor(anchor.point, part) = 1;
    anchor.slot = part;
  }
  anchor.triangle = there.triangle;
  anchor_law::place(anchor, {0, there.place, Vector3::UnitZ()});
  return true;
}

void SkinContact::cancel_step() {
  if (!std::exchange(in_step_, false)) return;
  anchors_.swap(anchors_before_);
  mark_anchors();
  cleared_ = cleared_before_;
}

const SkinContact::Memory& SkinContact::save() const {
  saved_.anchors.clear();
  for (const SkinAnchor& anchor : in_step_ ? anchors_before_ : anchors_)
    saved_.anchors.push_back({static_cast<const AnchorMemory&>(anchor), anchor.triangle});
  saved_.passing = passing_;
  saved_.is_deep = is_deep_;
  saved_.dissipated = dissipated_;
  saved_.cleared = in_step_ ? cleared_before_ : cleared_;
  return saved_;
}

void SkinContact::load(const Memory& memory) {
  if (memory.anchors.size() > anchors_.capacity()) {
    throw std::invalid_argument("skin contact memory: " + std::to_string(memory.anchors.size()) +
                                " contacts, expected at most " + std::to_string(anchors_.capacity()));
  }
  for (const Memory::Item& from : memory.anchors) {
    if (from.anchor.point < 0 || from.anchor.point >= points_.count())
      throw std::invalid_argument("skin contact memory: no point " + std::to_string(from.anchor.point));
    if (from.triangle < 0 || from.triangle >= static_cast<std::int32_t>(corner_blocks_.size()) ||
        from.anchor.slot != search_.part_of_triangle(from.triangle))
      throw std::invalid_argument("skin contact memory: no triangle " + std::to_string(from.triangle));
  }
  in_step_ = false;
  anchors_.clear();
  for (const Memory::Item& from : memory.anchors) {
    SkinAnchor anchor{ContactAnchor{from.anchor}, from.triangle};
    anchor.known = true;
    anchor.stiffness = stiffness_ * points_[anchor.point].area;
    anchor.set_friction(friction_of(anchor.point, anchor.slot));
    anchors_.push_back(anchor);
  }
  mark_anchors();
  passing_ = memory.passing;
  is_deep_ = memory.is_deep;
  dissipated_ = memory.dissipated;
  cleared_ = memory.cleared;
}

void SkinContact::reset() {
  cancel_step();
  remove_if([this](const SkinAnchor& anchor) { return clear(anchor); });
  is_deep_ = true;
}

void SkinContact::release_moved(const State& state) {
  cancel_step();
  const auto moved = [&](std::int32_t node) { return state.node_positions.col(node) != search_.ends().col(node); };
  remove_if([&](const SkinAnchor& anchor) {
    return (std::ranges::any_of(points_.nodes(anchor.point), moved) ||
            std::ranges::any_of(search_.corners(anchor.triangle), moved)) &&
           clear(anchor);
  });
  is_deep_ = true;
}

double SkinContact::deepest_penetration(const State& state) const {
  double deepest = 0;
  for (const SkinAnchor& anchor : anchors_) deepest = std::max(deepest, -offset(anchor, state).depth);
  return deepest;
}

double SkinContact::value(const State& state) const {
  double energy = 0;
  for (const SkinAnchor& anchor : anchors_) {
    const AnchorOffset o = offset(anchor, state);
    if (anchor_law::pushes(anchor, o.depth)) energy += anchor_law::energy(anchor, o.depth);
    if (anchor.friction_bound > 0) energy += anchor_law::friction_of(anchor).energy(o.stretch.norm());
  }
  return energy;
}

double SkinContact::add_gradient(const State& state, VectorX& gradient) const {
  double energy = 0;
  for (const SkinAnchor& anchor : anchors_) {
    const SkinFrame frame = search_.frame(anchor.triangle, state.node_positions);
    const AnchorOffset o = anchor_law::offset(anchor, frame.pose, points_.at(anchor.point, state.node_positions));
    Vector3 y = Vector3::Zero();
    if (anchor_law::pushes(anchor, o.depth)) {
      energy += anchor_law::energy(anchor, o.depth);
      y += anchor.stiffness * o.depth * o.normal;
    }
    if (anchor.friction_bound > 0) {
      const double length = o.stretch.norm();
      energy += anchor_law::friction_of(anchor).energy(length);
      y += anchor_law::friction_of(anchor).secant(length) * o.stretch;
    }
    blocks_.add_gradient(anchor.point, y, gradient);
    const Vector3 torque = o.lever.cross(y);
    const auto& corners = search_.corners(anchor.triangle);
    for (std::size_t k = 0; k < 3; ++k) gradient.segment<3>(3 * corners[k]) -= y / 3 + frame.corner_force(k, torque);
  }
  return energy;
}

void SkinContact::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  for (const SkinAnchor& anchor : anchors_) {
    if (curvature == Curvature::exact) {
      scatter_exact(anchor, state, hessian);
      continue;
    }
    const SkinFrame frame = search_.frame(anchor.triangle, state.node_positions);
    const AnchorOffset o = anchor_law::offset(anchor, frame.pose, points_.at(anchor.point, state.node_positions));
    Matrix3 stiffness = Matrix3::Zero();
    if (anchor_law::pushes(anchor, o.depth)) stiffness += anchor.stiffness * o.normal * o.normal.transpose();
    if (anchor.friction_bound > 0) stiffness += anchor_law::tangential_stiffness(anchor, o, false);
    if (stiffness.isZero(0)) continue;
    std::array<Matrix3, 3> motions, of_corners;
    std::array<Matrix3, 6> between;
    for (std::size_t a = 0; a < 3; ++a) {
      motions[a] = corner_motion(frame, o.lever, a);
      of_corners[a] = stiffness * motions[a];
      for (std::size_t b = 0; b <= a; ++b) between[a * (a + 1) / 2 + b] = motions[a].transpose() * of_corners[b];
    }
    scatter(anchor, stiffness, of_corners, between, hessian);
  }
}

void SkinContact::scatter_exact(const SkinAnchor& anchor, const State& state, BlockMatrix& hessian) const {
  constexpr double kStep = 1e-30;
  const auto& corners = search_.corners(anchor.triangle);
  std::array<Complex3, 4> x;
  x[0] = points_.at(anchor.point, state.node_positions).cast<Complex>();
  for (std::size_t k = 0; k < 3; ++k) x[k + 1] = Vector3(state.node_positions.col(corners[k])).cast<Complex>();
  std::array<std::array<Matrix3, 4>, 4> blocks;
  for (std::size_t column = 0; column < 4; ++column) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      std::array<Complex3, 4> moved = x;
      moved[column][axis] += Complex(0, kStep);
      const std::array<Complex3, 4> gradient = complex_gradient(anchor, moved);
      for (std::size_t row = 0; row < 4; ++row) blocks[row][column].col(axis) = gradient[row].imag() / kStep;
    }
  }
  std::array<Matrix3, 6> between;
  for (std::size_t a = 0; a < 3; ++a) {
    for (std::size_t b = 0; b <= a; ++b) between[a * (a + 1) / 2 + b] = blocks[a + 1][b + 1];
  }
  scatter(anchor, blocks[0][0], {blocks[0][1], blocks[0][2], blocks[0][3]}, between, hessian);
}

// `of_corners`: second derivative with respect to the point (rows) and a corner (columns).
void SkinContact::scatter(const SkinAnchor& anchor, const Matrix3& of_point, const std::array<Matrix3, 3>& of_corners,
                          const std::array<Matrix3, 6>& between_corners, BlockMatrix& hessian) const {
  blocks_.add_hessian(anchor.point, of_point, hessian);
  const auto& corners = search_.corners(anchor.triangle);
  const auto& slots = corner_blocks_[static_cast<std::size_t>(anchor.triangle)];
  for (std::size_t k = 0; k < slots.size(); ++k) hessian.add(slots[k], between_corners[k]);
  const ContactPoint& point = points_[anchor.point];
  for (std::size_t k = 0; k < static_cast<std::size_t>(point.node_count); ++k) {
    for (std::size_t c = 0; c < 3; ++c) {
      const BlockSlot slot = hessian.pair(point.nodes[k], corners[c]);
      if (slot.index >= 0) hessian.add(slot, point.weights[k] * of_corners[c]);
    }
  }
}

}  // namespace softhand
