#include "energies/corotational.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace softhand {

CorotationalMaterial corotational_material(double youngs_modulus, double poisson_ratio, double strain_limit_energy,
                                           double strain_limit_stiffness, double strain_limit_ramp) {
  const auto refuse = [](const char* what, double value) {
    throw std::invalid_argument(std::string("co-rotational material: ") + what + ", got " + std::to_string(value));
  };
  if (!(youngs_modulus > 0) || !std::isfinite(youngs_modulus))
    refuse("Young's modulus must be finite and > 0 Pa", youngs_modulus);
  if (!(poisson_ratio >= 0 && poisson_ratio < 0.5)) refuse("Poisson's ratio must be in [0, 0.5)", poisson_ratio);
  if (!(strain_limit_energy > 0) || !std::isfinite(strain_limit_energy))
    refuse("W_max must be finite and > 0 J/m^3", strain_limit_energy);
  if (!(strain_limit_stiffness >= 0) || !std::isfinite(strain_limit_stiffness)) {
    refuse("k_s must be finite and >= 0 J/m^3", strain_limit_stiffness);
  }
  if (!(strain_limit_ramp >= 0 && strain_limit_ramp <= 1)) refuse("the ramp must be in [0, 1]", strain_limit_ramp);
  return {youngs_modulus / (2 * (1 + poisson_ratio)),
          youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio)), strain_limit_energy,
          strain_limit_stiffness, strain_limit_ramp};
}

CorotationalMaterial corotational_material(const Material& material) {
  return corotational_material(material.youngs_modulus, material.poisson_ratio, material.strain_limit_energy,
                               material.strain_limit_stiffness, material.strain_limit_ramp);
}

CorotationalState evaluate_corotational(const CorotationalMaterial& material, const Matrix3& f) {
  CorotationalState state;
  state.svd = rotation_svd(f);
  state.rotation = state.svd.rotation();
  const Vector3 strain = state.svd.singular_values.array() - 1.0;
  const double trace = strain.sum();
  state.quadratic = material.mu * strain.squaredNorm() + 0.5 * material.lambda * trace * trace;
  state.stress_quadratic = 2 * material.mu * (f - state.rotation) + material.lambda * trace * state.rotation;
  state.density = state.quadratic;
  const double excess = state.quadratic / material.strain_limit_energy - 1.0, ramp = material.strain_limit_ramp;
  const double slope = material.strain_limit_stiffness / material.strain_limit_energy;
  if (excess > ramp) {
    state.density += 0.5 * material.strain_limit_stiffness * (excess * excess + ramp * ramp / 3);
    state.factor += slope * excess;
    state.stiffening = slope / material.strain_limit_energy;
  } else if (excess > -ramp) {
    const double along = excess + ramp;
    state.density += material.strain_limit_stiffness * along * along * along / (12 * ramp);
    state.factor += slope * along * along / (4 * ramp);
    state.stiffening = slope / material.strain_limit_energy * along / (2 * ramp);
  }
  return state;
}

}  // namespace softhand
