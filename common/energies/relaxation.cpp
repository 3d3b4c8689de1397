#include "energies/relaxation.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace softhand {
namespace {

using Strain = std::array<double, 6>;

// a : b of symmetric tensors.
double product(const Strain& a, const Strain& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]);
}

// (1 - e^-a)/a, finite at a = 0.
double mean_decay(double a) { return a < 1e-8 ? 1 - 0.5 * a : -std::expm1(-a) / a; }

}  // namespace

RelaxationEnergy::RelaxationEnergy(const HandModel& hand, const Branches& time_constants,
                                   const std::vector<Branches>& weights)
    : time_constants_(time_constants), weights_(weights) {
  for (const double constant : time_constants) {
    if (!(constant > 0) || !std::isfinite(constant))
      throw std::invalid_argument("RelaxationEnergy: time constants must be > 0 s");
  }
  if (weights.size() != hand.materials.size())
    throw std::invalid_argument("RelaxationEnergy: expected weights for each of the " +
                                std::to_string(hand.materials.size()) + " materials");
  for (const Branches& of_material : weights) {
    for (const double weight : of_material) {
      if (!(weight >= 0) || !std::isfinite(weight))
        throw std::invalid_argument("RelaxationEnergy: weights must be finite and >= 0");
    }
  }
  for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
    Element element;
    element.material = hand.tetrahedron_material[t];
    const Branches& branches = weights[element.material];
    if (std::all_of(branches.begin(), branches.end(), [](double weight) { return weight == 0; })) continue;
    element.nodes = hand.tetrahedra[t];
    Matrix3 edges;
    for (int k = 0; k < 3; ++k)
      edges.col(k) = hand.nodes[static_cast<std::size_t>(element.nodes[static_cast<std::size_t>(k) + 1])] -
                     hand.nodes[static_cast<std::size_t>(element.nodes[0])];
    const Matrix3 inverse = edges.inverse();
    element.shape[0].setZero();
    for (int k = 0; k < 3; ++k) {
      element.shape[static_cast<std::size_t>(k) + 1] = inverse.row(k).transpose();
      element.shape[0] -= inverse.row(k).transpose();
    }
    const Material& material = hand.materials[element.material];
    element.modulus = edges.determinant() / 6 * material.youngs_modulus / (2 * (1 + material.poisson_ratio));
    elements_.push_back(element);
    blocks_.emplace_back(std::array<int, 4>{element.nodes[0], element.nodes[1], element.nodes[2], element.nodes[3]});
  }
  memory_.strains.assign(kRelaxationBranches * elements_.size(), Strain{});
}

void RelaxationEnergy::load(const Memory& memory) {
  if (memory.strains.size() != memory_.strains.size())
    throw std::invalid_argument("RelaxationEnergy: the memory is that of another hand");
  std::copy(memory.strains.begin(), memory.strains.end(), memory_.strains.begin());
  memory_.stored = memory.stored;
  memory_.dissipated = memory.dissipated;
}

void RelaxationEnergy::reset() {
  std::fill(memory_.strains.begin(), memory_.strains.end(), Strain{});
  memory_.stored = memory_.dissipated = 0;
}

void RelaxationEnergy::add_pattern(BlockPattern& pattern) const {
  for (const Clique<4>& blocks : blocks_) blocks.add_pattern(pattern);
}

void RelaxationEnergy::bind(const BlockMatrix& matrix) {
  for (Clique<4>& blocks : blocks_) blocks.bind(matrix);
}

Matrix3 RelaxationEnergy::deformation_gradient(const State& state, const Element& element) {
  // Differences from the first node keep their digits far from the origin.
  const Vector3 origin = state.node_positions.col(element.nodes[0]);
  Matrix3 f = Matrix3::Zero();
  for (std::size_t k = 1; k < 4; ++k)
    f.noalias() += (state.node_positions.col(element.nodes[k]) - origin) * element.shape[k].transpose();
  return f;
}

RelaxationEnergy::Strain RelaxationEnergy::green_strain(const Matrix3& f) {
  return {0.5 * (f.col(0).squaredNorm() - 1), 0.5 * (f.col(1).squaredNorm() - 1), 0.5 * (f.col(2).squaredNorm() - 1),
          0.5 * f.col(1).dot(f.col(2)),       0.5 * f.col(2).dot(f.col(0)),       0.5 * f.col(0).dot(f.col(1))};
}

void RelaxationEnergy::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
    const double a = time_step / time_constants_[i];
    decay_[i] = {std::exp(-a), mean_decay(a)};
  }
  for (std::size_t e = 0; e < elements_.size(); ++e) {
    Element& element = elements_[e];
    element.start = green_strain(deformation_gradient(state, element));
    element.quadratic = element.constant = 0;
    Strain sum{};  // of mu w e^-a h
    for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
      const Strain& h = memory_.strains[kRelaxationBranches * e + i];
      const double stiffness = element.modulus * weights_[element.material][i];
      element.quadratic += stiffness * decay_[i].taken;
      for (std::size_t k = 0; k < 6; ++k) sum[k] += stiffness * decay_[i].kept * h[k];
      element.constant += stiffness * decay_[i].kept * decay_[i].kept / decay_[i].taken * product(h, h);
    }
    for (std::size_t k = 0; k < 6; ++k) element.linear[k] = sum[k] - element.quadratic * element.start[k];
    element.constant += element.quadratic * product(element.start, element.start) - 2 * product(sum, element.start);
  }
}

