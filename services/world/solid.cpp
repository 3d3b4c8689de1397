#include "world/solid.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "messages/convert.hpp"
#include "world/physics_engine.hpp"

namespace softhand {
namespace {

ShapeKind kind_of(const std::string& name) {
  if (name == "sphere") return ShapeKind::sphere;
  if (name == "box") return ShapeKind::box;
  if (name == "capsule") return ShapeKind::capsule;
  if (name == "cylinder") return ShapeKind::cylinder;
  if (name == "plane") return ShapeKind::plane;
  if (name == "convex_hull") return ShapeKind::convex_hull;
  if (name == "file") return ShapeKind::file;
  throw std::invalid_argument("shape '" + name +
                              "': expected sphere, box, capsule, cylinder, plane, convex_hull or file");
}

/// Principal inertia of a uniform solid of mass 1.
Vector3 unit_inertia(ShapeKind kind, const Vector3& size) {
  const double r = size.x(), h = size.y();
  switch (kind) {
    case ShapeKind::sphere:
      return Vector3::Constant(0.4 * r * r);
    case ShapeKind::box: {
      const Vector3 square = size.cwiseAbs2();
      return Vector3(square.y() + square.z(), square.x() + square.z(), square.x() + square.y()) / 3;
    }
    case ShapeKind::cylinder:
      return {r * r / 4 + h * h / 3, r * r / 2, r * r / 4 + h * h / 3};
    case ShapeKind::capsule: {
      // Cylinder of length 2h and two half balls, whose centres of mass lie 3/8 r beyond its ends.
      const double cylinder = 2 * h, ball = 4.0 / 3 * r;  // volumes over pi r^2
      const double total = cylinder + ball;
      const double along = (cylinder * r * r / 2 + ball * 0.4 * r * r) / total;
      const double across = (cylinder * (r * r / 4 + h * h / 3) + ball * (0.4 * r * r + h * h + 0.75 * h * r)) / total;
      return {across, along, across};
    }
    default:
      return Vector3::Zero();
  }
}

/// Body frame with the principal axes of `inertia`, kg m^2. Writes the principal moments.
Pose principal_frame(const Vector3& centre, const Matrix3& inertia, Vector3& moments) {
  const Eigen::SelfAdjointEigenSolver<Matrix3> principal(inertia);
  Matrix3 axes = principal.eigenvectors();
  if (axes.determinant() < 0) axes.col(2) *= -1;
  moments = principal.eigenvalues();
  return {centre, Quaternion(axes).normalized()};
}

Solid link_solid(const ObjectOptions& object) {
  if (object.model == nullptr) throw std::invalid_argument("the object file is not loaded");
  const ObjectLink& link = object.model->links.at(object.link);
  Solid solid;
  Vector3 moments;
  solid.body_frame = principal_frame(link.centre_of_mass, link.inertia, moments);
  if (object.mass > 0) solid.inertia = moments;
  const Pose to_body = solid.body_frame.inverse();
  for (const Vector3& vertex : link.mesh.vertices) solid.radius = std::max(solid.radius, (to_body * vertex).norm());
  for (const auto& points : link.pieces) {
    Shape& piece = solid.pieces.emplace_back();
    piece.kind = static_cast<std::uint32_t>(ShapeKind::convex_hull);
    for (const Vector3& point : points) piece.vertices.push_back(to_wire(to_body * point));
  }
  solid.shape.kind = static_cast<std::uint32_t>(ShapeKind::file);
  ShapeFile file;
  set_text(file.name, object.model->name);
  set_text(file.sha256, object.sha256);
  file.link = static_cast<std::uint32_t>(object.link);
  file.position = to_wire(to_body.position);
  file.orientation = to_wire(to_body.orientation);
  solid.shape.file.push_back(file);
  return solid;
}

}  // namespace

std::pair<Pose, Pose> joint_frames(const JointOptions& joint, const ObjectOptions& parent, const Solid& parent_solid,
                                   const ObjectOptions& child, const Solid& child_solid) {
  const Pose to_parent = parent_solid.body_frame.inverse(), to_child = child_solid.body_frame.inverse();
  if (joint.model != nullptr) {
    const LinkJoint& link = joint.model->joints[joint.number];
    return {to_parent * link.parent_from_joint, to_child * link.child_from_joint};
  }
  const auto start = [](const ObjectOptions& object) {
    return Pose{to_vector(object.position), to_quaternion(object.orientation).normalized()};
  };
  const Pose frame{to_vector(joint.position),
                   Quaternion::FromTwoVectors(Vector3::UnitY(), to_vector(joint.axis)).normalized()};
  return {to_parent * frame, to_child * (start(child).inverse() * (start(parent) * frame))};
}

Solid make_solid(const ObjectOptions& object) {
  Solid solid;
  const ShapeKind kind = kind_of(object.shape);
  if (kind == ShapeKind::file) return link_solid(object);
  solid.shape.kind = static_cast<std::uint32_t>(kind);
  if (kind == ShapeKind::box) solid.shape.size = object.half_extents;
  if (kind == ShapeKind::sphere) solid.shape.size = {object.radius, 0, 0};
  if (kind == ShapeKind::capsule || kind == ShapeKind::cylinder)
    solid.shape.size = {object.radius, object.half_length, 0};
  const Vector3 size = to_vector(solid.shape.size);
  if (kind != ShapeKind::convex_hull) {
    solid.inertia = object.mass * unit_inertia(kind, size);
    if (kind == ShapeKind::sphere) solid.radius = object.radius;
    if (kind == ShapeKind::box) solid.radius = size.norm();
    if (kind == ShapeKind::capsule) solid.radius = object.radius + object.half_length;
    if (kind == ShapeKind::cylinder) solid.radius = std::hypot(object.radius, object.half_length);
    return solid;
  }
  if (object.vertices.size() < 4 || object.vertices.size() > kMaxHullVertices)
    throw std::invalid_argument("a convex hull needs 4 to 256 vertices, not " + std::to_string(object.vertices.size()));
  std::vector<Vector3> points;
  for (const VertexOptions& vertex : object.vertices) points.push_back(to_vector(vertex.at));
  const HullSolid hull = hull_solid(points);
  if (!(hull.volume > 1e-13)) throw std::invalid_argument("the vertices of the convex hull span no volume");
  Vector3 moments;
  solid.body_frame = principal_frame(hull.centre, hull.inertia / hull.volume, moments);
  solid.inertia = object.mass * moments;
  const Pose to_body = solid.body_frame.inverse();
  Vector3 low = Vector3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const Vector3& point : points) {
    const Vector3 p = to_body * point;
    solid.shape.vertices.push_back(to_wire(p));
    solid.radius = std::max(solid.radius, p.norm());
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  // The hull is computed on a grid of 1/10,000 of its length. Rounding to the grid gives coplanar vertices a small
  // volume if their plane is oblique to the axes.
  if (!((high - low).minCoeff() > 5e-4 * (high - low).maxCoeff()))
    throw std::invalid_argument("the vertices of the convex hull span no volume");
  return solid;
}

Vector3 support(const Shape& shape, const Pose& pose, const Vector3& direction) {
  const Vector3 d = pose.orientation.conjugate() * direction;
  const Vector3 size = to_vector(shape.size);
  Vector3 point = Vector3::Zero();
  switch (static_cast<ShapeKind>(shape.kind)) {
    case ShapeKind::sphere:
      point = size.x() * d;
      break;
    case ShapeKind::box:
      for (int k = 0; k < 3; ++k) point[k] = std::copysign(size[k], d[k]);
      break;
    case ShapeKind::capsule:
      point = size.x() * d + Vector3(0, std::copysign(size.y(), d.y()), 0);
      break;
    case ShapeKind::cylinder: {
      const double across = std::hypot(d.x(), d.z());
      const Vector3 rim = across > 1e-12 ? Vector3(d.x() / across, 0, d.z() / across) : Vector3(Vector3::UnitX());
      point = size.x() * rim + Vector3(0, std::copysign(size.y(), d.y()), 0);
      break;
    }
    case ShapeKind::convex_hull: {
      double best = -std::numeric_limits<double>::infinity();
      for (const Vec3& vertex : shape.vertices) {
        const double along = to_vector(vertex).dot(d);
        if (along > best) best = along, point = to_vector(vertex);
      }
      break;
    }
    case ShapeKind::plane:
    case ShapeKind::file:  // ask for its pieces
      break;
  }
  return pose * point;
}

SeparatingPlane separating_plane(const Shape& object, const Pose& object_pose, const Shape& neighbour,
                                 const Pose& neighbour_pose, const Vector3& direction) {
  const auto along = [&](const Vector3& normal) {
    const Vector3 nearest = support(object, object_pose, -normal);
    const bool plane = neighbour.kind == static_cast<std::uint32_t>(ShapeKind::plane);
    const Vector3 top = plane ? neighbour_pose.position : support(neighbour, neighbour_pose, normal);
    const double gap = normal.dot(nearest - top);
    return SeparatingPlane{nearest - gap * normal, normal, gap};
  };
  if (neighbour.kind == static_cast<std::uint32_t>(ShapeKind::plane))
    return along(neighbour_pose.orientation * Vector3::UnitY());
  SeparatingPlane best = along(direction);
  // Try the flat faces of both shapes. A face near the engine's direction replaces it, because the normal of the face
  // is exact. The neighbour's faces come first, so that a box on a table gets the table's face. A face with a larger
  // gap also replaces the direction, because then the direction is wrong. This happens for one in several thousand
  // directions between cubes or cylinders that tip and their table. With the wrong plane the object would lie
  // centimetres deep in the table and would be thrown away.
  constexpr double kNear = 0.999;  // 2.6 degrees
  constexpr double kNoise = 1e-5;  // m, advantage that a single-precision direction may have by its noise
  // m. Bodies that the engine keeps apart seldom overlap by more. Above it, normals around the best one are tried too.
  constexpr double kOverlap = 1e-4;
  constexpr double kWidestTurn = 0.1, kNarrowestTurn = 1e-3;  // rad
  constexpr int kMostRounds = 40;
  bool has_face = false;
  const auto try_faces = [&](const Shape& shape, const Pose& pose) {
    const bool box = shape.kind == static_cast<std::uint32_t>(ShapeKind::box);
    const bool cylinder = shape.kind == static_cast<std::uint32_t>(ShapeKind::cylinder);
    if (!box && !cylinder) return;
    for (int axis = box ? 0 : 1; axis < (box ? 3 : 2); ++axis) {
      for (const double side : {1.0, -1.0}) {
        const Vector3 normal = side * (pose.orientation * Vector3::Unit(axis));
        const SeparatingPlane face = along(normal);
        const bool near = !has_face && normal.dot(direction) >= kNear;
        if (face.gap < best.gap + (near ? -kNoise : kNoise)) continue;
        best = face;
        has_face = true;
      }
    }
  };
  try_faces(neighbour, neighbour_pose);
  try_faces(object, object_pose);
  double turn = kWidestTurn;
  for (int round = 0; round < kMostRounds && best.gap < -kOverlap && turn > kNarrowestTurn; ++round) {
    const SeparatingPlane from = best;
    const Vector3 one = from.normal.unitOrthogonal(), two = from.normal.cross(one);
    for (int k = 0; k < 8; ++k) {
      const double angle = 0.25 * std::numbers::pi * k;
      const SeparatingPlane turned =
          along((from.normal + turn * (std::cos(angle) * one + std::sin(angle) * two)).normalized());
      if (turned.gap > best.gap) best = turned;
    }
    if (best.gap <= from.gap) turn *= 0.5;
  }
  return best;
}

}  // namespace softhand
