#include "geometry/shape.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "geometry/convex_hull.hpp"
#include "messages/convert.hpp"

namespace softhand {

/// Common interface of all kinds of shape.
class Solid {
 public:
  virtual ~Solid() = default;
  virtual SurfacePoint closest(const Vector3& p) const = 0;
  /// Computes the part of the line from + t direction that is inside: [enter, exit], and the outward normal at the
  /// entry. Returns false if the line misses.
  virtual bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
                    Vector3& normal) const = 0;
  virtual double bounding_radius() const = 0;
  virtual std::size_t resting_points(const Vector3& up, std::span<RestingPoint> out) const = 0;
  virtual SolidProperties properties() const = 0;
};

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPi = std::numbers::pi;
// m. Closer to the surface than this, the direction to the closest point is only rounding error, so the face's normal
// is used.
constexpr double kOnSurface = 1e-12;
// A cylinder lies if the sine of the angle between its axis and the ground is below this (11.5 degrees).
constexpr double kLying = 0.2;
// Factor on a squared distance. Distances whose squares differ by less than this relative amount count as equal,
// because of rounding.
constexpr double kNearer = 1 - 1e-14;

struct Interval {
  double enter = -kInfinity;
  double exit = kInfinity;
  Vector3 normal = Vector3::UnitY();  // at the entry

  bool empty() const { return !(enter <= exit); }
  // Cuts away the part outside the half-space normal . p <= offset.
  void cut(const Vector3& n, double offset, const Vector3& from, const Vector3& direction) {
    const double height = n.dot(from) - offset;
    const double rate = n.dot(direction);
    if (rate < 0) {
      const double t = -height / rate;
      if (t > enter) {
        enter = t;
        normal = n;
      }
    } else if (rate > 0) {
      exit = std::min(exit, -height / rate);
    } else if (height > 0) {
      exit = -kInfinity;
    }
  }
};

// Solves |from + t direction| = radius for vectors of any dimension. If direction is zero, the result is the whole line
// or nothing.
template <typename Vector>
void round_interval(const Vector& from, const Vector& direction, double radius, double& enter, double& exit) {
  const double a = direction.squaredNorm();
  const double c = from.squaredNorm() - radius * radius;
  if (a == 0) {
    enter = c <= 0 ? -kInfinity : kInfinity;
    exit = -enter;
    return;
  }
  const double b = from.dot(direction);
  // b^2 - a c without cancellation: a times (radius^2 - squared distance of the line from the centre).
  const Vector foot = from - b / a * direction;
  const double discriminant = a * (radius * radius - foot.squaredNorm());
  if (discriminant < 0) {
    enter = kInfinity;
    exit = -kInfinity;
    return;
  }
  const double root = std::sqrt(discriminant);
  enter = (-b - root) / a;
  exit = (-b + root) / a;
}

class Sphere final : public Solid {
 public:
  explicit Sphere(double radius) : radius_(radius) {}
  SurfacePoint closest(const Vector3& p) const override {
    const double length = p.norm();
    const Vector3 normal = length > 0 ? Vector3(p / length) : Vector3::UnitY();
    return {length - radius_, radius_ * normal, normal};
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    round_interval(from, direction, radius_, enter, exit);
    if (!(enter <= exit)) return false;
    normal = std::isfinite(enter) ? Vector3((from + enter * direction) / radius_) : Vector3::UnitY();
    return true;
  }
  double bounding_radius() const override { return radius_; }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    out[0] = {Vector3::Zero(), radius_};
    return 1;
  }
  SolidProperties properties() const override {
    const double volume = 4.0 / 3.0 * kPi * radius_ * radius_ * radius_;
    return {volume, Vector3::Zero(), 0.4 * volume * radius_ * radius_ * Matrix3::Identity()};
  }

 private:
  double radius_;
};

