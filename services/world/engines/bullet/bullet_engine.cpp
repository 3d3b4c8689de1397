#include "world/engines/bullet/bullet_engine.hpp"

#include <BulletCollision/NarrowPhaseCollision/btGjkEpaPenetrationDepthSolver.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkPairDetector.h>
#include <BulletCollision/NarrowPhaseCollision/btPointCollector.h>
#include <LinearMath/btConvexHullComputer.h>
#include <btBulletDynamicsCommon.h>

#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "messages/convert.hpp"
#include "world/engines/bullet/bullet_joint.hpp"
#include "world/engines/bullet/bullet_memory.hpp"

namespace softhand {
namespace {

// Bullet's thresholds (contact breaking 20 mm, penetration slop, margins) suit bodies of about one metre. Hands move
// bodies of 5-100 mm, so the engine computes in units of 50 mm. Lengths, velocities, accelerations and forces are
// multiplied by s. Inertias and torques are multiplied by s^2. Masses and times are unchanged.
constexpr double kScale = 20;
constexpr float kMargin = static_cast<float>(0.0005 * kScale);
constexpr int kSolverIterations = 40;
// An object that is slower than this for two seconds (Bullet's time) sleeps. A creep of 0.1 mm/s must not sleep.
constexpr double kSleepingSpeed = 2e-5;  // m/s
// A step is divided, into so many parts at most, until no joint opens by more than this because its bodies turn.
constexpr double kPartOpening = 5e-5;  // m
constexpr int kMostParts = 16;

const bool kHasMemory = (use_bullet_memory(), true);  // set before main

btVector3 to_bullet(const Vector3& v, double scale) {
  return {static_cast<float>(v.x() * scale), static_cast<float>(v.y() * scale), static_cast<float>(v.z() * scale)};
}
Vector3 from_bullet(const btVector3& v, double scale) { return Vector3(v.x(), v.y(), v.z()) / scale; }
btTransform to_bullet(const Pose& pose) {
  const Quaternion& q = pose.orientation;
  const btQuaternion orientation(static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z()),
                                 static_cast<float>(q.w()));
  return btTransform(orientation.normalized(), to_bullet(pose.position, kScale));
}

/// All shapes have their true outer size. Bullet keeps the margin of boxes and cylinders inside the shape, but adds it
/// around hulls. Therefore hulls are first shrunk by the margin.
std::unique_ptr<btCollisionShape> make_shape(const Shape& shape) {
  const btVector3 size = to_bullet(to_vector(shape.size), kScale);
  const float margin = std::min(kMargin, 0.2f * std::min({size.x(), shape.kind == 1 ? size.y() : size.x(),
                                                          shape.kind == 1 ? size.z() : size.x()}));
  switch (static_cast<ShapeKind>(shape.kind)) {
    case ShapeKind::sphere:
      return std::make_unique<btSphereShape>(size.x());
    case ShapeKind::box: {
      auto box = std::make_unique<btBoxShape>(size);
      box->setMargin(margin);
      return box;
    }
    case ShapeKind::capsule:
      return std::make_unique<btCapsuleShape>(size.x(), 2 * size.y());
    case ShapeKind::cylinder: {
      auto cylinder = std::make_unique<btCylinderShape>(btVector3(size.x(), size.y(), size.x()));
      cylinder->setMargin(std::min(margin, 0.2f * size.y()));
      return cylinder;
    }
    case ShapeKind::plane:
      return std::make_unique<btStaticPlaneShape>(btVector3(0, 1, 0), 0);
    case ShapeKind::convex_hull:
      break;
    case ShapeKind::file:
      throw std::invalid_argument("an object file's link without convex pieces");
  }
  std::array<float, 3 * kMaxHullVertices> points;
  for (std::size_t i = 0; i < shape.vertices.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) points[3 * i + k] = static_cast<float>(shape.vertices[i][k] * kScale);
  btConvexHullComputer shrunk;
  const float moved =
      shrunk.compute(points.data(), 3 * sizeof(float), static_cast<int>(shape.vertices.size()), kMargin, 0.2f);
  auto hull = std::make_unique<btConvexHullShape>();
  for (int i = 0; i < shrunk.vertices.size(); ++i) hull->addPoint(shrunk.vertices[i], false);
  hull->recalcLocalAabb();
  hull->setMargin(moved);
  return hull;
}

// Flags of a body, its user index.
constexpr int kPasses = 1;  // passes through copies of flexible objects
constexpr int kCopy = 2;    // is such a copy
constexpr int kHidden = 4;  // is one that all bodies pass through

/// Lets bodies pass through copies of flexible objects.
class Dispatcher final : public btCollisionDispatcher {
 public:
  using btCollisionDispatcher::btCollisionDispatcher;
  bool needsCollision(const btCollisionObject* one, const btCollisionObject* other) override {
    return !passes(*one, *other) && btCollisionDispatcher::needsCollision(one, other);
  }
  bool needsResponse(const btCollisionObject* one, const btCollisionObject* other) override {
    return !passes(*one, *other) && btCollisionDispatcher::needsResponse(one, other);
  }

