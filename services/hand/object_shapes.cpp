#include "hand/object_shapes.hpp"

#include <algorithm>
#include <stdexcept>

#include "messages/convert.hpp"
#include "runtime/object_store.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

bool is_same(const ShapeFile& a, const ShapeFile& b) {
  return get_text(a.name) == get_text(b.name) && get_text(a.sha256) == get_text(b.sha256) && a.link == b.link &&
         a.position == b.position && a.orientation == b.orientation;
}

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

ObjectShapes::Known* ObjectShapes::find(const ShapeFile& file) {
  const auto known =
      std::find_if(known_.begin(), known_.end(), [&file](const Known& each) { return is_same(each.file, file); });
  return known == known_.end() ? nullptr : &*known;
}

void ObjectShapes::prepare(const ShapeFile& file) {
  const std::lock_guard lock(mutex_);
  if (find(file) == nullptr) known_.push_back({file, load_shape(file, folders_), "", false});
}

void ObjectShapes::request(const ObjectDescription& description) {
  std::erase_if(waiting_, [&](const ObjectDescription& each) { return each.object == description.object; });
  waiting_.push_back(description);
  if (description.removed != 0 || description.shape.file.empty()) return;
  const ShapeFile& file = description.shape.file[0];
  {
    const std::lock_guard lock(mutex_);
    if (find(file) != nullptr) return;
    if (std::any_of(ordered_.begin(), ordered_.end(), [&](const ShapeFile& each) { return is_same(each, file); }))
      return;
    ordered_.push_back(file);
  }
  if (!thread_.joinable())
    thread_ = std::jthread([this](const std::stop_token& stop) {
      become_ordinary();
      work(stop);
    });
  wake_.notify_one();
}

void ObjectShapes::work(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (wake_.wait(lock, stop, [this] { return !ordered_.empty(); })) {
    Known known{ordered_.front(), nullptr, "", false};
    lock.unlock();
    try {
      known.shape = load_shape(known.file, folders_);
    } catch (const std::exception& problem) {
      known.problem = problem.what();
    }
    lock.lock();
    known_.push_back(std::move(known));
    ordered_.erase(ordered_.begin());
  }
}

void ObjectShapes::deliver(const Taker& take, const Complaint& complain) {
  if (waiting_.empty()) return;
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return;
  std::erase_if(waiting_, [&](const ObjectDescription& description) {
    if (description.removed != 0 || description.shape.file.empty()) {
      take(description, nullptr);
      return true;
    }
    Known* known = find(description.shape.file[0]);
    if (known == nullptr) return false;
    if (known->shape != nullptr) {
      take(description, known->shape);
    } else {
      complain(description, known->told ? "" : known->problem);
      known->told = true;
    }
    return true;
  });
}

}  // namespace softhand
