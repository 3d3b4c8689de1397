// Shapes for the hand. Sampling the distance grid of an object file takes up to a second, and a convex hull with many
// vertices takes longer than a step may take. So both are built before the loop starts, or on a thread beside the loop.
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "geometry/shape.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// Loads the object file by name and SHA-256 in `folders`, and samples the link's distance grid in the object's body
/// frame. Throws std::runtime_error or std::invalid_argument if the file is missing, has another SHA-256 or does not
/// fit the description.
std::shared_ptr<const ShapeGeometry> load_shape(const ShapeFile& file, const std::vector<std::string>& folders);

/// Delivers descriptions together with their shapes, without waiting for them.
class ObjectShapes {
 public:
  using Taker = std::function<void(const ObjectDescription&, std::shared_ptr<const ShapeGeometry>)>;
  using Complaint = std::function<void(const ObjectDescription&, const std::string&)>;

  explicit ObjectShapes(std::vector<std::string> folders);
  ~ObjectShapes();

  /// Builds a shape at once. Call before the loop starts. Throws as `load_shape` does.
  void prepare(const Shape& shape);
  /// Takes a description. Its shape is built beside the loop if it is not known.
  void request(const ObjectDescription& description);
  /// Calls `take` for each requested description whose shape is known, with null for a shape that is quickly built: a
  /// sphere, a box and the like. Calls `complain` for each one that cannot be built, with an empty text if the same
  /// shape failed before.
  void deliver(const Taker& take, const Complaint& complain);

 private:
  struct Known {
    Shape shape;
    std::shared_ptr<const ShapeGeometry> geometry;  // null: it could not be built
    std::string problem;
    bool told = false;
  };
  std::shared_ptr<const ShapeGeometry> build(const Shape& shape) const;
  Known* find(const Shape& shape);
  void add(Known known);
  void order(const Shape& shape);
  void work(const std::stop_token& stop);

  std::vector<std::string> folders_;
  std::vector<ObjectDescription> waiting_;  // newest of each object
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::vector<Known> known_;    // guarded
  std::vector<Shape> ordered_;  // guarded
  std::jthread thread_;         // starts with the first order
};

}  // namespace softhand