 private:
  static bool passes(const btCollisionObject& one, const btCollisionObject& other) {
    const int flags = one.getUserIndex() | other.getUserIndex();
    return (flags & kCopy) != 0 && (flags & (kPasses | kHidden)) != 0;
  }
};

/// The shape of a flexible object's copy, about its centre.
class BulletCopy {
 public:
  btCompoundShape shape;
  float friction;
  btVector3 velocity{0, 0, 0};  // of the centre
  std::unique_ptr<btRigidBody> body;

  explicit BulletCopy(const EngineCopy& from)
      : friction(static_cast<float>(std::sqrt(from.friction))), pieces_(from.pieces.begin(), from.pieces.end()) {
    for (const auto& piece : pieces_) {
      auto hull = std::make_unique<btConvexHullShape>();
      for (std::size_t i = 0; i < piece.size(); ++i) hull->addPoint({0, 0, 0}, false);
      hull->setMargin(kCopyMargin);
      shape.addChildShape(btTransform::getIdentity(), hulls_.emplace_back(std::move(hull)).get());
    }
    place(from.vertices);
    at_contact_.assign(from.vertices.begin(), from.vertices.end());
  }

  void place(std::span<const std::array<float, 3>> vertices) {
    for (std::size_t k = 0; k < pieces_.size(); ++k) {
      btVector3* const points = hulls_[k]->getUnscaledPoints();
      for (std::size_t i = 0; i < pieces_[k].size(); ++i) {
        const auto& from = vertices[static_cast<std::size_t>(pieces_[k][i])];
        points[i] = btVector3(from[0], from[1], from[2]) * static_cast<float>(kScale);
      }
      hulls_[k]->recalcLocalAabb();
      shape.updateChildTransform(static_cast<int>(k), btTransform::getIdentity(), false);
    }
    shape.recalculateLocalAabb();
  }

  /// Whether contact points of earlier steps are off. Bullet moves them with the body, but not with its vertices.
  bool has_deformed(std::span<const std::array<float, 3>> vertices) const {
    for (std::size_t i = 0; i < vertices.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k)
        if (std::abs(vertices[i][k] - at_contact_[i][k]) > kDeformed) return true;
    }
    return false;
  }
  void begin_contacts(std::span<const std::array<float, 3>> vertices) {
    std::copy(vertices.begin(), vertices.end(), at_contact_.begin());
  }

 private:
  static constexpr float kCopyMargin = 0.2f * kMargin;
  static constexpr float kDeformed = 2e-5f;  // m

  std::vector<std::vector<std::int32_t>> pieces_;
  std::vector<std::unique_ptr<btConvexHullShape>> hulls_;
  std::vector<std::array<float, 3>> at_contact_;
};

/// Bullet's world. It carries contacts, impulses, pairs and an order of bodies from step to step.
struct BulletWorld {
  BulletWorld() {
    // The gravity of Bullet's world stays zero, because each body has its own gravity (floating objects).
    world.setGravity(btVector3(0, 0, 0));
    btContactSolverInfo& info = world.getSolverInfo();
    info.m_numIterations = kSolverIterations;
    // Warm start with all impulses of the last step instead of Bullet's 85 %. Without the missing 15 % a resting load
    // would need more than kSolverIterations to build up through a stack. Meanwhile the boxes of the stack would slide,
    // because their contact forces are too small.
    info.m_warmstartingFactor = 1;
    info.m_splitImpulse = 1;
    info.m_splitImpulsePenetrationThreshold = 0;  // correct penetration without adding velocity
    info.m_restitutionVelocityThreshold = 0;
    world.getDispatchInfo().m_deterministicOverlappingPairs = true;
    solver.setRandSeed(1);
  }

