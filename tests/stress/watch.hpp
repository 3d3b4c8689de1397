// Judges a simulated hand step by step by the invariants that hold in every case.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "messages/messages.hpp"
#include "scene/hand_simulation.hpp"
#include "stress/stress.hpp"

namespace softhand::stress {

/// True if every number that the message marks as valid is finite.
bool all_finite(const Skeleton& skeleton);
bool all_finite(const Contacts& contacts);
bool all_finite(const ObjectCoupling& coupling);
bool all_finite(const BoneWrench& wrench);
bool all_finite(const WorldObjects& objects);
bool all_finite(const DeviceState& state);
bool all_finite(const TissueSurface& surface);

inline constexpr double kFingerCap = 20;  ///< N, G4
inline constexpr double kHandCap = 100;

class HandWatch {
 public:
  HandWatch();

  void after_step(const HandSimulation& simulation, const StepReport& report, double time_step);
  /// Counts a published number that is not finite.
  void count_nonfinite() { ++nonfinite_; }
  /// G4: records the forces of the bones' couplings, N.
  void count_load(const std::array<double, kBodyCount>& forces);
  /// If true, G5 ignores penetrations from the next step on. Runs with an initial overlap use this.
  void exempt_penetration(bool exempt) { exempt_ = exempt; }
  /// If true, the energy at the start of contacts (the ledger's anchoring) counts as work put in. This applies to an
  /// overlap that the event makes, and to an object that is moved elsewhere.
  void count_anchoring_as_work(bool count) { anchoring_is_work_ = count; }

  /// Adds the demands G1, G2 by the energy ledger, G4, G5 and G8 to `findings`. It also demands that no element is
  /// inverted, and that the speed is at most `slow` m/s (RMS over the nodes and the last 0.2 s).
  void judge(const HandSimulation& simulation, Findings& findings, double slow = 0.5) const;

  /// Number of steps that did not converge. They reached the iteration limit or the budget, or they kept the old state.
  std::uint64_t unconverged() const { return unconverged_; }

 private:
  struct Speed {
    double time;
    double rms;
  };
  std::uint64_t nonfinite_ = 0;
  std::uint64_t unreported_ = 0;
  std::uint64_t unconverged_ = 0;
  double finger_load_ = 0, hand_load_ = 0;  // N, largest sum of coupling forces over a finger and over the hand
  bool exempt_ = false;
  bool anchoring_is_work_ = false;
  double energy_excess_ = 0;  // largest value over the steps, relative to the ledger's scale
  double time_ = 0;
  std::vector<Speed> speeds_;
  std::vector<double> light_, hard_;  // penetrations, m, at up to 3 N and at 3 N to 10 N per finger
  std::unique_ptr<Contacts> contacts_;
};

}  // namespace softhand::stress
