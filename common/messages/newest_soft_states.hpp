// The newest state of each flexible object since the last step: input of the world and of the hand.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "messages/messages.hpp"

namespace softhand {

/// Does not allocate after construction.
class NewestSoftStates {
 public:
  explicit NewestSoftStates(std::size_t most_objects) : most_(most_objects) { states_.reserve(most_objects); }

  void clear() { states_.clear(); }
  /// States of more objects than expected are dropped.
  void put(const SoftObjectState& state) {
    const auto known = std::ranges::find(states_, state.object, &SoftObjectState::object);
    if (known != states_.end()) {
      *known = state;
    } else if (states_.size() < most_) {
      states_.push_back(state);
    }
  }
  std::span<const SoftObjectState> all() const { return states_; }

 private:
  std::size_t most_;
  std::vector<SoftObjectState> states_;
};

}  // namespace softhand
