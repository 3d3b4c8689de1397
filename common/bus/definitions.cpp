#include "bus/definitions.hpp"

#include <cstdio>

namespace softhand::bus::detail {

// Anybody on the domain can invent endpoints. Beyond this number, a module may be reported more than once.
static constexpr std::size_t kMostEndpoints = 4096;

void Definitions::add_own(const Endpoint& own) {
  const std::lock_guard lock(mutex_);
  own_.push_back(own);
  for (const auto& [other, count] : others_) compare(own, other);
}

void Definitions::add(const Endpoint& other) {
  const std::lock_guard lock(mutex_);
  if (const auto known = others_.find(other); known != others_.end()) {
    ++known->second;
    return;
  }
  for (const Endpoint& own : own_) compare(own, other);
  if (others_.size() < kMostEndpoints) others_.emplace(other, 1);
}

void Definitions::remove(const Endpoint& other) {
  const std::lock_guard lock(mutex_);
  const auto known = others_.find(other);
  if (known != others_.end() && --known->second == 0) others_.erase(known);
}

void Definitions::compare(const Endpoint& own, const Endpoint& other) const {
  if (own.topic != other.topic || (own.type == other.type && own.hash == other.hash)) return;
  std::fprintf(stderr,
               "%s: topic %s: module %s has another definition of its type: %s %016llx, here %s %016llx; expected "
               "programs of one version\n",
               module_.c_str(), own.topic.c_str(), other.module.c_str(), other.type.c_str(),
               static_cast<unsigned long long>(other.hash), own.type.c_str(),
               static_cast<unsigned long long>(own.hash));
}

}  // namespace softhand::bus::detail
