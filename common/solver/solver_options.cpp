#include "solver/solver_options.hpp"

#include <stdexcept>

namespace softhand {

void check(const SolverOptions& options) {
  if (options.max_iterations < 1) throw std::invalid_argument("NewtonSolver: max_iterations must be at least 1");
  if (options.curvature != "exact" && options.curvature != "projected" && options.curvature != "adaptive") {
    throw std::invalid_argument("NewtonSolver: curvature must be adaptive, projected or exact, got " +
                                options.curvature);
  }
  if (options.factor != "float" && options.factor != "double")
    throw std::invalid_argument("NewtonSolver: factor must be float or double, got " + options.factor);
}

}  // namespace softhand
