#include "hand/object_shapes.hpp"

#include <algorithm>
#include <stdexcept>

#include "messages/convert.hpp"
#include "runtime/object_store.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

// Anybody on the domain can describe objects. The shape that was built first makes room.
constexpr std::size_t kMostKnown = 512;

bool takes_long(const Shape& shape) { return !shape.file.empty() || !shape.vertices.empty(); }

}  // namespace

std::shared_ptr<const ShapeGeometry> load_shape(const ShapeFile& file, const std::vector<std::string>& folders) {
  const std::string name(get_text(file.name)), sha256(get_text(file.sha256));
  if (sha256.empty()) throw std::runtime_error("object '" + name + "': expected the SHA-256 of its file");
  const auto object = find_object(name, sha256, folders);
  if (!object) {
    std::string places;
    for (const std::string& folder : folders) places += (places.empty() ? "" : ", ") + folder;
    throw std::runtime_error("no file '" + name + std::string(kObjectSuffix) + "' in " + places);
  }
  if (file.link >= object->model.links.size())
    throw std::runtime_error(object->path + ": no link " + std::to_string(file.link) + ", expected 0 to " +
                             std::to_string(object->model.links.size() - 1));
  if (!all_finite(file.position) || !(std::abs(to_quaternion(file.orientation).norm() - 1) < 0.01))
    throw std::runtime_error("object '" + name + "': the frame of the link is not a pose");
  const ObjectLink& link = object->model.links[file.link];
  const Pose to_body = to_pose(file.position, file.orientation);
  TriangleMesh mesh = link.mesh;
  for (Vector3& vertex : mesh.vertices) vertex = to_body * vertex;
  return std::make_shared<const ShapeGeometry>(mesh, link.grid_spacing);
}

ObjectShapes::ObjectShapes(std::vector<std::string> folders) : folders_(std::move(folders)) {}
ObjectShapes::~ObjectShapes() = default;

std::shared_ptr<const ShapeGeometry> ObjectShapes::build(const Shape& shape) const {
  return shape.file.empty() ? std::make_shared<const ShapeGeometry>(shape) : load_shape(shape.file[0], folders_);
}

ObjectShapes::Known* ObjectShapes::find(const Shape& shape) {
  const auto known =
      std::find_if(known_.begin(), known_.end(), [&shape](const Known& each) { return is_same(each.shape, shape); });
  return known == known_.end() ? nullptr : &*known;
}

void ObjectShapes::add(Known known) {
  if (known_.size() >= kMostKnown) known_.erase(known_.begin());
  known_.push_back(std::move(known));
}

void ObjectShapes::prepare(const Shape& shape) {
  const std::lock_guard lock(mutex_);
  if (takes_long(shape) && find(shape) == nullptr) add({shape, build(shape), "", false});
}

void ObjectShapes::request(const ObjectDescription& description) {
  std::erase_if(waiting_, [&](const ObjectDescription& each) { return each.object == description.object; });
  waiting_.push_back(description);
  if (description.removed != 0 || !takes_long(description.shape)) return;
  {
    const std::lock_guard lock(mutex_);
    if (find(description.shape) == nullptr) order(description.shape);
  }
  wake_.notify_one();
}

void ObjectShapes::order(const Shape& shape) {
  if (std::any_of(ordered_.begin(), ordered_.end(), [&](const Shape& each) { return is_same(each, shape); })) return;
  ordered_.push_back(shape);
  if (thread_.joinable()) return;
  thread_ = std::jthread([this](const std::stop_token& stop) {
    become_ordinary();
    work(stop);
  });
}

void ObjectShapes::work(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (wake_.wait(lock, stop, [this] { return !ordered_.empty(); })) {
    Known known{ordered_.front(), nullptr, "", false};
    lock.unlock();
    try {
      known.geometry = build(known.shape);
    } catch (const std::exception& problem) {
      known.problem = problem.what();
    }
    lock.lock();
    add(std::move(known));
    ordered_.erase(ordered_.begin());
  }
}

void ObjectShapes::deliver(const Taker& take, const Complaint& complain) {
  if (waiting_.empty()) return;
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return;
  std::erase_if(waiting_, [&](const ObjectDescription& description) {
    if (description.removed != 0 || !takes_long(description.shape)) {
      take(description, nullptr);
      return true;
    }
    Known* known = find(description.shape);
    if (known == nullptr) {
      order(description.shape);  // it is already ordered, unless it made room for another
      return false;
    }
    if (known->geometry != nullptr) {
      take(description, known->geometry);
    } else {
      complain(description, known->told ? "" : known->problem);
      known->told = true;
    }
    return true;
  });
}

}  // namespace softhand