  btDefaultCollisionConfiguration configuration;
  Dispatcher dispatcher{&configuration};
  btDbvtBroadphase broadphase;
  BulletJointSolver solver;
  btDiscreteDynamicsWorld world{&dispatcher, &broadphase, &solver, &configuration};
};

class BulletEngine final : public PhysicsEngine {
 public:
  ~BulletEngine() override {
    for (std::size_t number = 0; number < joints_.size(); ++number) remove_joint(number);
    for (std::size_t slot = 0; slot < bodies_.size(); ++slot) remove(slot);
    for (const auto& copy : copies_)
      if (copy) bullet_->world.removeRigidBody(copy->body.get());
  }

  void add(std::size_t slot, const EngineObject& object) override {
    pieces_[slot].clear();
    if (object.pieces.empty()) {
      shapes_[slot] = make_shape(object.shape);
    } else {
      auto compound = std::make_unique<btCompoundShape>(true, static_cast<int>(object.pieces.size()));
      for (const Shape& piece : object.pieces)
        compound->addChildShape(btTransform::getIdentity(), pieces_[slot].emplace_back(make_shape(piece)).get());
      shapes_[slot] = std::move(compound);
    }
    matter_[slot] = {object.mass, object.inertia, object.friction};
    add_body(slot, to_bullet(object.pose));
    wake_all();
  }

  void forget() override {
    for (const auto& joint : joints_)
      if (joint) bullet_->world.removeConstraint(joint.get());
    for (const auto& body : bodies_)
      if (body) bullet_->world.removeRigidBody(body.get());
    for (const auto& copy : copies_)
      if (copy) bullet_->world.removeRigidBody(copy->body.get());
    bullet_.emplace();
    for (std::size_t slot = 0; slot < bodies_.size(); ++slot) {
      if (!bodies_[slot]) continue;
      const btTransform pose = bodies_[slot]->getWorldTransform();
      const btVector3 gravity = bodies_[slot]->getGravity();
      bodies_[slot].reset();
      add_body(slot, pose);
      if (!bodies_[slot]->isStaticObject()) bodies_[slot]->setGravity(gravity);
    }
    for (std::size_t number = 0; number < joints_.size(); ++number) {
      if (!joints_[number]) continue;
      const EngineJoint joint = joints_[number]->joint();
      joints_[number].reset();
      add_joint(number, joint);
    }
    for (const auto& copy : copies_)
      if (copy) add_body(*copy);
    wake_all();
  }

  void remove(std::size_t slot) override {
    if (!bodies_[slot]) return;
    bullet_->world.removeRigidBody(bodies_[slot].get());
    bodies_[slot].reset();
    shapes_[slot].reset();
    pieces_[slot].clear();
    wake_all();
  }

  void place(std::size_t slot, const Pose& pose, const Twist& velocity) override {
    btRigidBody& body = *bodies_[slot];
    body.setWorldTransform(to_bullet(pose));
    body.setInterpolationWorldTransform(body.getWorldTransform());
    body.setLinearVelocity(to_bullet(velocity.linear, kScale));
    body.setAngularVelocity(to_bullet(velocity.angular, 1));
    body.updateInertiaTensor();
    bullet_->world.updateSingleAabb(&body);
    forget_contacts(body);
    wake_all();
  }

  void set_gravity(std::size_t slot, const Vector3& gravity) override {
    bodies_[slot]->setGravity(to_bullet(gravity, kScale));
    bodies_[slot]->activate();
  }

  void apply(std::size_t slot, const Wrench& wrench) override {
    bodies_[slot]->activate();  // this also wakes the bodies in contact (Bullet's islands)
    bodies_[slot]->applyCentralForce(to_bullet(wrench.force, kScale));
    bodies_[slot]->applyTorque(to_bullet(wrench.torque, kScale * kScale));
  }

  void add_joint(std::size_t number, const EngineJoint& joint) override {
    joints_[number] = std::make_unique<BulletJoint>(joint, *bodies_[joint.parent], *bodies_[joint.child], kScale);
    bullet_->world.addConstraint(joints_[number].get(), true);
    forget_contacts(joint.parent);
    forget_contacts(joint.child);
    wake_all();
  }

  void remove_joint(std::size_t number) override {
    if (!joints_[number]) return;
    const EngineJoint joint = joints_[number]->joint();
    bullet_->world.removeConstraint(joints_[number].get());
    joints_[number].reset();
    forget_contacts(joint.parent);
    forget_contacts(joint.child);
    wake_all();
  }