class Box final : public Solid {
 public:
  explicit Box(const Vector3& half) : half_(half) {}
  SurfacePoint closest(const Vector3& p) const override {
    const Vector3 clamped = p.cwiseMin(half_).cwiseMax(-half_);
    const Vector3 outside = p - clamped;
    const double distance = outside.norm();
    if (distance > kOnSurface) return {distance, clamped, outside / distance};
    int axis = 0;
    const double depth = (p.cwiseAbs() - half_).maxCoeff(&axis);
    const double side = p[axis] < 0 ? -1.0 : 1.0;
    SurfacePoint result{depth, clamped, side * Vector3::Unit(axis)};
    result.point[axis] = side * half_[axis];
    return result;
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    for (int axis = 0; axis < 3; ++axis) {
      interval.cut(Vector3::Unit(axis), half_[axis], from, direction);
      interval.cut(-Vector3::Unit(axis), half_[axis], from, direction);
    }
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override { return half_.norm(); }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    for (std::size_t i = 0; i < 8; ++i) {
      const Vector3 sign(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1);
      out[i] = {half_.cwiseProduct(sign), 0};
    }
    return 8;
  }
  SolidProperties properties() const override {
    const double volume = 8.0 * half_.prod();
    const Vector3 squares = half_.cwiseProduct(half_);
    const Vector3 inertia = volume / 3.0 * (Vector3::Constant(squares.sum()) - squares);
    return {volume, Vector3::Zero(), inertia.asDiagonal()};
  }

 private:
  Vector3 half_;
};

class Capsule final : public Solid {
 public:
  Capsule(double radius, double half_length) : radius_(radius), half_length_(half_length) {}
  SurfacePoint closest(const Vector3& p) const override {
    const Vector3 centre(0, std::clamp(p.y(), -half_length_, half_length_), 0);
    const double length = (p - centre).norm();
    const Vector3 normal = length > 0 ? Vector3((p - centre) / length) : Vector3::UnitX();
    return {length - radius_, centre + radius_ * normal, normal};
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    // The capsule is the union of a cylinder and two balls. The union is convex, so the three intervals form one
    // interval.
    Interval side;
    round_interval(Eigen::Vector2d(from.x(), from.z()), Eigen::Vector2d(direction.x(), direction.z()), radius_,
                   side.enter, side.exit);
    side.cut(Vector3::UnitY(), half_length_, from, direction);
    side.cut(-Vector3::UnitY(), half_length_, from, direction);
    enter = kInfinity;
    exit = -kInfinity;
    const auto join = [&enter, &exit](double first, double last) {
      if (!(first <= last)) return;
      enter = std::min(enter, first);
      exit = std::max(exit, last);
    };
    join(side.enter, side.exit);
    for (const double end : {-half_length_, half_length_}) {
      double first = 0, last = 0;
      round_interval(Vector3(from - Vector3(0, end, 0)), direction, radius_, first, last);
      join(first, last);
    }
    if (!(enter <= exit)) return false;
    if (std::isfinite(enter)) normal = closest(from + enter * direction).normal;
    return true;
  }
  double bounding_radius() const override { return radius_ + half_length_; }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    out[0] = {Vector3(0, half_length_, 0), radius_};
    out[1] = {Vector3(0, -half_length_, 0), radius_};
    return 2;
  }
  SolidProperties properties() const override {
    const double r2 = radius_ * radius_;
    const double cylinder = 2.0 * kPi * r2 * half_length_;
    const double ball = 4.0 / 3.0 * kPi * r2 * radius_;
    const double along = 0.5 * cylinder * r2 + 0.4 * ball * r2;
    const double across = cylinder * (0.25 * r2 + half_length_ * half_length_ / 3.0) +
                          ball * (0.4 * r2 + half_length_ * half_length_ + 0.75 * half_length_ * radius_);
    return {cylinder + ball, Vector3::Zero(), Vector3(across, along, across).asDiagonal()};
  }

 private:
  double radius_;
  double half_length_;
};

