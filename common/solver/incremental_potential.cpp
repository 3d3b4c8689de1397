#include "solver/incremental_potential.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "math/rotation.hpp"

namespace softhand {
namespace {

// Relative change of the blocks of contact and friction. If they change less, the rest of the Hessian is what is stale.
constexpr double kKinkChange = 0.05;

}  // namespace

IncrementalPotential::IncrementalPotential(std::vector<Energy*> terms, DofLayout layout, const SolverOptions& options)
    : terms_(std::move(terms)),
      layout_(layout),
      curvature_(options.curvature == "exact" ? Curvature::exact : Curvature::projected),
      tries_exact_(tries_exact(options)),
      exact_now_(tries_exact_) {
  if (terms_.size() > kMaxTerms)
    throw std::invalid_argument("NewtonSolver: at most " + std::to_string(kMaxTerms) + " terms");
  BlockPattern pattern(layout_.block_count(), layout_.border_count());
  for (const Energy* term : terms_) term->add_pattern(pattern);
  hessian_ = BlockMatrix(pattern);
  for (Energy* term : terms_) term->bind(hessian_);
  for (int block = 0; block < layout_.block_count(); ++block) diagonal_.push_back(hessian_.find(block, block).index);
  changed_.reserve(2 * static_cast<std::size_t>(hessian_.stored_blocks()));
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const bool is_potential = terms_[t]->is_potential();
    if (!is_potential && terms_[t]->needed_bodies() > 0) continue;  // it is cheap
    BlockPattern touched(layout_.block_count(), layout_.border_count());
    terms_[t]->add_pattern(touched);
    potential_blocks_ += static_cast<double>(touched.lower_triangle().size());
    if (!is_potential) continue;
    const int bodies = std::min(terms_[t]->needed_bodies(), layout_.body_count);
    potential_bodies_ = std::max(potential_bodies_, static_cast<std::size_t>(bodies));
    order_.insert(bodies == 0 ? order_.begin() + static_cast<std::ptrdiff_t>(first_bodily_++) : order_.end(), t);
  }
  first_frozen_ = order_.size();
  const auto add_terms = [&](bool kinked, bool of_nodes) {
    for (std::size_t t = 0; t < terms_.size(); ++t) {
      if (!terms_[t]->is_potential() && terms_[t]->has_kinks() == kinked &&
          (terms_[t]->needed_bodies() == 0) == of_nodes)
        order_.push_back(t);
    }
    return order_.size();
  };
  first_other_ = add_terms(false, true);
  first_kinked_ = add_terms(false, false);
  add_terms(true, true);
  add_terms(true, false);
  for (std::size_t k = first_kinked_; k < order_.size(); ++k) kinked_.push_back(terms_[order_[k]]);
  gradient_ = displacement_ = carried_.gradient = carried_.node_gradient = VectorX::Zero(layout_.dof_count());
  other_stiffness_ = VectorX::Zero(9 * hessian_.core_blocks());
  start_ = empty_state(layout_);
  carried_.positions = start_.node_positions;
  carried_.poses = start_.body_poses;
}

void IncrementalPotential::begin_step(const State& state, double time_step) {
  start_ = state;
  time_step_ = time_step;
  exact_now_ = tries_exact_;
  for (Energy* term : terms_) term->begin_step(state, time_step);
}

bool IncrementalPotential::revise(const State& state) {
  bool changed = false;
  for (Energy* term : terms_) changed |= term->revise(state);
  return changed;
}

void IncrementalPotential::end_step(State& state) {
  for (Energy* term : terms_) term->end_step(state);
}

void IncrementalPotential::measure_displacement(const State& state) {
  Eigen::Map<Eigen::Matrix3Xd>(displacement_.data(), 3, layout_.node_count) =
      state.node_positions - start_.node_positions;
  for (int body = 0; body < layout_.body_count; ++body) {
    const Pose& now = state.body_poses[static_cast<std::size_t>(body)];
    const Pose& start = start_.body_poses[static_cast<std::size_t>(body)];
    displacement_.segment<3>(3 * layout_.body_translation_block(body)) = now.position - start.position;
    displacement_.segment<3>(3 * layout_.body_rotation_block(body)) =
        rotation_log(now.orientation * start.orientation.conjugate());
  }
}

Energy::Around IncrementalPotential::add_around(std::span<const std::int32_t> nodes, const State& state,
                                                double* gradient, double* blocks) const {
  Energy::Around result;
  for (std::size_t k = 0; k < first_other_; ++k) {
    if (k >= first_bodily_ && k < first_frozen_) continue;
    const Energy::Around of_term = terms_[order_[k]]->add_around(nodes, state, gradient, blocks);
    result.energy += of_term.energy;
    result.share += of_term.share;
  }
  return result;
}

bool IncrementalPotential::knows_potentials_at(const State& state) const {
  if (!carried_.known || carried_.positions != state.node_positions) return false;
  for (std::size_t b = 0; b < potential_bodies_; ++b) {
    const Pose &then = carried_.poses[b], &now = state.body_poses[b];
    if (then.position != now.position || then.orientation.coeffs() != now.orientation.coeffs()) return false;
  }
  return true;
}