// With dF = sum dx_a b_a^T, the second derivative of K E:E + 2 M:E is
//   sum_ab dx_a . [ (b_a . S b_b) 1 + K ((b_a . b_b) F F^T + (F b_b)(F b_a)^T) ] dx_b,   S = 2 (K E + M).
// The four b_a sum to zero, so the blocks of the nodes 1 to 3 determine those of node 0.
double RelaxationEnergy::evaluate(const State& state, VectorX* gradient, BlockMatrix* hessian,
                                  Curvature curvature) const {
  double energy = 0;
  for (std::size_t e = 0; e < elements_.size(); ++e) {
    const Element& element = elements_[e];
    const Matrix3 f = deformation_gradient(state, element);
    const Strain strain = green_strain(f);
    energy += element.quadratic * product(strain, strain) + 2 * product(element.linear, strain) + element.constant;
    if (gradient == nullptr && hessian == nullptr) continue;
    Matrix3 stress;  // V times the second Piola-Kirchhoff stress
    const auto at = [&](std::size_t k) { return 2 * (element.quadratic * strain[k] + element.linear[k]); };
    stress << at(0), at(5), at(4), at(5), at(1), at(3), at(4), at(3), at(2);
    Matrix3 shape;
    for (int a = 0; a < 3; ++a) shape.col(a) = element.shape[static_cast<std::size_t>(a) + 1];
    const Matrix3 moved = f * shape;  // F b_a
    if (gradient != nullptr) {
      const Matrix3 forces = f * (stress * shape);
      for (int a = 0; a < 3; ++a)
        gradient->segment<3>(3 * element.nodes[static_cast<std::size_t>(a) + 1]) += forces.col(a);
      gradient->segment<3>(3 * element.nodes[0]) -= forces.rowwise().sum();
    }
    if (hessian == nullptr) continue;
    const Matrix3 left = element.quadratic * f * f.transpose();
    Clique<4>::Hessian local;
    std::array<Matrix3, 3> of_first;  // blocks (a, 0)
    of_first.fill(Matrix3::Zero());
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b <= a; ++b) {
        Matrix3 block =
            shape.col(a).dot(shape.col(b)) * left + (element.quadratic * moved.col(b)) * moved.col(a).transpose();
        if (curvature == Curvature::exact) block.diagonal().array() += shape.col(a).dot(stress * shape.col(b));
        local.block<3, 3>(3 * a + 3, 3 * b + 3) = block;
        of_first[static_cast<std::size_t>(a)] -= block;
        if (a != b) of_first[static_cast<std::size_t>(b)] -= block.transpose();
      }
    }
    for (int a = 0; a < 3; ++a) local.block<3, 3>(3 * a + 3, 0) = of_first[static_cast<std::size_t>(a)];
    local.block<3, 3>(0, 0) = -(of_first[0] + of_first[1] + of_first[2]);
    blocks_[e].add(*hessian, local);
  }
  return energy;
}

double RelaxationEnergy::value(const State& state) const {
  return evaluate(state, nullptr, nullptr, Curvature::projected);
}

double RelaxationEnergy::add_gradient(const State& state, VectorX& gradient) const {
  return evaluate(state, &gradient, nullptr, Curvature::projected);
}

void RelaxationEnergy::add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const {
  evaluate(state, nullptr, &hessian, curvature);
}

double RelaxationEnergy::add_all(const State& state, VectorX& gradient, BlockMatrix& hessian,
                                 Curvature curvature) const {
  return evaluate(state, &gradient, &hessian, curvature);
}

void RelaxationEnergy::end_step(State& state) {
  before_ = memory_.stored;
  heat_ = memory_.stored = 0;
  for (std::size_t e = 0; e < elements_.size(); ++e) {
    const Element& element = elements_[e];
    Strain change = green_strain(deformation_gradient(state, element));
    for (std::size_t k = 0; k < 6; ++k) change[k] -= element.start[k];
    for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
      Strain& h = memory_.strains[kRelaxationBranches * e + i];
      const double stiffness = element.modulus * weights_[element.material][i], a = time_step_ / time_constants_[i];
      // Within the step, h = steady + (h_0 - steady) e^(-t/tau). The damper's power is 2 mu w |h|^2 / tau.
      Strain steady, decaying;
      for (std::size_t k = 0; k < 6; ++k) steady[k] = change[k] / a, decaying[k] = h[k] - steady[k];
      heat_ += 2 * stiffness *
               (a * product(steady, steady) + 2 * a * decay_[i].taken * product(steady, decaying) +
                0.5 * (1 - decay_[i].kept * decay_[i].kept) * product(decaying, decaying));
      for (std::size_t k = 0; k < 6; ++k) h[k] = decay_[i].kept * h[k] + decay_[i].taken * change[k];
      memory_.stored += stiffness * product(h, h);
    }
  }
  memory_.dissipated += heat_;
}

EnergyFlow RelaxationEnergy::flow(double, double, double taken) const {
  return {.stored = memory_.stored, .damping = heat_, .integrator = before_ - memory_.stored + taken - heat_};
}

}  // namespace softhand