class Cylinder final : public Solid {
 public:
  Cylinder(double radius, double half_length) : radius_(radius), half_length_(half_length) {}
  SurfacePoint closest(const Vector3& p) const override {
    const double radial = std::hypot(p.x(), p.z());
    const Vector3 outward = radial > 0 ? Vector3(p.x() / radial, 0, p.z() / radial) : Vector3::UnitX();
    const double to_side = radial - radius_;
    const double to_cap = std::abs(p.y()) - half_length_;
    const Vector3 axial(0, p.y() < 0 ? -1.0 : 1.0, 0);
    if (to_side > kOnSurface && to_cap > kOnSurface) {
      const double distance = std::hypot(to_side, to_cap);
      return {distance, radius_ * outward + half_length_ * axial, (to_side * outward + to_cap * axial) / distance};
    }
    if (to_side >= to_cap) {
      return {to_side, radius_ * outward + Vector3(0, std::clamp(p.y(), -half_length_, half_length_), 0), outward};
    }
    return {to_cap, std::min(radial, radius_) * outward + half_length_ * axial, axial};
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    round_interval(Eigen::Vector2d(from.x(), from.z()), Eigen::Vector2d(direction.x(), direction.z()), radius_,
                   interval.enter, interval.exit);
    if (interval.empty()) return false;
    if (std::isfinite(interval.enter)) {
      const Vector3 point = from + interval.enter * direction;
      interval.normal = Vector3(point.x(), 0, point.z()) / radius_;
    }
    interval.cut(Vector3::UnitY(), half_length_, from, direction);
    interval.cut(-Vector3::UnitY(), half_length_, from, direction);
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override { return std::hypot(radius_, half_length_); }
  std::size_t resting_points(const Vector3& up, std::span<RestingPoint> out) const override {
    // Rotated so that one point of each rim is the lowest. If the cylinder stands on end, no point is the lowest and
    // the angle does not matter.
    const double across = std::hypot(up.x(), up.z());
    const double phase = across > 1e-6 ? std::atan2(-up.z(), -up.x()) : 0.0;
    for (std::size_t i = 0; i < 16; ++i) {
      const double angle = phase + 0.25 * kPi * static_cast<double>(i % 8);
      out[i] = {Vector3(radius_ * std::cos(angle), i < 8 ? half_length_ : -half_length_, radius_ * std::sin(angle)), 0};
    }
    // A lying cylinder rolls on balls with the rims' radius. With corners, it would have to climb over a corner in
    // every step.
    if (std::abs(up.y()) < kLying) {
      out[0] = {Vector3(0, half_length_, 0), radius_ * across};
      out[8] = {Vector3(0, -half_length_, 0), radius_ * across};
    }
    return 16;
  }
  SolidProperties properties() const override {
    const double r2 = radius_ * radius_;
    const double volume = 2.0 * kPi * r2 * half_length_;
    const double across = volume * (0.25 * r2 + half_length_ * half_length_ / 3.0);
    return {volume, Vector3::Zero(), Vector3(across, 0.5 * volume * r2, across).asDiagonal()};
  }

 private:
  double radius_;
  double half_length_;
};

class Plane final : public Solid {
 public:
  SurfacePoint closest(const Vector3& p) const override { return {p.y(), Vector3(p.x(), 0, p.z()), Vector3::UnitY()}; }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    interval.cut(Vector3::UnitY(), 0, from, direction);
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override { return kInfinity; }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint>) const override { return 0; }
  SolidProperties properties() const override { return {kInfinity, Vector3::Zero(), Matrix3::Zero()}; }
};

// The point of a triangle nearest to p, and its place on the triangle.
struct TrianglePoint {
  Vector3 point = Vector3::Zero();
  int edge = -1;    // edge from corner `edge` to the next corner; -1: inside the triangle
  int corner = -1;  // corner of that edge; -1: inside the edge
};

TrianglePoint closest_on_triangle(const Vector3& p, const std::array<Vector3, 3>& corners, const Vector3& normal) {
  TrianglePoint best;
  double least = kInfinity;
  for (int k = 0; k < 3; ++k) {
    const Vector3& from = corners[static_cast<std::size_t>(k)];
    const Vector3 edge = corners[static_cast<std::size_t>((k + 1) % 3)] - from;
    if (normal.cross(edge).dot(p - from) >= 0) continue;
    const double along = edge.dot(p - from) / edge.squaredNorm();
    const Vector3 point = from + std::clamp(along, 0.0, 1.0) * edge;
    const double distance = (p - point).squaredNorm();
    if (distance < least) {
      least = distance;
      best = {point, k, along <= 0 ? k : along >= 1 ? (k + 1) % 3 : -1};
    }
  }
  if (best.edge < 0) best.point = p - normal.dot(p - corners[0]) * normal;
  return best;
}

