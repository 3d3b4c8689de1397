// The energy ledger. It sums the energy that was stored, put in and turned into heat since it began. It also computes
// by how much these sums do not balance.
//
//   residual = stored - initial - work - anchoring + friction + damping + integrator
//
// Each row is computed independently (`Energy::flow`). This includes the integrator's loss. For conservative terms it
// is U(q_i) - U(q_i+1) + dU/dq(q_i+1) . dq, and for inertia 1/2 |dv|^2_M. The residual then consists of the work of the
// minimiser's residual force, dE/dq . dq, and of anything that a term does not account for.
#pragma once

#include <algorithm>
#include <cmath>
#include <string_view>

namespace softhand {

/// Energy flows of one step in joules. The stored energy of a term rises by
///   taken + work + anchoring - friction - damping - integrator,
/// with `taken` = dU/dq . dq at the step's end.
struct EnergyFlow {
  double stored = 0;  ///< at the end of the step: potential energy; for inertia, kinetic energy
  /// Work done from outside: by moving targets and objects, by gravity, and by callers that switch or reposition things
  /// between steps.
  double work = 0;
  double friction = 0;  ///< heat of sliding
  double damping = 0;   ///< heat of dampers
  /// Lost by the time integration: backward Euler, and values that are fixed within a step. Negative: gained.
  double integrator = 0;
  /// Put in by contacts that begin, move or turn their plane. This is not the work of a force.
  double anchoring = 0;

  EnergyFlow& operator+=(const EnergyFlow& other) {
    stored += other.stored;
    work += other.work;
    friction += other.friction;
    damping += other.damping;
    integrator += other.integrator;
    anchoring += other.anchoring;
    return *this;
  }
};

class EnergyLedger {
 public:
  /// Adds one step, all terms together. The first call starts the ledger: only its stored energy counts.
  void add(const EnergyFlow& step) {
    if (!started_) {
      started_ = true;
      initial_ = step.stored;
      total_.stored = step.stored;
      return;
    }
    total_.stored = 0;
    total_ += step;
    turnover_ += std::abs(step.work);
    largest_defect_ = std::max(largest_defect_, std::abs(residual()) / scale());
    largest_excess_ = std::max(largest_excess_, (total_.stored - initial_ - total_.work) / scale());
  }
  /// Clears the ledger. The next step starts a new one.
  void restart() { *this = EnergyLedger(); }

  bool started() const { return started_; }
  double initial() const { return initial_; }
  /// `stored` is the current value. All other members are sums since the ledger began.
  const EnergyFlow& total() const { return total_; }
  double residual() const {
    return total_.stored - initial_ - total_.work - total_.anchoring + total_.friction + total_.damping +
           total_.integrator;
  }
  /// The reference for a small residual: the largest of the initially stored energy, the sum of |work| over the steps,
  /// and 1 mJ.
  double scale() const { return std::max({std::abs(initial_), turnover_, 1e-3}); }
  /// The largest |residual| / scale after any step.
  double defect() const { return largest_defect_; }
  /// Largest energy gain from nowhere after any step, relative to the scale: stored energy minus initial energy minus
  /// work.
  double excess() const { return largest_excess_; }

  /// Calls f(name, joules) for each row.
  template <typename F>
  void for_each_row(F&& f) const {
    f(std::string_view("stored"), total_.stored);
    f(std::string_view("initial"), initial_);
    f(std::string_view("work"), total_.work);
    f(std::string_view("friction"), total_.friction);
    f(std::string_view("damping"), total_.damping);
    f(std::string_view("integrator"), total_.integrator);
    f(std::string_view("anchoring"), total_.anchoring);
    f(std::string_view("residual"), residual());
    f(std::string_view("scale"), scale());
  }

  /// For writing and reading the ledger (messages/plain_bytes.hpp).
  template <typename Self, typename Visit>
  static void visit_members(Self& self, Visit&& visit) {
    visit(self.started_);
    visit(self.initial_);
    visit(self.total_);
    visit(self.turnover_);
    visit(self.largest_defect_);
    visit(self.largest_excess_);
  }

 private:
  bool started_ = false;
  double initial_ = 0;
  EnergyFlow total_;
  double turnover_ = 0;
  double largest_defect_ = 0;
  double largest_excess_ = 0;
};

}  // namespace softhand
