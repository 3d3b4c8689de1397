// Shapes of object files for the hand. Sampling a distance grid takes up to a second, so it happens before the loop
// starts, or on a thread beside the loop.
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

/// Delivers descriptions together with their shapes, without waiting for files.
class ObjectShapes {
 public:
  using Taker = std::function<void(const ObjectDescription&, std::shared_ptr<const ShapeGeometry>)>;
  using Complaint = std::function<void(const ObjectDescription&, const std::string&)>;

  explicit ObjectShapes(std::vector<std::string> folders);
  ~ObjectShapes();

  /// Loads a shape at once. Call before the loop starts. Throws as `load_shape` does.
  void prepare(const ShapeFile& file);
  /// Takes a description. Its shape is loaded beside the loop if it is not known.
  void request(const ObjectDescription& description);
  /// Calls `take` for each requested description whose shape is known, with null for a shape without a file. Calls
  /// `complain` for each one that cannot be loaded, with an empty text if the same file failed before.
  void deliver(const Taker& take, const Complaint& complain);

 private:
  struct Known {
    ShapeFile file;
    std::shared_ptr<const ShapeGeometry> shape;  // null: it could not be loaded
    std::string problem;
    bool told = false;
  };
  Known* find(const ShapeFile& file);
  void work(const std::stop_token& stop);

  std::vector<std::string> folders_;
  std::vector<ObjectDescription> waiting_;  // newest of each object
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::vector<Known> known_;        // guarded
  std::vector<ShapeFile> ordered_;  // guarded
  std::jthread thread_;             // starts with the first order
};

}  // namespace softhand