class Hull final : public Solid {
 public:
  explicit Hull(std::span<const Vector3> points) : hull_(convex_hull(points)) {
    for (const Vector3& v : hull_.vertices) centre_ += v / static_cast<double>(hull_.vertices.size());
    for (std::size_t cell = 0; cell < faces_towards_.size(); ++cell) {
      // The face where the ray leaves the hull.
      const Vector3 direction = direction_of(cell);
      double least = kInfinity;
      for (std::size_t f = 0; f < hull_.faces.size(); ++f) {
        const double way = (hull_.offsets[f] - hull_.normals[f].dot(centre_)) / hull_.normals[f].dot(direction);
        if (way > 0 && way < least) {
          least = way;
          faces_towards_[cell] = static_cast<std::uint16_t>(f);
        }
      }
    }
  }
  SurfacePoint closest(const Vector3& p) const override {
    std::size_t face = faces_towards_[cell_of(p - centre_)];
    if (!(height(p, face) > kOnSurface)) {
      double highest = -kInfinity;
      for (std::size_t f = 0; f < hull_.faces.size(); ++f) {
        const double h = height(p, f);
        if (h > highest) {
          highest = h;
          face = f;
        }
      }
      // Inside, the foot point on the nearest plane lies in that plane's face.
      if (highest <= kOnSurface) return {highest, p - highest * hull_.normals[face], hull_.normals[face]};
    }
    return walk(p, face);
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    for (std::size_t f = 0; f < hull_.faces.size(); ++f)
      interval.cut(hull_.normals[f], hull_.offsets[f], from, direction);
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override {
    double radius = 0;
    for (const Vector3& v : hull_.vertices) radius = std::max(radius, v.norm());
    return radius;
  }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    for (std::size_t i = 0; i < hull_.vertices.size(); ++i) out[i] = {hull_.vertices[i], 0};
    return hull_.vertices.size();
  }
  SolidProperties properties() const override {
    // Sums over tetrahedra that share the first vertex. The second moments of a tetrahedron with corners o, a, b, c
    // about o are volume/20 ((a+b+c)(a+b+c)^T + a a^T + b b^T + c c^T).
    const Vector3 origin = hull_.vertices[0];
    double volume = 0;
    Vector3 first = Vector3::Zero();
    Matrix3 second = Matrix3::Zero();
    for (const auto& face : hull_.faces) {
      const Vector3 a = vertex(face[0]) - origin, b = vertex(face[1]) - origin, c = vertex(face[2]) - origin;
      const double part = a.dot(b.cross(c)) / 6.0;
      const Vector3 sum = a + b + c;
      volume += part;
      first += part / 4.0 * sum;
      second += part / 20.0 * (sum * sum.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose());
    }
    const Vector3 centre = first / volume;
    second -= volume * centre * centre.transpose();
    return {volume, origin + centre, second.trace() * Matrix3::Identity() - second};
  }

 private:
  static constexpr std::size_t kCells = 8;  // per direction on each side of a cube

  const Vector3& vertex(int i) const { return hull_.vertices[static_cast<std::size_t>(i)]; }
  TrianglePoint on_face(const Vector3& p, std::size_t f) const {
    const auto& face = hull_.faces[f];
    return closest_on_triangle(p, {vertex(face[0]), vertex(face[1]), vertex(face[2])}, hull_.normals[f]);
  }

  double height(const Vector3& p, std::size_t f) const { return hull_.normals[f].dot(p) - hull_.offsets[f]; }

  // Local search over the surface, from a face that p is above. It walks to a neighbouring face that p is above as long
  // as this face is nearer. A local minimum is the global minimum. Proof: assume that the solid has a nearer point.
  // Then the projection of p - point onto the solid's cone at `point` leads to nearer points. This projection lies in a
  // face around `point` that p is above. (After Lin and Canny 1991.)
  SurfacePoint walk(const Vector3& p, std::size_t f) const {
    TrianglePoint here = on_face(p, f);
    double least = (p - here.point).squaredNorm();
    const auto nearer = [&](std::size_t other) {
      if (!(height(p, other) > 0)) return false;
      const TrianglePoint there = on_face(p, other);
      const double distance = (p - there.point).squaredNorm();
      if (!(distance < kNearer * least)) return false;
      f = other;
      here = there;
      least = distance;
      return true;
    };
    const auto step = [&] {
      if (here.edge < 0) return false;
      if (here.corner < 0) return nearer(across(f, here.edge));
      const int corner = hull_.faces[f][static_cast<std::size_t>(here.corner)];
      const std::size_t first = f;
      for (std::size_t other = next_around(first, corner); other != first; other = next_around(other, corner)) {
        if (nearer(other)) return true;
      }
      return false;
    };
    while (step()) {
    }
    const double distance = std::sqrt(least);
    return {distance, here.point, (p - here.point) / distance};
  }
  std::size_t across(std::size_t face, int edge) const {
    return static_cast<std::size_t>(hull_.neighbours[face][static_cast<std::size_t>(edge)]);
  }
  std::size_t next_around(std::size_t face, int corner) const {
    const auto& corners = hull_.faces[face];
    return across(face, corners[0] == corner ? 0 : corners[1] == corner ? 1 : 2);
  }

