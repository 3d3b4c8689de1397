#include "stress/sweep.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numeric>

#include "stress/hand_events.hpp"
#include "support/box_mesh.hpp"

namespace softhand::stress {
namespace {

// The digits of n in `base`, mirrored at the radix point: van der Corput's sequence in [0, 1).
double mirrored_digits(std::size_t n, std::size_t base) {
  double value = 0, digit = 1;
  for (; n > 0; n /= base) {
    digit /= static_cast<double>(base);
    value += digit * static_cast<double>(n % base);
  }
  return value;
}

double logarithmic(double low, double high, double share) { return low * std::pow(high / low, share); }

Findings pressed(const SweepPoint& point, const SolverOptions& solver) {
  constexpr double kStays = 10e-3, kSlowContact = 0.1;  // m, m/s
  Event event;
  event.hand = one_finger(shipped_hand(), Finger::index);
  for (Material& material : event.hand.materials) {
    material.youngs_modulus = point.youngs_modulus;
    material.poisson_ratio = point.poisson_ratio;
  }
  event.options.contact_stiffness = point.contact_stiffness;
  event.options.solver = solver;
  event.time_step = [&point](int) { return point.time_step; };
  event.seconds = 0.6;
  const std::vector<double> masses = lumped_masses(event.hand);
  event.object.shape = box_shape({0.012, 0.008, 0.012});
  event.object.pose.position = pad_of(event.hand, Finger::index) - Vector3(0, 0.008 + 2e-3, 0);
  event.object.mass = point.mass_ratio * std::accumulate(masses.begin(), masses.end(), 0.0);
  event.object.on_table = true;
  event.bones = press_down(5e-3, 0.15);
  double moved = 0, force = 0;
  Findings findings = run(
      event,
      [&](const EventStep& now) {
        moved = (now.simulation.slot_pose(now.slot).position - event.object.pose.position).norm();
        force = std::max(force, now.simulation.contact_wrench(now.slot).force.norm());
      },
      kSlowContact);
  findings.demand_at_least("touched", "largest force on the object", force, 1e-3, "N");
  findings.demand("stays", "object from its place", moved * 1e3, kStays * 1e3, "mm");
  return findings;
}

}  // namespace

SweepPoint sweep_point(std::size_t n) {
  return {logarithmic(1e3, 1e7, mirrored_digits(n, 2)), 0.499 * mirrored_digits(n, 3),
          logarithmic(0.5e-3, 33e-3, mirrored_digits(n, 5)), logarithmic(1e6, 1e11, mirrored_digits(n, 7)),
          logarithmic(1e-4, 1e4, mirrored_digits(n, 11))};
}

std::vector<Case> sweep_cases(std::size_t points) {
  struct Mode {
    const char* name;
    const char* sweep;
    const char* statement;
    SolverOptions solver;
  };
  SolverOptions one_step, live;
  one_step.max_iterations = 1;
  live.work_budget = kLiveBudget;
  std::vector<Case> cases;
  for (const Mode& mode :
       {Mode{"default", "sweep", "one finger presses an object on a table, default mode", {}},
        Mode{"one step", "sweep_one_step", "the same with one Newton step", one_step},
        Mode{"live budget", "sweep_live", "the same with the live budget of two fast steps", live}}) {
    Case& which = cases.emplace_back(Case{mode.sweep, "Sweep", mode.statement, {}});
    for (std::size_t n = 1; n <= points; ++n) {
      const SweepPoint point = sweep_point(n);
      which.rows.push_back({fmt::format("E = {:.4g} Pa, nu = {:.4f}, dt = {:.4g} ms, k = {:.4g} N/m^3, ratio = {:.4g}",
                                        point.youngs_modulus, point.poisson_ratio, point.time_step * 1e3,
                                        point.contact_stiffness, point.mass_ratio),
                            [point, solver = mode.solver] { return pressed(point, solver); },
                            {},
                            false,
                            false,
                            mode.name});
    }
  }
  return cases;
}

}  // namespace softhand::stress
