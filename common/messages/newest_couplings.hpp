// The newest coupling of each hand: input of the world, and of hands that touch the same objects.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "messages/age.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// The hand's twin of an object. Null: it has none.
inline const ObjectTwin* twin_of(const ObjectCoupling& coupling, std::uint32_t id) {
  for (const ObjectTwin& twin : coupling.twins)
    if (twin.object == id) return &twin;
  return nullptr;
}

/// Anybody on the domain can invent users. If the list is full, a new hand takes the place of the one that was heard
/// the longest time ago. Does not allocate after construction. A sample from the future is refused here, because it
/// would lie in the list until its time comes.
class NewestCouplings {
 public:
  explicit NewestCouplings(std::size_t most_hands) : most_(most_hands) {
    couplings_.reserve(most_);
    heard_.reserve(most_);
  }

  void put(const ObjectCoupling& coupling, Nanoseconds now) {
    if (!age_of(coupling.stamp.sample_time, now)) {
      ++refused_future_;
      return;
    }
    auto place = std::find_if(couplings_.begin(), couplings_.end(),
                              [&](const ObjectCoupling& each) { return each.hand == coupling.hand; });
    if (place == couplings_.end() && couplings_.size() < most_) {
      couplings_.emplace_back();
      heard_.emplace_back();
      place = couplings_.end() - 1;
    } else if (place == couplings_.end()) {
      place = couplings_.begin() + (std::min_element(heard_.begin(), heard_.end()) - heard_.begin());
    }
    *place = coupling;
    heard_[static_cast<std::size_t>(place - couplings_.begin())] = ++count_;
  }
  std::span<const ObjectCoupling> all() const { return couplings_; }
  std::uint64_t refused_future() const { return refused_future_; }

 private:
  std::size_t most_;
  std::vector<ObjectCoupling> couplings_;
  std::vector<std::uint64_t> heard_;  // `count_` when the coupling came
  std::uint64_t count_ = 0;
  std::uint64_t refused_future_ = 0;
};

}  // namespace softhand