bool IncrementalPotential::evaluate(const State& state, StepMeter& meter, const Request& request) {
  StepReport& report = meter.report;
  gradient_.setZero();
  if (request.hessian) {
    const auto timer = meter.time(&StepTiming::assembly);
    hessian_is_exact_ = exact_now_;
    change_hessian().set_zero();
  }
  const auto timer = meter.time(&StepTiming::energies);
  report.energy = 0;
  report.term_count = terms_.size();
  const bool with_work = measures_work_ && request.may_be_result;
  if (with_work) measure_displacement(state);
  double taken = 0;
  std::size_t known = 0;  // this many terms, in order, are not evaluated
  const Curvature smooth = request.hessian && exact_now_ ? Curvature::exact : curvature_;
  if (request.node_gradient != nullptr) {
    known = first_bodily_;
    gradient_ = *request.node_gradient;
  } else if (!request.hessian && !with_work && knows_potentials_at(state)) {
    known = first_frozen_;
    gradient_ = carried_.gradient;
  }
  const bool notes_others = request.hessian && first_bodily_ < first_kinked_ && !knows_other_stiffness();
  const bool splits_others = notes_others && first_frozen_ < first_other_;  // terms of nodes lie between them
  const Eigen::Map<const VectorX> stiffness(hessian_.values().data(), other_stiffness_.size());
  const auto note_others = [&] {
    other_stiffness_ += stiffness;
    other_time_step_ = time_step_;
  };
  for (std::size_t k = 0; k < order_.size(); ++k) {
    const std::size_t t = order_[k];
    if (k == first_bodily_ && known == 0) carried_.node_gradient = gradient_;
    if (k == first_frozen_ && known == 0) {
      carried_.gradient = gradient_;
      carried_.positions = state.node_positions;
      carried_.poses = state.body_poses;
      carried_.known = true;
    }
    if (notes_others && k == first_bodily_) other_stiffness_ = -stiffness;
    if (splits_others && k == first_frozen_) other_stiffness_ += stiffness;
    if (splits_others && k == first_other_) other_stiffness_ -= stiffness;
    if (request.hessian && k == first_kinked_) {
      if (notes_others) note_others();
      hessian_.begin_journal();
    }
    const double energy = k < known ? carried_.joules[k]
                          : request.hessian
                              ? terms_[t]->add_all(state, gradient_, hessian_, k < first_kinked_ ? smooth : curvature_)
                              : terms_[t]->add_gradient(state, gradient_);
    if (known == 0) carried_.joules[k] = energy;
    const double taken_so_far = with_work ? inner_product(layout_, gradient_, displacement_) : 0.0;
    report.terms[t].name = terms_[t]->name();
    report.terms[t].joules = energy;
    report.terms[t].taken = taken_so_far - taken;
    taken = taken_so_far;
    report.energy += energy;
  }
  if (splits_others && first_other_ == order_.size()) other_stiffness_ -= stiffness;
  if (notes_others && kinked_.empty()) note_others();
  report.residual = layout_.dof_count() > 0 ? gradient_.lpNorm<Eigen::Infinity>() : 0.0;
  report.work += request.hessian ? meter.prices.linearisation
                 : known > 0     ? meter.prices.frozen_evaluation
                                 : meter.prices.evaluation;
  return std::isfinite(report.energy) && gradient_.allFinite();
}

double IncrementalPotential::value(const State& state, StepMeter& meter) const {
  const auto timer = meter.time(&StepTiming::energies);
  double energy = 0;
  for (const Energy* term : terms_) energy += term->value(state);
  meter.report.work += meter.prices.evaluation;
  return energy;
}

BlockMatrix& IncrementalPotential::change_hessian() {
  ++version_;
  return hessian_;
}

double IncrementalPotential::diagonal(int block, int k) const {
  return hessian_.values()[static_cast<std::size_t>(9 * diagonal_[static_cast<std::size_t>(block)] + 4 * k)];
}

void IncrementalPotential::shift_diagonal(double shift) {
  double largest = 0;
  for (int block = 0; block < layout_.block_count(); ++block) {
    for (int k = 0; k < 3; ++k) largest = std::max(largest, std::abs(diagonal(block, k)));
  }
  BlockMatrix& hessian = change_hessian();
  for (const std::int32_t block : diagonal_) {
    for (int k = 0; k < 3; ++k) {
      double& entry = hessian.values()[static_cast<std::size_t>(9 * block + 4 * k)];
      entry += shift * std::max(std::abs(entry), 1e-9 * largest);
    }
  }
}

bool IncrementalPotential::project_hessian(const State& state, StepMeter& meter) {
  if (!hessian_is_exact_) return false;
  // The next exact Hessians of the step are not likely to be positive definite either.
  exact_now_ = false;
  evaluate(state, meter, {.hessian = true});
  return true;
}

bool IncrementalPotential::renew_kinks(const State& state, StepMeter& meter) {
  const auto timer = meter.time(&StepTiming::energies);
  BlockMatrix& hessian = change_hessian();
  changed_.assign(hessian.journal().begin(), hessian.journal().end());
  hessian.take_back();
  for (const Energy* term : kinked_) term->add_hessian(state, hessian, curvature_);
  changed_.insert(changed_.end(), hessian.journal().begin(), hessian.journal().end());
  meter.report.work += meter.prices.contact_blocks;
  return hessian.change_since_taken_back() > kKinkChange;
}

void IncrementalPotential::measure_work(bool taken, bool start_of_chord_steps) {
  measures_work_ = taken;
  measures_start_ = start_of_chord_steps;
}

void IncrementalPotential::measure_start(const State& state, StepReport& report) const {
  if (!measures_start_) return;
  for (std::size_t t = 0; t < terms_.size(); ++t) report.terms[t].start = terms_[t]->value(state);
}

void IncrementalPotential::take_over(const IncrementalPotential& other, bool with_hessian) {
  carried_ = other.carried_;
  version_ = other.version_;
  other_stiffness_ = other.other_stiffness_;
  other_time_step_ = other.other_time_step_;
  if (with_hessian) hessian_ = other.hessian_;
}

}  // namespace softhand
