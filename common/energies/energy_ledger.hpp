// The energy ledger: what was stored, put in and turned into heat since it began, and by how much the books do not
// balance.
//
//   residual = stored - initial - work - anchoring + friction + damping + integrator
//
// Each row is computed by itself (`Energy::flow`), the integrator's loss too: of conservative terms U(q_i) - U(q_i+1) +
// dU/dq(q_i+1) . dq, of inertia 1/2 |dv|^2_M. The residual is then the work of the force that the minimiser left over,
// dE/dq . dq, and whatever a term keeps no account of.
#pragma once

#include <algorithm>
#include <cmath>
#include <string_view>

namespace softhand {

/// What a step did with energy, joules. What a term stores rises by
///   taken + work + anchoring - friction - damping - integrator,
/// with `taken` = dU/dq . dq at the step's end.
struct EnergyFlow {
  double stored = 0;  ///< at the end of the step: potential, of inertia kinetic
  double work = 0;    ///< done from outside: by moving targets and objects, by gravity, and by whoever switches or puts
                      ///< something elsewhere between steps
  double friction = 0;  ///< heat of sliding
  double damping = 0;   ///< heat of dampers
  double integrator =
      0;  ///< lost by the time integration: backward Euler, and what is frozen within a step; negative: won
  double anchoring = 0;  ///< put in by contacts that begin, move or turn their plane: by no force's work

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
  /// One step, all terms together. The first is where the books begin: of it only what is stored counts.
  void add(const EnergyFlow& step) {
    if (!begun_) {
      begun_ = true;
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
  /// Closes the books; the next step opens new ones.
  void restart() { *this = EnergyLedger(); }

  bool begun() const { return begun_; }
  double initial() const { return initial_; }
  /// `stored` now, everything else since the books began.
  const EnergyFlow& total() const { return total_; }
  double residual() const {
    return total_.stored - initial_ - total_.work - total_.anchoring + total_.friction + total_.damping +
           total_.integrator;
  }
  /// What a residual is small against: the largest of what was stored at first, the sum of |work| of the steps, and 1
  /// mJ.
  double scale() const { return std::max({std::abs(initial_), turnover_, 1e-3}); }
  /// The largest |residual| / scale after any step.
  double defect() const { return largest_defect_; }
  /// The largest part of the scale by which more was stored, after any step, than had been stored and put in: energy
  /// from nowhere.
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

 private:
  bool begun_ = false;
  double initial_ = 0;
  EnergyFlow total_;
  double turnover_ = 0;
  double largest_defect_ = 0;
  double largest_excess_ = 0;
};

}  // namespace softhand
