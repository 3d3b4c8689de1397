#include "geometry/distance_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "geometry/mesh_distance.hpp"

namespace softhand {
namespace {

// Blocks between the bounding box of the surface and the border of the lattice.
constexpr int kMargin = 2;
// Shortest step along a path, as a part of a cell.
constexpr double kShortestStep = 0.02;
// Factor on the largest gradient that was sampled.
constexpr double kLipschitzMargin = 1.1;

// Value and gradient (per cell) of a triquadratic B-spline on one cell. `at` is the place in the cell, 0 to 1.
// `coefficients` is the first of 3^3 coefficients, at the centres of the cell and its neighbours.
void spline(const float* coefficients, std::size_t row, std::size_t layer, const Vector3& at, double& value,
            Vector3& gradient) {
  std::array<double, 9> w, dw;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double t = at[static_cast<Eigen::Index>(axis)];
    w[3 * axis] = 0.5 * (1 - t) * (1 - t);
    w[3 * axis + 1] = 0.5 + t * (1 - t);
    w[3 * axis + 2] = 0.5 * t * t;
    dw[3 * axis] = t - 1;
    dw[3 * axis + 1] = 1 - 2 * t;
    dw[3 * axis + 2] = t;
  }
  value = 0;
  gradient.setZero();
  for (std::size_t z = 0; z < 3; ++z) {
    double plane = 0, plane_x = 0, plane_y = 0;
    for (std::size_t y = 0; y < 3; ++y) {
      const float* c = coefficients + z * layer + y * row;
      const double c0 = static_cast<double>(c[0]), c1 = static_cast<double>(c[1]), c2 = static_cast<double>(c[2]);
      const double line = w[0] * c0 + w[1] * c1 + w[2] * c2;
      plane += w[3 + y] * line;
      plane_x += w[3 + y] * (dw[0] * c0 + dw[1] * c1 + dw[2] * c2);
      plane_y += dw[3 + y] * line;
    }
    value += w[6 + z] * plane;
    gradient += Vector3(w[6 + z] * plane_x, w[6 + z] * plane_y, dw[6 + z] * plane);
  }
}

double smoothstep(double t) { return t * t * (3 - 2 * t); }

std::size_t size_of(int n) { return static_cast<std::size_t>(n); }

// A lattice of samples that are computed when first asked for.
class Samples {
 public:
  Samples(const DistanceGrid::Exact& exact, const Vector3& first, double spacing, const std::array<int, 3>& count)
      : exact_(exact),
        first_(first),
        spacing_(spacing),
        count_(count),
        values_(size_of(count[0]) * size_of(count[1]) * size_of(count[2]), std::numeric_limits<float>::quiet_NaN()) {}

  double at(int x, int y, int z) {
    float& value = values_[(size_of(z) * size_of(count_[1]) + size_of(y)) * size_of(count_[0]) + size_of(x)];
    if (std::isnan(value)) value = static_cast<float>(exact_(first_ + spacing_ * Vector3(x, y, z)));
    return static_cast<double>(value);
  }
  // Coefficient of the quasi-interpolant. The sample must have six neighbours.
  float coefficient(int x, int y, int z) {
    const double centre = at(x, y, z);
    const double around =
        at(x - 1, y, z) + at(x + 1, y, z) + at(x, y - 1, z) + at(x, y + 1, z) + at(x, y, z - 1) + at(x, y, z + 1);
    return static_cast<float>(centre - (around - 6 * centre) / 8);
  }

 private:
  const DistanceGrid::Exact& exact_;
  Vector3 first_;
  double spacing_;
  std::array<int, 3> count_;
  std::vector<float> values_;
};

}  // namespace

DistanceGrid::DistanceGrid(const Exact& exact, const Vector3& low, const Vector3& high, double spacing) {
  build(exact, low, high, spacing);
}

DistanceGrid::DistanceGrid(const TriangleMesh& mesh, double spacing) {
  const MeshDistance distance(mesh);
  std::size_t hint = 0;  // samples that follow each other are near each other
  build(
      [&](const Vector3& p) {
        const MeshDistance::Nearest nearest = distance.nearest(p, hint);
        hint = nearest.triangle;
        return nearest.distance;
      },
      distance.low(), distance.high(), spacing);
}