  void set_passive(std::size_t number, bool passive) override { joints_[number]->set_passive(passive); }

  double reaction(std::size_t number) const override { return joints_[number]->joint().reaction; }
  double coordinate(std::size_t number) const override { return joints_[number]->joint().coordinate; }

  void add_copy(std::size_t number, const EngineCopy& copy) override {
    copies_[number] = std::make_unique<BulletCopy>(copy);
    add_body(*copies_[number]);
  }

  void move_copy(std::size_t number, const Vector3& centre, const Vector3& velocity,
                 std::span<const std::array<float, 3>> vertices, bool rests) override {
    BulletCopy& copy = *copies_[number];
    btRigidBody& body = *copy.body;
    const bool was_hidden = (body.getUserIndex() & kHidden) != 0;
    body.setUserIndex(kCopy);
    body.forceActivationState(rests ? ISLAND_SLEEPING : DISABLE_DEACTIVATION);
    copy.velocity = rests ? btVector3(0, 0, 0) : to_bullet(velocity, kScale);
    body.setLinearVelocity(copy.velocity);
    body.setWorldTransform(btTransform(btQuaternion::getIdentity(), to_bullet(centre, kScale)));
    body.setInterpolationWorldTransform(body.getWorldTransform());
    copy.place(vertices);
    bullet_->world.updateSingleAabb(&body);
    if (!was_hidden && !copy.has_deformed(vertices)) return;
    copy.begin_contacts(vertices);
    forget_contacts(body);
  }

  void hide_copy(std::size_t number) override {
    copies_[number]->body->setUserIndex(kCopy | kHidden);
    wake_all();
  }

  void set_passing(std::size_t slot, bool passes) override { bodies_[slot]->setUserIndex(passes ? kPasses : 0); }

  void step(double dt) override {
    // Bullet drops the forces of a body after each of its steps.
    std::array<btVector3, kMaxObjects> forces, torques;
    int parts = 0;
    for (double left = dt; left > 0;) {
      const int more = static_cast<int>(
          std::clamp(std::ceil(parts_per_second() * left), 1.0, static_cast<double>(kMostParts - parts)));
      const double part = left / more;
      for (std::size_t slot = 0; slot < bodies_.size(); ++slot) {
        if (!bodies_[slot]) continue;
        if (parts == 0) {
          forces[slot] = bodies_[slot]->getTotalForce();
          torques[slot] = bodies_[slot]->getTotalTorque();
        } else {
          bodies_[slot]->applyCentralForce(forces[slot]);
          bodies_[slot]->applyTorque(torques[slot]);
        }
      }
      for (const auto& joint : joints_)
        if (joint) joint->prepare(part, dt);
      for (const auto& copy : copies_) {
        if (!copy) continue;
        // Bullet takes the velocity of such a body from the two transforms.
        btTransform before = copy->body->getWorldTransform();
        before.setOrigin(before.getOrigin() - static_cast<float>(part) * copy->velocity);
        copy->body->setInterpolationWorldTransform(before);
      }
      bullet_->world.stepSimulation(static_cast<float>(part), 0);
      left = more == 1 ? 0 : left - part;
      ++parts;
    }
  }

  Pose pose(std::size_t slot) const override {
    const btTransform& transform = bodies_[slot]->getWorldTransform();
    const btQuaternion q = transform.getRotation();
    return {from_bullet(transform.getOrigin(), kScale), Quaternion(q.w(), q.x(), q.y(), q.z()).normalized()};
  }

  void put_to_sleep(std::size_t slot) override {
    bodies_[slot]->setLinearVelocity({0, 0, 0});
    bodies_[slot]->setAngularVelocity({0, 0, 0});
    bodies_[slot]->setActivationState(ISLAND_SLEEPING);
  }

  bool asleep(std::size_t slot) const override { return !bodies_[slot]->isActive(); }

  Twist velocity(std::size_t slot) const override {
    return {from_bullet(bodies_[slot]->getLinearVelocity(), kScale),
            from_bullet(bodies_[slot]->getAngularVelocity(), 1)};
  }

