#include "stress/watch.hpp"

#include <algorithm>
#include <cmath>

#include "cli/outcome.hpp"
#include "messages/convert.hpp"

namespace softhand::stress {
namespace {

constexpr double kEnergySlack = 0.01;                      // G2
constexpr double kLightForce = 3, kHardForce = 10;         // N per finger, G5
constexpr double kLightDepth = 0.5e-3, kHardDepth = 2e-3;  // m

}  // namespace

bool all_finite(const Skeleton& skeleton) {
  return std::all_of(skeleton.joints.begin(), skeleton.joints.end(), [](const JointSample& j) {
    return (j.flags & kJointValid) == 0 ||
           (softhand::all_finite(j.position) && softhand::all_finite(j.orientation) &&
            softhand::all_finite(j.linear_velocity) && softhand::all_finite(j.angular_velocity));
  });
}

bool all_finite(const Contacts& contacts) {
  const auto finger = [](const FingerContact& f) {
    return softhand::all_finite(f.force) && softhand::all_finite(f.centre) && softhand::all_finite(f.normal) &&
           std::isfinite(f.area) && std::isfinite(f.slip_speed);
  };
  const auto contact = [](const Contact& c) {
    return softhand::all_finite(c.point) && softhand::all_finite(c.normal) && softhand::all_finite(c.force) &&
           std::isfinite(c.penetration) && std::isfinite(c.slip_speed);
  };
  return std::all_of(contacts.fingers.begin(), contacts.fingers.end(), finger) &&
         std::all_of(contacts.contacts.begin(), contacts.contacts.end(), contact);
}

bool all_finite(const ObjectCoupling& coupling) {
  return std::all_of(coupling.twins.begin(), coupling.twins.end(), [](const ObjectTwin& t) {
    return softhand::all_finite(t.position) && softhand::all_finite(t.orientation) &&
           softhand::all_finite(t.linear_velocity) && softhand::all_finite(t.angular_velocity) &&
           softhand::all_finite(t.contact_force) && softhand::all_finite(t.contact_torque) &&
           softhand::all_finite(t.coupling_force) && softhand::all_finite(t.coupling_torque);
  });
}

bool all_finite(const BoneWrench& wrench) {
  return std::all_of(wrench.bones.begin(), wrench.bones.end(), [](const BoneSample& b) {
    return softhand::all_finite(b.tracked_position) && softhand::all_finite(b.intermediate_position) &&
           softhand::all_finite(b.simulated_position) && softhand::all_finite(b.tracked_orientation) &&
           softhand::all_finite(b.intermediate_orientation) && softhand::all_finite(b.simulated_orientation) &&
           softhand::all_finite(b.coupling_force) && softhand::all_finite(b.coupling_torque) &&
           softhand::all_finite(b.contact_force);
  });
}

bool all_finite(const WorldObjects& objects) {
  return std::all_of(objects.objects.begin(), objects.objects.end(), [](const ObjectState& o) {
    return softhand::all_finite(o.position) && softhand::all_finite(o.orientation) &&
           softhand::all_finite(o.linear_velocity) && softhand::all_finite(o.angular_velocity) &&
           softhand::all_finite(o.linear_acceleration) && softhand::all_finite(o.angular_acceleration);
  });
}

bool all_finite(const DeviceState& state) {
  return std::all_of(state.commands.begin(), state.commands.end(),
                     [](double command) { return std::isfinite(command); });
}

bool all_finite(const TissueSurface& surface) {
  return softhand::all_finite(surface.wrist_position) &&
         std::all_of(surface.nodes.begin(), surface.nodes.end(), [](const std::array<float, 3>& x) {
           return std::isfinite(x[0]) && std::isfinite(x[1]) && std::isfinite(x[2]);
         });
}

HandWatch::HandWatch() : contacts_(std::make_unique<Contacts>()) {}

void HandWatch::count_load(const std::array<double, kBodyCount>& forces) {
  std::array<double, 6> finger{};
  double hand = 0;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    finger[static_cast<std::size_t>(finger_of(static_cast<Body>(b)))] += forces[b];
    hand += forces[b];
  }
  finger_load_ = std::max(finger_load_, *std::max_element(finger.begin(), finger.begin() + kFingerCount));
  hand_load_ = std::max(hand_load_, hand);
}

void HandWatch::after_step(const HandSimulation& simulation, const StepReport& report, double time_step) {
  time_ += time_step;
  const State& state = simulation.state();
  if (!softhand::all_finite(state)) ++nonfinite_;
  const EnergyLedger& ledger = simulation.ledger();
  if (ledger.started()) {
    const double work = ledger.total().work + (anchoring_is_work_ ? ledger.total().anchoring : 0);
    energy_excess_ = std::max(energy_excess_, (ledger.total().stored - ledger.initial() - work) / ledger.scale());
  }
  // G8: the solver reported on the step, and its residual is finite.
  if (!std::isfinite(report.residual) || report.term_count == 0) ++unreported_;
  if (report.status != StepStatus::converged) ++unconverged_;

  std::array<double, kBodyCount> forces;
  for (int b = 0; b < kBodyCount; ++b)
    forces[static_cast<std::size_t>(b)] = simulation.coupling_wrench(static_cast<Body>(b)).force.norm();
  count_load(forces);

  simulation.write_contacts(*contacts_);
  if (!all_finite(*contacts_)) ++nonfinite_;
  if (!exempt_) {
    for (const Contact& contact : contacts_->contacts) {
      const double force = to_vector(contacts_->fingers[std::min<std::size_t>(contact.finger, 5)].force).norm();
      if (contact.penetration <= 0 || force > kHardForce) continue;
      (force <= kLightForce ? light_ : hard_).push_back(contact.penetration);
    }
  }
  const auto count = static_cast<double>(state.node_velocities.cols());
  speeds_.push_back({time_, std::sqrt(state.node_velocities.squaredNorm() / count)});
}

void HandWatch::judge(const HandSimulation& simulation, Findings& findings, double slow) const {
  findings.demand("G1", "numbers published that are not finite", static_cast<double>(nonfinite_), 0, "1",
                  Class::diverged);
  double sum = 0;
  std::size_t count = 0;
  for (auto speed = speeds_.rbegin(); speed != speeds_.rend() && speed->time > time_ - 0.2; ++speed, ++count)
    sum += speed->rms * speed->rms;
  findings.demand("rest", "speed of the tissue at the end, RMS over nodes and 0.2 s",
                  std::sqrt(sum / static_cast<double>(std::max<std::size_t>(count, 1))), slow, "m/s", Class::diverged);
  findings.demand("inverted", "inverted tetrahedra at the end", simulation.inverted_elements(), 0, "1",
                  Class::inverted);
  findings.demand("G2", "energy gained without work over max(initial, sum of |work|, 1 mJ)", energy_excess_,
                  kEnergySlack, "1");
  findings.demand("G4", "coupling force of a finger", finger_load_, kFingerCap * (1 + 1e-9), "N", Class::over_force);
  findings.demand("G4", "coupling force of the hand", hand_load_, kHandCap * (1 + 1e-9), "N", Class::over_force);
  if (!light_.empty())
    findings.demand("G5", "p95 of penetration at up to 3 N", percentile(light_, 0.95) * 1e3, kLightDepth * 1e3, "mm");
  if (!hard_.empty())
    findings.demand("G5", "p95 of penetration at 3 to 10 N", percentile(hard_, 0.95) * 1e3, kHardDepth * 1e3, "mm");
  findings.demand("G8", "steps without a residual", static_cast<double>(unreported_), 0, "1");
}

}  // namespace softhand::stress