void DistanceGrid::build(const Exact& exact, const Vector3& low, const Vector3& high, double spacing) {
  if (!(std::isfinite(spacing) && spacing > 0)) {
    throw std::invalid_argument("shape: spacing of the distance grid is " + std::to_string(spacing) +
                                " m, expected a finite number > 0");
  }
  spacing_ = spacing;
  low_ = low;
  high_ = high;
  const double block = kBlock * spacing;
  double samples = 1;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const double count = std::ceil((high - low)[axis] / block) + 2 * kMargin;
    samples *= count * kBlock + 4;
    if (!(samples <= static_cast<double>(most_samples))) {
      throw std::invalid_argument("shape: a distance grid with cells of " + std::to_string(spacing) +
                                  " m has more than " + std::to_string(most_samples) +
                                  " samples; expected larger cells or a smaller object");
    }
    cells_[static_cast<std::size_t>(axis)] = static_cast<int>(count);
    origin_[axis] = 0.5 * (low + high)[axis] - 0.5 * count * block;
  }
  const auto [nx, ny, nz] = cells_;

  // Samples of both levels are at the centres of cells. The border is what coefficients and their neighbours need.
  Samples coarse(exact, origin_ - Vector3::Constant(1.5 * block), block, {nx + 4, ny + 4, nz + 4});
  coarse_.reserve(size_of(nx + 2) * size_of(ny + 2) * size_of(nz + 2));
  for (int z = 1; z < nz + 3; ++z)
    for (int y = 1; y < ny + 3; ++y)
      for (int x = 1; x < nx + 3; ++x) coarse_.push_back(coarse.coefficient(x, y, z));

  // Blocks that the surface can pass, and their neighbours.
  const auto number = [&](int x, int y, int z) {
    return (size_of(z) * size_of(ny) + size_of(y)) * size_of(nx) + size_of(x);
  };
  blocks_.assign(size_of(nx) * size_of(ny) * size_of(nz), -1);
  const double reach = 0.5 * std::sqrt(3.0) * block + 0.5 * spacing;
  const auto for_each_block = [&](const auto& visit) {
    for (int z = 0; z < nz; ++z)
      for (int y = 0; y < ny; ++y)
        for (int x = 0; x < nx; ++x) visit(x, y, z);
  };
  for_each_block([&](int x, int y, int z) {
    if (std::abs(coarse.at(x + 2, y + 2, z + 2)) > reach) return;
    for (int k = std::max(0, z - 1); k <= std::min(nz - 1, z + 1); ++k)
      for (int j = std::max(0, y - 1); j <= std::min(ny - 1, y + 1); ++j)
        for (int i = std::max(0, x - 1); i <= std::min(nx - 1, x + 1); ++i) blocks_[number(i, j, k)] = 0;
  });

  Samples fine(exact, origin_ - Vector3::Constant(1.5 * spacing), spacing,
               {kBlock * nx + 4, kBlock * ny + 4, kBlock * nz + 4});
  corners_.assign(blocks_.size(), 0);
  for_each_block([&](int x, int y, int z) {
    std::int32_t& index = blocks_[number(x, y, z)];
    if (index < 0) return;
    index = static_cast<std::int32_t>(fine_.size());
    FineBlock& values = fine_.emplace_back();
    auto value = values.begin();
    for (int k = 0; k < kWidth; ++k)
      for (int j = 0; j < kWidth; ++j)
        for (int i = 0; i < kWidth; ++i)
          *value++ = fine.coefficient(kBlock * x + i + 1, kBlock * y + j + 1, kBlock * z + k + 1);
  });
  for_each_block([&](int x, int y, int z) {
    if (blocks_[number(x, y, z)] < 0) return;
    for (int corner = 0; corner < 8; ++corner) {
      bool all = true;
      for (int other = 0; other < 8; ++other) {
        const int i = x - 1 + (corner & 1) + (other & 1), j = y - 1 + (corner >> 1 & 1) + (other >> 1 & 1),
                  k = z - 1 + (corner >> 2) + (other >> 2);
        all = all && i >= 0 && j >= 0 && k >= 0 && i < nx && j < ny && k < nz && blocks_[number(i, j, k)] >= 0;
      }
      if (all) corners_[number(x, y, z)] = static_cast<std::uint8_t>(corners_[number(x, y, z)] | 1 << corner);
    }
  });

  // The largest gradient, at one point per fine cell and 8 points per coarse cell. The points move through the cells.
  double steepest = 1;
  int turn = 0;
  for_each_block([&](int x, int y, int z) {
    const int parts = blocks_[number(x, y, z)] < 0 ? 2 : kBlock;
    for (int k = 0; k < parts; ++k)
      for (int j = 0; j < parts; ++j)
        for (int i = 0; i < parts; ++i) {
          const Vector3 place = Vector3(i, j, k) + Vector3(turn % 5, turn % 7 * 5.0 / 7, turn % 11 * 5.0 / 11) / 5;
          ++turn;
          steepest = std::max(steepest, inside_box(block * (Vector3(x, y, z) + place / parts)).gradient.norm());
        }
  });
  lipschitz_ = kLipschitzMargin * steepest;
}

