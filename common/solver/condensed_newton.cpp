#include "solver/condensed_newton.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "solver/slope_bracket.hpp"

namespace softhand {
namespace {

constexpr int kMaxCondensedIterations = 8;
constexpr double kCondensedArmijo = 1e-4;
// Fraction of the first residual at which the problem is solved. The tissue's nonlinearity leaves more.
constexpr double kConverged = 1e-2;
// Time of an operation of the dense factorisation, in operations of a sparse factorisation in float. And of all else
// that an iteration does with an entry of the dense matrix.
constexpr double kDenseOperation = 0.6;
constexpr double kDenseEntry = 20;
// The same for an evaluation of the terms with kinks, per block that moves.
constexpr double kBlockOperations = 12'000;
// The factor of the dense matrix serves again if the part with kinks has changed by less than this fraction.
constexpr double kSmallChange = 0.001;
// But not after an iteration that left more than this fraction of the residual, because there are few iterations.
constexpr double kSlowFall = 0.1;
// Nor is the problem solved after such an iteration if something moved by more (m, rad). Where tissue is much softer
// than contact, a small residual force can be a long way.
constexpr double kSmallStep = 1e-4;
// Blocks of terms with kinks with which the factor can serve again. A power grasp has 700.
constexpr std::size_t kMaxFactored = 4096;
// A new `Compliance` may cost at most this work, in fast steps. It needs so many operations per pair of blocks.
constexpr double kMostCompliance = 8;
constexpr double kPairOperations = 15'000;
// The search along a step: its trials, and limits of the slope at its end, as in LineSearch. The slopes of the trials
// cost no more than their energies.
constexpr int kMaxTrials = 8;
constexpr double kCondensedLevel = 0.5, kCondensedShort = 0.05;
constexpr int kMaxCondensedRows = 3 * CondensedNewton::kMaxBlocks;

}  // namespace

CondensedNewton::CondensedNewton(DofLayout layout)
    : blocks_(layout),
      force_(layout.dof_count()),
      product_(layout.dof_count()),
      half_(layout.dof_count()),
      smooth_(kMaxCondensedRows, kMaxCondensedRows),
      dense_(kMaxBlocks),
      forces_(kMaxCondensedRows),
      smooth_gradient_(kMaxCondensedRows),
      smooth_slope_(kMaxCondensedRows),
      smooth_change_(kMaxCondensedRows),
      local_gradient_(kMaxCondensedRows),
      step_(kMaxCondensedRows),
      total_(kMaxCondensedRows),
      trial_total_(kMaxCondensedRows) {
  factored_blocks_.reserve(static_cast<std::size_t>(layout.block_count()));
  factored_.reserve(kMaxFactored);
  added_.reserve(static_cast<std::size_t>(layout.block_count()));
}

int CondensedNewton::room(double per_operation) {
  const double pairs = kMostCompliance / (kPairOperations * per_operation);
  return static_cast<int>(std::min<double>(kMaxBlocks, std::sqrt(pairs)));
}

int CondensedNewton::touched_blocks(const BlockMatrix& hessian) {
  blocks_.clear();
  blocks_.add_journal(hessian);
  const auto is_core = [&](std::int32_t block) { return block < hessian.core_count(); };
  return static_cast<int>(std::count_if(blocks_.list().begin(), blocks_.list().end(), is_core));
}

double CondensedNewton::kinked_energy(std::span<Energy* const> kinked, const State& state) {
  operations_ += kBlockOperations * static_cast<double>(blocks_.size());
  return blocks_.kinked_energy(kinked, state);
}

// Adds a block of the border to those that move, in front of the blocks of the core.
void CondensedNewton::include_border(std::int32_t block) {
  const auto begin = 3 * static_cast<Eigen::Index>(border_), end = blocks_.rows();
  std::copy_backward(total_.data() + begin, total_.data() + end, total_.data() + end + 3);
  total_.segment<3>(begin).setZero();
  blocks_.insert(static_cast<std::size_t>(border_++), block);
}

// Adds the blocks in the journal to those that move, and blocks of the border that are coupled with them. `half_` is
// half of the free solve.
CondensedNewton::Result CondensedNewton::include_touched(const BlockMatrix& hessian, BorderedSolver& factor,
                                                         std::span<const KeptBlock> kept, Compliance& compliance) {
  const std::int32_t core = hessian.core_count();
  added_.clear();
  bool is_full = false;
  const auto touch = [&](std::int32_t block) {
    if (blocks_.place(block) >= 0) return;
    if (block >= core) {
      is_full |= blocks_.size() == static_cast<std::size_t>(kMaxBlocks);
      if (!is_full) include_border(block);
    } else if (!compliance.has(block) && std::find(added_.begin(), added_.end(), block) == added_.end()) {
      added_.push_back(block);
    }
  };
  const auto touch_both = [&](std::int32_t stored) {
    const auto [row, column] = hessian.position(stored);
    touch(column);
    touch(row);
  };
  if (blocks_.size() == 0) {
    for (const KeptBlock& block : kept) touch_both(block.stored);
  }
  for (const std::int32_t stored : hessian.journal()) touch_both(stored);
  for (std::size_t before = 0; before != blocks_.size();) {
    before = blocks_.size();
    for (const std::int32_t stored : hessian.border_in_use()) {
      const auto [row, column] = hessian.position(stored);
      if (column < core || row == column) continue;
      if (blocks_.place(row) >= 0) touch(column);
      if (blocks_.place(column) >= 0) touch(row);
    }
  }
  // Neighbours are in one pass over the factor.
  std::sort(added_.begin(), added_.end());
  const auto border = static_cast<std::size_t>(border_), known = blocks_.size() - border;
  if (is_full || added_.size() > compliance.room() ||
      border + compliance.blocks().size() + added_.size() > static_cast<std::size_t>(kMaxBlocks)) {
    return Result::no_room;
  }
  if (!compliance.include(added_, factor.core())) return Result::not_positive;
  // At first no block moves. A block that is added later moves as the forces so far move it.
  const bool moves = known > 0 && known < compliance.blocks().size();
  if (moves) {
    product_ = half_;
    const auto from = 3 * static_cast<Eigen::Index>(known),
               end = 3 * static_cast<Eigen::Index>(compliance.blocks().size());
    forces_.segment(from, end - from).setZero();
    compliance.add_forces(forces_.head(end), product_);
  }
  const Eigen::Index from = blocks_.rows();
  for (std::size_t k = known; k < compliance.blocks().size(); ++k) blocks_.add(compliance.blocks()[k]);
  auto added = total_.segment(from, blocks_.rows() - from);
  added.setZero();
  if (moves) compliance.find_displacements(known, product_, added);
  return Result::found;
}

// Calls visit(row, column, block) for both triangles of the symmetric matrix of `kept`.
template <typename Visit>
void CondensedNewton::for_each_kept(const BlockMatrix& hessian, std::span<const KeptBlock> kept, Visit&& visit) const {
  for (const KeptBlock& block : kept) {
    const auto [row, column] = hessian.position(block.stored);
    const Eigen::Index j = blocks_.place(row), i = blocks_.place(column);
    visit(j, i, block.value);
    if (i != j) visit(i, j, block.value.transpose());
  }
}

// The forces of the model's terms with kinks on the blocks of the compliance, in its order. They include those of
// `kept`, which the factor has in addition.
void CondensedNewton::find_forces(const BlockMatrix& hessian, std::span<const KeptBlock> kept) {
  step_.head(size_) = smooth_slope_.head(size_);
  for_each_kept(hessian, kept, [this](Eigen::Index row, Eigen::Index column, const auto& block) {
    step_.segment<3>(3 * row) += block * total_.segment<3>(3 * column);
  });
  const auto border = 3 * static_cast<Eigen::Index>(border_);
  forces_.head(size_ - border) = step_.segment(border, size_ - border);
}

// `smooth_` holds the blocks between blocks of the border. The terms with kinks are in the journal of `hessian`.
void CondensedNewton::gather_border(const BlockMatrix& hessian) {
  smooth_.topLeftCorner(3 * border_, 3 * border_).setZero();
  const auto write = [&](std::int32_t stored, const auto& block) {
    const auto [row, column] = hessian.position(stored);
    if (column < hessian.core_count()) return;
    const Eigen::Index j = 3 * blocks_.place(row), i = 3 * blocks_.place(column);
    if (i < 0 || j < 0) return;
    smooth_.block<3, 3>(j, i) = block;
    smooth_.block<3, 3>(i, j) = block.transpose();
  };
  for (const std::int32_t stored : hessian.border_in_use())
    write(stored, Eigen::Map<const Matrix3>(hessian.values().data() + 9 * static_cast<std::ptrdiff_t>(stored)));
  for (std::size_t k = 0; k < hessian.journal().size(); ++k) write(hessian.journal()[k], hessian.previous(k));
}

// `product` = the Hessian of the condensed model's smooth terms times `move`.
void CondensedNewton::multiply_smooth(const BlockMatrix& hessian, std::span<const KeptBlock> kept,
                                      Compliance& compliance, const VectorX& move, VectorX& product) const {
  const auto border = 3 * static_cast<Eigen::Index>(border_), core = size_ - border;
  product.head(border).noalias() = smooth_.topLeftCorner(border, border) * move.head(border);
  compliance.multiply_stiffness(move.segment(border, core), product.segment(border, core));
  for_each_kept(hessian, kept, [&](Eigen::Index row, Eigen::Index column, const auto& block) {
    product.segment<3>(3 * row) -= block * move.segment<3>(3 * column);
  });
}

// `smooth_`, `smooth_gradient_` and `smooth_slope_` of the condensed model. The terms with kinks are in the journal of
// `hessian`.
void CondensedNewton::condense(const BlockMatrix& hessian, std::span<const KeptBlock> kept, Compliance& compliance) {
  size_ = blocks_.rows();
  gather_border(hessian);
  const auto border = 3 * static_cast<Eigen::Index>(border_), core = size_ - border;
  for (Eigen::Index i = 0; i < border; i += 3)
    smooth_gradient_.segment<3>(i) = -force_.segment<3>(3 * blocks_[static_cast<std::size_t>(i / 3)]);
  // The displacement of the touched blocks without terms with kinks.
  compliance.find_displacements(0, half_, trial_total_.head(core));
  compliance.multiply_stiffness(trial_total_.head(core), smooth_gradient_.segment(border, core));
  smooth_gradient_.segment(border, core) *= -1;
  smooth_slope_.head(size_) = smooth_gradient_.head(size_);
  if (total_.head(size_).isZero(0)) return;
  multiply_smooth(hessian, kept, compliance, total_, smooth_change_);
  smooth_slope_.head(size_) += smooth_change_.head(size_);
}

// Whether the factor of the dense matrix serves the terms with kinks in the journal of `hessian`. It does if the same
// blocks touch each other and hardly any stiffness has changed. An object's blocks sum all its contacts and would hide
// the change of one, so they are not compared.
bool CondensedNewton::serves_again(const BlockMatrix& hessian) const {
  if (!has_dense_factor_ || blocks_.list() != factored_blocks_ || hessian.journal().size() != factored_.size())
    return false;
  double change = 0, norm = 0;
  for (std::size_t k = 0; k < factored_.size(); ++k) {
    const auto& [position, block] = factored_[k];
    if (hessian.position(hessian.journal()[k]) != position) return false;
    if (position.first >= hessian.core_count()) continue;
    change += (hessian.added(k) - block).squaredNorm();
    norm += block.squaredNorm();
  }
  return change <= kSmallChange * kSmallChange * norm;
}

// Factorises the Hessian of the condensed model. The journal of `hessian` holds the terms with kinks. There is no
// factor if it is not positive definite.
void CondensedNewton::factorise(const BlockMatrix& hessian, std::span<const KeptBlock> kept,
                                const Compliance& compliance) {
  const auto border = 3 * static_cast<Eigen::Index>(border_);
  dense_.assign(smooth_, border, compliance.stiffness(), size_ - border);
  for_each_kept(hessian, kept, [this](Eigen::Index row, Eigen::Index column, const auto& block) {
    if (row >= column) dense_.add(row, column, -block);
  });
  factored_blocks_ = blocks_.list();
  factored_.clear();
  for (std::size_t k = 0; k < hessian.journal().size(); ++k) {
    const auto position = hessian.position(hessian.journal()[k]);
    const Matrix3 added = hessian.added(k);
    const Eigen::Index j = blocks_.place(position.first), i = blocks_.place(position.second);
    if (j >= i) {
      dense_.add(j, i, added);
    } else {
      dense_.add(i, j, added.transpose());
    }
    if (factored_.size() < kMaxFactored) factored_.push_back({position, added});
  }
  has_dense_factor_ = dense_.factorize();
  if (has_dense_factor_) operations_ += kDenseOperation * dense_.operations();
}

// The condensed model's energy of the smooth terms after the blocks have moved by `move`, where its gradient is
// `slope`.
double CondensedNewton::smooth_energy(const Eigen::Ref<const VectorX>& move,
                                      const Eigen::Ref<const VectorX>& slope) const {
  return 0.5 * move.dot(smooth_gradient_.head(size_) + slope);
}

void CondensedNewton::add_kinked_gradient(Eigen::Ref<VectorX> gradient) const {
  for (std::size_t i = 0; i < blocks_.size(); ++i)
    gradient.segment<3>(3 * static_cast<Eigen::Index>(i)) += blocks_.kinked_gradient().segment<3>(3 * blocks_[i]);
}

// Adds to `total_` as much of `step_` as lowers the model's energy. `local_gradient_` is the gradient at `total_`, and
// `smooth_change_` the change of `smooth_slope_` along the step. The search ends at a kink or beyond it, so that the
// next iteration knows what changes there. Returns false, and changes nothing, if the energy does not fall.
bool CondensedNewton::search(const State& state, std::span<Energy* const> kinked, double& energy) {
  auto gradient = local_gradient_.head(size_), step = step_.head(size_), total = total_.head(size_),
       trial_total = trial_total_.head(size_), smooth_slope = smooth_slope_.head(size_),
       change = smooth_change_.head(size_);
  const double slope = gradient.dot(step);
  double trial_energy = 0, there = 0;
  const auto evaluate = [&](double scale) {
    trial_total = total + scale * step;
    gradient = smooth_slope + scale * change;
    blocks_.move_to(state, trial_total);
    trial_energy = kinked_energy(kinked, blocks_.trial()) + smooth_energy(trial_total, gradient);
    add_kinked_gradient(gradient);
    there = gradient.dot(step);
    return trial_energy <= energy + kCondensedArmijo * scale * slope;
  };
  SlopeBracket bracket(slope);
  double scale = 1, last = 1;
  for (int trial = 0; trial < kMaxTrials; ++trial) {
    const bool falls = evaluate(last = scale);
    const bool accepts =
        falls && there <= -kCondensedLevel * slope && (there >= kCondensedShort * slope || bracket.high() == 0);
    if (accepts) break;
    bracket.narrow(scale, there, falls);
    scale = trial + 2 == kMaxTrials && bracket.low() > 0 ? bracket.low() : bracket.next();
  }
  if (!(trial_energy < energy)) return false;
  energy = trial_energy;
  total = trial_total;
  smooth_slope += last * change;
  return true;
}

CondensedNewton::Result CondensedNewton::minimise(const State& state, std::span<Energy* const> kinked,
                                                  Curvature curvature, const VectorX& gradient, double tolerance,
                                                  BlockMatrix& hessian, BorderedSolver& factor,
                                                  std::span<const KeptBlock> kept, Compliance& compliance,
                                                  VectorX& direction) {
  blocks_.start(state);
  border_ = 0;
  operations_ = 0;
  double energy = kinked_energy(kinked, state);
  force_ = blocks_.kinked_gradient() - gradient;
  factor.forward(force_, half_);
  const auto renew_kinked = [&] {
    operations_ += kBlockOperations * static_cast<double>(blocks_.size());
    MovingBlocks::renew_kinked(kinked, blocks_.trial(), curvature, hessian);
  };
  // Includes what `trial_` touches. New blocks move at once as the forces so far move them, and may touch more.
  const auto touch = [&] {
    while (true) {
      renew_kinked();
      const bool is_first = blocks_.size() == 0;
      const std::size_t before = blocks_.size();
      const Result included = include_touched(hessian, factor, kept, compliance);
      if (included != Result::found || (before == blocks_.size() && !is_first)) return included;
      condense(hessian, kept, compliance);
      find_forces(hessian, kept);
      if (is_first) return included;  // nothing has moved
      blocks_.move_to(state, total_.head(size_));
      energy = kinked_energy(kinked, blocks_.trial()) + smooth_energy(total_.head(size_), smooth_slope_.head(size_));
    }
  };
  Result result = touch();
  double first_residual = 0, last_residual = std::numeric_limits<double>::infinity();
  bool converged = false, is_new = true;
  double moved = 0;
  for (int iteration = 0; result == Result::found && iteration < kMaxCondensedIterations; ++iteration) {
    auto local_gradient = local_gradient_.head(size_), step = step_.head(size_);
    local_gradient = smooth_slope_.head(size_);
    add_kinked_gradient(local_gradient);
    const double residual = local_gradient.lpNorm<Eigen::Infinity>();
    if (iteration == 0) first_residual = residual;
    converged = residual <= std::max(kConverged * first_residual, tolerance);
    if (converged && (is_new || moved <= kSmallStep)) break;
    operations_ += kDenseEntry * static_cast<double>(size_) * static_cast<double>(size_);
    if (residual > kSlowFall * last_residual) forget_factor();
    is_new = !serves_again(hessian);
    last_residual = residual;
    if (is_new) factorise(hessian, kept, compliance);
    step = -local_gradient;
    if (has_dense_factor_) dense_.solve(step);
    if (!has_dense_factor_ || !step.allFinite()) {
      result = Result::not_positive;
      break;
    }
    multiply_smooth(hessian, kept, compliance, step_, smooth_change_);
    if (!search(state, kinked, energy)) {
      if (is_new || converged) break;
      forget_factor();
      blocks_.move_to(state, total_.head(size_));
      energy = kinked_energy(kinked, blocks_.trial()) + smooth_energy(total_.head(size_), smooth_slope_.head(size_));
      continue;
    }
    moved = step.lpNorm<Eigen::Infinity>();
    find_forces(hessian, kept);
    result = touch();
  }
  if (!converged) forget_factor();
  hessian.take_back();
  if (result != Result::found) return result;
  compliance.add_forces(forces_.head(3 * static_cast<Eigen::Index>(compliance.blocks().size())), half_);
  factor.backward(half_, direction);
  blocks_.spread(total_.head(size_), direction);
  return Result::found;
}

}  // namespace softhand