  using PhysicsEngine::closest_direction;
  bool closest_direction(std::size_t slot, std::size_t piece, std::size_t other, std::size_t other_piece, double range,
                         Vector3& direction) const override {
    const btCollisionShape* one = piece_of(slot, piece);
    const btCollisionShape* two = piece_of(other, other_piece);
    if (shapes_[other]->getShapeType() == STATIC_PLANE_PROXYTYPE) {
      const btVector3 normal = bodies_[other]->getWorldTransform().getBasis().getColumn(1);
      direction = from_bullet(normal, 1);
      btVector3 low, high;  // a plane is infinite, so test the body's bounding box first
      one->getAabb(bodies_[slot]->getWorldTransform(), low, high);
      const btVector3 nearest(normal.x() > 0 ? low.x() : high.x(), normal.y() > 0 ? low.y() : high.y(),
                              normal.z() > 0 ? low.z() : high.z());
      return (nearest - bodies_[other]->getWorldTransform().getOrigin()).dot(normal) <=
             static_cast<float>(range * kScale);
    }
    if (!one->isConvex() || !two->isConvex()) return false;
    const float reach = static_cast<float>(range * kScale);
    btVector3 low, high, other_low, other_high;
    one->getAabb(bodies_[slot]->getWorldTransform(), low, high);
    two->getAabb(bodies_[other]->getWorldTransform(), other_low, other_high);
    for (int axis = 0; axis < 3; ++axis)
      if (low[axis] - reach > other_high[axis] || high[axis] + reach < other_low[axis]) return false;
    btVoronoiSimplexSolver simplex;
    btGjkEpaPenetrationDepthSolver depth;
    btGjkPairDetector detector(static_cast<const btConvexShape*>(one), static_cast<const btConvexShape*>(two), &simplex,
                               &depth);
    btGjkPairDetector::ClosestPointInput input;
    input.m_transformA = bodies_[slot]->getWorldTransform();
    input.m_transformB = bodies_[other]->getWorldTransform();
    input.m_maximumDistanceSquared = BT_LARGE_FLOAT;
    btPointCollector found;
    detector.getClosestPoints(input, found, nullptr);
    if (!found.m_hasResult || found.m_distance > reach) return false;
    direction = from_bullet(found.m_normalOnBInWorld, 1).normalized();
    return direction.allFinite();
  }

 private:
  struct Matter {
    double mass = 0;
    Vector3 inertia = Vector3::Zero();
    double friction = 0;
  };

  void add_body(std::size_t slot, const btTransform& pose) {
    const Matter& matter = matter_[slot];
    btRigidBody::btRigidBodyConstructionInfo info(static_cast<float>(matter.mass), nullptr, shapes_[slot].get(),
                                                  to_bullet(matter.inertia, kScale * kScale));
    info.m_startWorldTransform = pose;
    info.m_friction = static_cast<float>(std::sqrt(matter.friction));  // Bullet multiplies the values of both bodies
    info.m_restitution = 0;
    auto body = std::make_unique<btRigidBody>(info);
    body->setUserIndex(0);
    body->setFlags(body->getFlags() | BT_DISABLE_WORLD_GRAVITY);
    if (matter.mass > 0) {
      btVector3 low, high;
      shapes_[slot]->getAabb(btTransform::getIdentity(), low, high);
      // The speed of a rotating corner counts like the speed of the centre.
      body->setSleepingThresholds(static_cast<float>(kSleepingSpeed * kScale),
                                  static_cast<float>(kSleepingSpeed * kScale) / (0.5f * (high - low).length()));
      const float thinnest = 0.5f * std::min({high.x() - low.x(), high.y() - low.y(), high.z() - low.z()});
      body->setCcdMotionThreshold(thinnest);
      body->setCcdSweptSphereRadius(0.5f * thinnest);
    }
    bullet_->world.addRigidBody(body.get());
    bodies_[slot] = std::move(body);
  }

  /// Adds the body of a flexible object's copy, hidden.
  void add_body(BulletCopy& copy) {
    // A deformation drops all contact points, so a body needs several in its first step.
    bullet_->configuration.setConvexConvexMultipointIterations();
    btRigidBody::btRigidBodyConstructionInfo info(0, nullptr, &copy.shape);
    info.m_friction = copy.friction;
    info.m_restitution = 0;
    copy.body = std::make_unique<btRigidBody>(info);
    copy.body->setCollisionFlags(btCollisionObject::CF_KINEMATIC_OBJECT);
    copy.body->setUserIndex(kCopy | kHidden);
    copy.body->forceActivationState(ISLAND_SLEEPING);
    bullet_->world.addRigidBody(copy.body.get());
  }

