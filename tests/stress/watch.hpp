// Judges a simulated hand, step by step, by the invariants that hold in every case.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "messages/messages.hpp"
#include "scene/hand_simulation.hpp"
#include "stress/stress.hpp"

namespace softhand::stress {

/// True where every number that the message calls valid is finite.
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
  /// A number that is not finite was published.
  void count_nonfinite() { ++nonfinite_; }
  /// G4: what the couplings of the bones pull with, N.
  void count_load(const std::array<double, kBodyCount>& forces);
  /// Penetrations are judged from the next step on: an initial overlap is exempt until it is out.
  void exempt_penetration(bool exempt) { exempt_ = exempt; }
  /// What contacts begin with (the ledger's anchoring) counts as work in: an overlap that the event makes, or an object
  /// that is put elsewhere.
  void count_anchoring_as_work(bool count) { anchoring_is_work_ = count; }

  /// G1, that the hand is at rest or moves as slowly as `slow` m/s (RMS of its nodes over the last 0.2 s), no element
  /// inverted, G2 by the energy ledger, G4, G5, G8.
  void judge(const HandSimulation& simulation, Findings& findings, double slow = 0.5) const;

  /// Steps that did not converge: by iteration limit or budget, or kept the state.
  std::uint64_t unconverged() const { return unconverged_; }

 private:
  struct Speed {
    double time;
    double rms;
  };
  std::uint64_t nonfinite_ = 0;
  std::uint64_t unreported_ = 0;
  std::uint64_t unconverged_ = 0;
  double finger_load_ = 0, hand_load_ = 0;  // N, the largest sums of a finger's and of all coupling forces
  bool exempt_ = false;
  bool anchoring_is_work_ = false;
  double energy_excess_ = 0;  // largest over the steps, of the ledger's scale
  double time_ = 0;
  std::vector<Speed> speeds_;
  std::vector<double> light_, hard_;  // penetrations, m, at up to 3 N and up to 10 N a finger
  std::unique_ptr<Contacts> contacts_;
};

}  // namespace softhand::stress
