#include "hand_builder/contact_samples.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace softhand::builder {
namespace {

// Each triangle is cut into kCuts^2 equal pieces. Their centres are the candidates.
constexpr int kCuts = 4;

struct Candidate {
  Vector3 position;
  double area = 0;
  double spacing = 0;
  double squared = std::numeric_limits<double>::infinity();  // distance from the nearest sample, squared
  std::size_t nearest = 0;                                   // sample
};

std::vector<Candidate> candidates(const TriangleMesh& skin, const std::function<double(const Vector3&)>& spacing) {
  std::vector<Candidate> out;
  out.reserve(skin.triangles.size() * kCuts * kCuts);
  for (const auto& triangle : skin.triangles) {
    const auto corner = [&](std::size_t k) { return skin.vertices[static_cast<std::size_t>(triangle[k])]; };
    const Vector3 a = corner(0), u = (corner(1) - a) / kCuts, v = (corner(2) - a) / kCuts;
    const double area = 0.5 * u.cross(v).norm();
    const auto add = [&](double i, double j) {
      const Vector3 position = a + i * u + j * v;
      out.push_back({position, area, spacing(position)});
    };
    for (int i = 0; i < kCuts; ++i) {
      for (int j = 0; i + j < kCuts; ++j) {
        add(i + 1.0 / 3, j + 1.0 / 3);
        if (i + j + 1 < kCuts) add(i + 2.0 / 3, j + 2.0 / 3);
      }
    }
  }
  return out;
}

}  // namespace

// The candidate that is farthest from the samples, in units of its spacing, becomes the next sample.
std::vector<ContactSample> sample_contacts(const TriangleMesh& skin,
                                           const std::function<double(const Vector3&)>& spacing) {
  std::vector<Candidate> all = candidates(skin, spacing);
  if (all.empty()) throw std::invalid_argument("contact points: the skin has no triangles");
  std::vector<ContactSample> samples;
  std::size_t next = 0;
  while (true) {
    const Vector3 position = all[next].position;
    double farthest = 1;
    bool found = false;
    for (std::size_t i = 0; i < all.size(); ++i) {
      Candidate& candidate = all[i];
      const double squared = (candidate.position - position).squaredNorm();
      if (squared < candidate.squared) {
        candidate.squared = squared;
        candidate.nearest = samples.size();
      }
      const double relative = candidate.squared / (candidate.spacing * candidate.spacing);
      if (relative > farthest) {
        farthest = relative;
        next = i;
        found = true;
      }
    }
    samples.push_back({position, 0});
    if (!found) break;
  }
  for (const Candidate& candidate : all) samples[candidate.nearest].area += candidate.area;
  return samples;
}

}  // namespace softhand::builder