  // Cells of directions on a cube: first the side (axis and sign), then two coordinates on it.
  static std::size_t cell_of(const Vector3& v) {
    Eigen::Index axis = 0;
    const double longest = v.cwiseAbs().maxCoeff(&axis);
    if (!(longest > 0)) return 0;
    const auto on_side = [&](Eigen::Index other) {
      const double at = 0.5 * (1 + v[other % 3] / longest) * static_cast<double>(kCells);
      return std::min(kCells - 1, static_cast<std::size_t>(at));
    };
    const std::size_t side = 2 * static_cast<std::size_t>(axis) + (v[axis] < 0 ? 1 : 0);
    return (side * kCells + on_side(axis + 1)) * kCells + on_side(axis + 2);
  }
  static Vector3 direction_of(std::size_t cell) {
    const auto at = [](std::size_t i) { return (2.0 * static_cast<double>(i) + 1) / static_cast<double>(kCells) - 1; };
    const std::size_t side = cell / (kCells * kCells);
    const auto axis = static_cast<Eigen::Index>(side / 2);
    Vector3 direction;
    direction[axis] = side % 2 == 0 ? 1 : -1;
    direction[(axis + 1) % 3] = at(cell / kCells % kCells);
    direction[(axis + 2) % 3] = at(cell % kCells);
    return direction;
  }

  ConvexHull hull_;
  Vector3 centre_ = Vector3::Zero();
  /// Start face of a walk, per cell of directions from `centre_`.
  std::array<std::uint16_t, 6 * kCells * kCells> faces_towards_{};
};

void check_size(const char* kind, const char* field, double value, bool zero_allowed = false) {
  if (std::isfinite(value) && (value > 0 || (zero_allowed && value == 0))) return;
  throw std::invalid_argument(std::string("shape: ") + field + " of the " + kind + " is " + std::to_string(value) +
                              " m, expected a finite number " + (zero_allowed ? ">= 0" : "> 0"));
}

std::unique_ptr<const Solid> load(const Shape& shape) {
  const Vec3& size = shape.size;
  switch (static_cast<ShapeKind>(shape.kind)) {
    case ShapeKind::sphere:
      check_size("sphere", "radius", size[0]);
      return std::make_unique<Sphere>(size[0]);
    case ShapeKind::box:
      for (const double half : size) check_size("box", "half extent", half);
      return std::make_unique<Box>(to_vector(size));
    case ShapeKind::capsule:
      check_size("capsule", "radius", size[0]);
      check_size("capsule", "half length", size[1], true);
      return std::make_unique<Capsule>(size[0], size[1]);
    case ShapeKind::cylinder:
      check_size("cylinder", "radius", size[0]);
      check_size("cylinder", "half length", size[1]);
      return std::make_unique<Cylinder>(size[0], size[1]);
    case ShapeKind::plane:
      return std::make_unique<Plane>();
    case ShapeKind::convex_hull: {
      if (shape.vertices.size() > kMaxHullVertices) {
        throw std::invalid_argument("shape: convex hull of " + std::to_string(shape.vertices.size()) +
                                    " vertices, expected at most " + std::to_string(kMaxHullVertices));
      }
      std::vector<Vector3> points;
      for (const Vec3& v : shape.vertices) points.push_back(to_vector(v));
      return std::make_unique<Hull>(points);
    }
  }
  throw std::invalid_argument("shape: kind is " + std::to_string(shape.kind) + ", expected 0 to 5");
}

}  // namespace

ShapeGeometry::ShapeGeometry(const Shape& shape)
    : solid_(load(shape)), bounding_radius_(solid_->bounding_radius()), properties_(solid_->properties()) {}
ShapeGeometry::~ShapeGeometry() = default;
ShapeGeometry::ShapeGeometry(ShapeGeometry&&) noexcept = default;
ShapeGeometry& ShapeGeometry::operator=(ShapeGeometry&&) noexcept = default;

SurfacePoint ShapeGeometry::closest(const Vector3& point) const { return solid_->closest(point); }

std::optional<Crossing> ShapeGeometry::first_crossing(const Vector3& from, const Vector3& to) const {
  const Vector3 direction = to - from;
  double enter = 0, exit = 0;
  Vector3 normal = Vector3::UnitY();
  // A path that only touches the solid (enter = exit) does not enter.
  if (!solid_->clip(from, direction, enter, exit, normal) || !(enter >= 0 && enter <= 1 && enter < exit))
    return std::nullopt;
  return Crossing{from + enter * direction, normal, enter};
}

std::size_t ShapeGeometry::resting_points(const Vector3& up, std::span<RestingPoint> out) const {
  return solid_->resting_points(up, out);
}

}  // namespace softhand