// `local` is relative to the corner of the lattice, and inside the lattice.
DistanceGrid::Sample DistanceGrid::inside_box(const Vector3& local) const {
  const double block = kBlock * spacing_;
  const Vector3 scaled = local / block;
  std::array<int, 3> cell;
  Vector3 at;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double x = scaled[static_cast<Eigen::Index>(axis)];
    cell[axis] = std::clamp(static_cast<int>(x), 0, cells_[axis] - 1);
    at[static_cast<Eigen::Index>(axis)] = x - cell[axis];
  }
  const std::size_t number =
      (size_of(cell[2]) * size_of(cells_[1]) + size_of(cell[1])) * size_of(cells_[0]) + size_of(cell[0]);
  Sample fine;
  const std::int32_t index = blocks_[number];
  if (index >= 0) {
    const Vector3 place = kBlock * at;
    Vector3 in_cell;
    std::array<std::size_t, 3> first;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<Eigen::Index>(axis);
      const int i = std::clamp(static_cast<int>(place[a]), 0, kBlock - 1);
      first[axis] = size_of(i);
      in_cell[a] = place[a] - i;
    }
    spline(fine_[size_of(index)].data() + (first[2] * kWidth + first[1]) * kWidth + first[0], kWidth, kWidth * kWidth,
           in_cell, fine.distance, fine.gradient);
    fine.gradient /= spacing_;
    if (corners_[number] == 0xFF) return fine;
  }
  Sample coarse;
  const std::size_t row = size_of(cells_[0] + 2), layer = row * size_of(cells_[1] + 2);
  spline(coarse_.data() + size_of(cell[2]) * layer + size_of(cell[1]) * row + size_of(cell[0]), row, layer, at,
         coarse.distance, coarse.gradient);
  coarse.gradient /= block;
  if (corners_[number] == 0) return coarse;

  // Weight of the fine level: 1 at corners whose blocks all have fine samples, 0 at others. Smoothstep has zero slope
  // at the faces, so the weight has a continuous gradient.
  double weight = 0;
  Vector3 slope = Vector3::Zero();
  for (int corner = 0; corner < 8; ++corner) {
    if ((corners_[number] >> corner & 1) == 0) continue;
    Vector3 factor, rate;
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const bool upper = corner >> axis & 1;
      factor[axis] = smoothstep(upper ? at[axis] : 1 - at[axis]);
      rate[axis] = (upper ? 6 : -6) * at[axis] * (1 - at[axis]);
    }
    weight += factor.prod();
    slope += Vector3(rate.x() * factor.y() * factor.z(), factor.x() * rate.y() * factor.z(),
                     factor.x() * factor.y() * rate.z());
  }
  const double gain = fine.distance - coarse.distance;
  return {coarse.distance + weight * gain,
          coarse.gradient + weight * (fine.gradient - coarse.gradient) + gain / block * slope};
}

DistanceGrid::Sample DistanceGrid::sample(const Vector3& point) const {
  const Vector3 local = point - origin_;
  const Vector3 size = kBlock * spacing_ * Vector3(cells_[0], cells_[1], cells_[2]);
  const Vector3 inside = local.cwiseMax(0).cwiseMin(size);
  const Sample there = inside_box(inside);
  const Vector3 outside = local - inside;
  const double away = outside.norm();
  if (away == 0) return there;
  // The distance is at least that of the lattice's nearest point minus the way to it, and that to the bounding box.
  // Half a cell is more than the error of the grid, so the second bound does not exceed the first at the border.
  const double box = (low_ - point).cwiseMax(point - high_).cwiseMax(0).norm() - 0.5 * spacing_;
  const Vector3 foot = origin_ + inside - there.distance * there.gradient.normalized();
  return {std::max(there.distance - lipschitz_ * away, box), (point - foot).normalized()};
}

SurfacePoint DistanceGrid::closest(const Vector3& point) const {
  const Sample here = sample(point);
  const double slope = here.gradient.norm();
  // At a medial surface the gradient can vanish.
  const Vector3 normal = slope > 1e-9 ? Vector3(here.gradient / slope) : Vector3::UnitY();
  return {here.distance, point - here.distance * normal, normal};
}

std::optional<Crossing> DistanceGrid::first_crossing(const Vector3& from, const Vector3& to) const {
  const Vector3 direction = to - from;
  const double length = direction.norm();
  double outside = 0, height = sample(from).distance;
  if (height < 0 || length == 0) return std::nullopt;
  const double shortest = kShortestStep * spacing_;
  for (;;) {
    if (outside >= 1) return std::nullopt;
    const double next = std::min(1.0, outside + std::max(height / lipschitz_, shortest) / length);
    const double depth = sample(from + next * direction).distance;
    if (depth < 0) {
      // Regula falsi, Illinois variant: `inside` and `outside` always enclose the root.
      double inside = next, below = depth, above = height;
      for (int i = 0; i < 60 && (inside - outside) * length > 1e-12 && above > 0; ++i) {
        const double middle = std::clamp(outside + (inside - outside) * above / (above - below), outside, inside);
        const double value = sample(from + middle * direction).distance;
        if (value < 0) {
          inside = middle;
          below = value;
          above *= 0.5;
        } else {
          outside = middle;
          if (value <= 1e-13) break;
          above = value;
          below *= 0.5;
        }
      }
      const Vector3 point = from + outside * direction;
      const Vector3 gradient = sample(point).gradient;
      const double slope = gradient.norm();
      return Crossing{point, slope > 1e-9 ? Vector3(gradient / slope) : Vector3(-direction / length), outside};
    }
    outside = next;
    height = depth;
  }
}

std::size_t DistanceGrid::bytes() const {
  return coarse_.size() * sizeof(float) + blocks_.size() * (sizeof(std::int32_t) + 1) +
         fine_.size() * sizeof(FineBlock);
}

}  // namespace softhand