  /// The rows of a joint are those of the start of a part T. A body that turns by w T opens the joint at the end of its
  /// arm l by l (w T)^2/2.
  double parts_per_second() const {
    double most = 0;
    const auto consider = [&most](const btRigidBody& body, const Pose& from_joint) {
      const double turn = static_cast<double>(body.getAngularVelocity().length());
      most = std::max(most, turn * std::sqrt(from_joint.position.norm() / (2 * kPartOpening)));
    };
    for (const auto& joint : joints_) {
      if (!joint) continue;
      consider(joint->getRigidBodyA(), joint->joint().parent_from_joint);
      consider(joint->getRigidBodyB(), joint->joint().child_from_joint);
    }
    return most;
  }

  const btCollisionShape* piece_of(std::size_t slot, std::size_t piece) const {
    return pieces_[slot].empty() ? shapes_[slot].get() : pieces_[slot][piece].get();
  }

  /// A pair of bodies that overlaps already is not filtered again when a joint begins or ends. So it is found anew.
  void forget_contacts(std::size_t slot) {
    if (bodies_[slot]) forget_contacts(*bodies_[slot]);
  }
  void forget_contacts(btRigidBody& body) {
    bullet_->world.getBroadphase()->getOverlappingPairCache()->cleanProxyFromPairs(body.getBroadphaseHandle(),
                                                                                   &bullet_->dispatcher);
  }

  /// Bullet does not notice that the support of a sleeping body was removed or that a body was placed on it.
  void wake_all() {
    for (const auto& body : bodies_)
      if (body && !body->isStaticObject()) body->activate();
  }

  std::optional<BulletWorld> bullet_{std::in_place};
  std::array<std::unique_ptr<btCollisionShape>, kMaxObjects> shapes_;
  std::array<std::vector<std::unique_ptr<btCollisionShape>>, kMaxObjects> pieces_;  // of compounds
  std::array<Matter, kMaxObjects> matter_;
  std::array<std::unique_ptr<btRigidBody>, kMaxObjects> bodies_;
  std::array<std::unique_ptr<BulletJoint>, kMaxObjectJoints> joints_;
  std::array<std::unique_ptr<BulletCopy>, kMaxSoftObjects> copies_;
};

}  // namespace

std::unique_ptr<PhysicsEngine> make_bullet_engine() { return std::make_unique<BulletEngine>(); }

HullSolid hull_solid(const std::vector<Vector3>& points) {
  std::vector<double> coordinates;
  for (const Vector3& p : points) coordinates.insert(coordinates.end(), {p.x(), p.y(), p.z()});
  btConvexHullComputer hull;
  hull.compute(coordinates.data(), 3 * sizeof(double), static_cast<int>(points.size()), 0, 0);
  if (hull.vertices.size() < 4) return {};
  const auto at = [&hull](int i) { return Vector3(hull.vertices[i].x(), hull.vertices[i].y(), hull.vertices[i].z()); };
  // Sums over the tetrahedra (inside point, a, b, c) of the fan of each face. The second moments follow the exact rule
  // for a tetrahedron with a corner at the origin.
  Vector3 inside = Vector3::Zero();
  for (int i = 0; i < hull.vertices.size(); ++i) inside += at(i) / hull.vertices.size();
  double volume = 0;
  Vector3 first = Vector3::Zero();
  Matrix3 second = Matrix3::Zero();
  for (int f = 0; f < hull.faces.size(); ++f) {
    const btConvexHullComputer::Edge* start = &hull.edges[hull.faces[f]];
    const Vector3 a = at(start->getSourceVertex()) - inside;
    for (const auto* edge = start->getNextEdgeOfFace(); edge->getTargetVertex() != start->getSourceVertex();
         edge = edge->getNextEdgeOfFace()) {
      const Vector3 b = at(edge->getSourceVertex()) - inside;
      const Vector3 c = at(edge->getTargetVertex()) - inside;
      const double v = std::abs(a.dot(b.cross(c))) / 6;
      const Vector3 sum = a + b + c;
      volume += v;
      first += v * sum / 4;
      second += v / 20 * (sum * sum.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose());
    }
  }
  if (!(volume > 0)) return {};
  const Vector3 offset = first / volume;
  const Matrix3 central = second - volume * offset * offset.transpose();
  return {volume, inside + offset, central.trace() * Matrix3::Identity() - central};
}

}  // namespace softhand
