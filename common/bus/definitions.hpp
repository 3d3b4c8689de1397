// Compares the definitions of our types with those of other modules.
#pragma once

#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "bus/user_data.hpp"

namespace softhand::bus::detail {

/// Reports on stderr each other module with another definition of a type of ours. Thread-safe.
class Definitions {
 public:
  /// `module`: our name in the reports.
  explicit Definitions(std::string module) : module_(std::move(module)) {}
  /// Call it once for each topic of ours.
  void add_own(const Endpoint& own);
  /// An endpoint of another module appeared. The module's endpoints of one topic are reported together.
  void add(const Endpoint& other);
  /// An endpoint of another module left.
  void remove(const Endpoint& other);

 private:
  void compare(const Endpoint& own, const Endpoint& other) const;

  std::string module_;
  std::mutex mutex_;
  std::vector<Endpoint> own_;
  std::map<Endpoint, int> others_;  // number of equal endpoints
};

}  // namespace softhand::bus::detail
