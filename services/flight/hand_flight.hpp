// The records of the hand's loop.
#pragma once

#include <algorithm>

#include "flight/flight.hpp"
#include "hand/hand_loop.hpp"

namespace softhand {

template <>
struct FlightTraits<HandLoop> {
  struct Input {
    const HandInput& input;
    const RequestedOutputs& requested;
  };
  static void write_input(ByteWriter& out, const Input& from, bool) {
    out.write(from.requested);
    const auto write = [&out](const auto* sample) {
      out.write(sample != nullptr);
      if (sample != nullptr) out.write(*sample);
    };
    write(from.input.skeleton);
    write(from.input.head);
    write(from.input.world);
    out.write(static_cast<std::uint32_t>(from.input.other_hands.size()));
    for (const ObjectCoupling& coupling : from.input.other_hands) out.write(coupling);
    out.write(from.input.work_budget);
    write(from.input.second_skeleton);
    out.write(static_cast<std::uint32_t>(from.input.soft_objects.size()));
    for (const SoftObjectState& copy : from.input.soft_objects) out.write(copy);
  }
  /// Steps with a recorded input. Samples live in here, because they are large.
  class Repeater {
   public:
    struct Step {
      RequestedOutputs requested;
      HandInput input;
    };
    /// Valid until the next call.
    Step read(ByteReader& in) {
      Step result;
      in.read(result.requested);
      result.input.skeleton = read_optional(in, samples_->skeleton);
      result.input.head = read_optional(in, samples_->head);
      result.input.world = read_optional(in, samples_->world);
      in.read(samples_->other_hands);
      result.input.other_hands = samples_->other_hands;
      in.read(result.input.work_budget);
      result.input.second_skeleton = read_optional(in, samples_->second_skeleton);
      in.read(samples_->soft_objects);
      result.input.soft_objects = samples_->soft_objects;
      return result;
    }
    void step(HandLoop& loop, Nanoseconds now, ByteReader& in) {
      const Step recorded = read(in);
      loop.step(now, recorded.input, recorded.requested);
    }
    void describe(HandLoop& loop, std::uint8_t kind, ByteReader& in) {
      try {
        if (kind == kFlightObject) loop.describe_object(in.take<ObjectDescription>());
        if (kind == kFlightJoint) loop.describe_joint(in.take<ObjectJointDescription>());
      } catch (const std::invalid_argument&) {
        // The live loop has refused it too.
      }
    }

   private:
    struct Samples {
      Skeleton skeleton;
      HeadPose head;
      WorldObjects world;
      std::vector<ObjectCoupling> other_hands;
      Skeleton second_skeleton;
      std::vector<SoftObjectState> soft_objects;
    };
    std::unique_ptr<Samples> samples_ = std::make_unique<Samples>();
  };

  static std::uint32_t status(const HandLoop& loop) { return static_cast<std::uint32_t>(loop.report().status); }
  static const char* status_text(std::uint32_t status) { return to_string(static_cast<StepStatus>(status)).data(); }
  /// The wrist's position (m) and the largest contact force on a bone (N).
  static constexpr std::array<const char*, 4> kFigures{"wrist x", "wrist y", "wrist z", "contact force"};
  static constexpr std::array<double, 4> kTolerances{1e-3, 1e-3, 1e-3, 1};
  static std::array<double, 4> figures(const HandLoop& loop) {
    const Vector3 wrist = loop.simulation().joint_pose(Joint::wrist).position;
    return {wrist.x(), wrist.y(), wrist.z(), largest_force(loop)};
  }
  static double largest_force(const HandLoop& loop) {
    double largest = 0;
    for (int hand = 0; hand < loop.hand_count(); ++hand)
      for (const Vector3& force : loop.simulation().bone_contact_forces(hand))
        largest = std::max(largest, force.norm());
    return largest;
  }
  static void save(const HandLoop& loop, ByteWriter& out) { loop.save(out); }
  static void load(HandLoop& loop, ByteReader& in) { loop.load(in); }
  static void forget(HandLoop& loop) { loop.forget(); }
};

/// Finds what should not happen, after each step.
class HandInvariants {
 public:
  explicit HandInvariants(const FlightOptions& limits) : limits_(limits) {}
  /// Returns what is wrong, or null.
  const char* check(const HandLoop& loop) {
    const HandCounters& counters = loop.counters();
    const HandCounters before = std::exchange(before_, counters);
    if (counters.failed_steps > before.failed_steps) return "a step failed";
    if (counters.refused_nonfinite > before.refused_nonfinite) return "an input was not finite";
    if (limits_.contact_force > 0 && FlightTraits<HandLoop>::largest_force(loop) > limits_.contact_force)
      return "a contact force is above flight.contact_force";
    if (limits_.ledger_defect > 0 && loop.simulation().ledger().defect() > limits_.ledger_defect)
      return "the ledger's defect is above flight.ledger_defect";
    // The count costs as much as an evaluation of the tissue, so it is not taken in each step.
    if (limits_.inverted_elements > 0 && ++steps_ % kCountPeriod == 0 &&
        loop.simulation().inverted_elements() > limits_.inverted_elements)
      return "more elements are inverted than flight.inverted_elements";
    return nullptr;
  }

 private:
  static constexpr std::uint64_t kCountPeriod = 30;
  FlightOptions limits_;
  HandCounters before_;
  std::uint64_t steps_ = 0;
};

}  // namespace softhand
