// Builds and writes the descriptions of objects and joints outside the world's loop.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "runtime/off_loop.hpp"
#include "world/world_loop.hpp"

namespace softhand {

class DescriptionChanges {
 public:
  /// `write_object` and `write_joint` run in a thread beside the loop. They may change their argument. All descriptions
  /// of `loop` are written first, with the sample time 0.
  DescriptionChanges(const WorldLoop& loop, std::function<void(ObjectDescription&)> write_object,
                     std::function<void(ObjectJointDescription&)> write_joint)
      : objects_(loop.descriptions()),
        joints_(loop.joint_descriptions()),
        write_object_(std::move(write_object)),
        write_joint_(std::move(write_joint)),
        writer_(kSteps * (objects_.size() + joints_.size()) + 1, kPeriod,
                [this](const Change& change) { write(change); }) {
    pass_on(loop, 0);
  }

  /// Passes on what has changed since the last call, the objects first. Call between steps. Does not wait or allocate.
  /// If there is no room, the next call repeats it.
  void pass_on(const WorldLoop& loop, Nanoseconds now) {
    if (loop.descriptions_version() == passed_on_) return;
    if (push_changed(loop.descriptions(), false, now) && push_changed(loop.joint_descriptions(), true, now))
      passed_on_ = loop.descriptions_version();
  }

 private:
  static constexpr std::size_t kSteps = 8;                ///< in which everything may change, and wait
  static constexpr std::chrono::milliseconds kPeriod{5};  ///< a description is at most this late

  struct Change {
    bool is_joint;
    std::uint32_t removed;
    std::size_t index;
    std::uint64_t sequence;
    Nanoseconds time;
  };

  template <typename Descriptions>
  bool push_changed(const Descriptions& list, bool is_joint, Nanoseconds now) {
    for (std::size_t i = 0; i < list.size(); ++i) {
      // Unchanged ones are left out, because a hand releases every object that is described again.
      if (list[i].stamp.sequence <= passed_on_) continue;
      if (!writer_.push({is_joint, list[i].removed, i, list[i].stamp.sequence, now})) return false;
    }
    return true;
  }

  void write(const Change& change) {
    const auto apply = [&change](auto description, const auto& write_it) {
      description.removed = change.removed;
      description.stamp.sequence = change.sequence;
      description.stamp.sample_time = change.time;
      write_it(description);
    };
    if (change.is_joint) {
      apply(joints_[change.index], write_joint_);
    } else {
      apply(objects_[change.index], write_object_);
    }
  }

  const std::vector<ObjectDescription> objects_;  // all but the changes stays as it was at the start
  const std::vector<ObjectJointDescription> joints_;
  std::function<void(ObjectDescription&)> write_object_;
  std::function<void(ObjectJointDescription&)> write_joint_;
  std::uint64_t passed_on_ = 0;
  OffLoop<Change> writer_;  // last member, because its thread uses the others
};

}  // namespace softhand
