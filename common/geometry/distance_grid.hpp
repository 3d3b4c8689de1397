// Signed distance on a sparse grid: what the contact asks about a shape that is not convex.
//
// The grid has two levels. A coarse lattice covers the box of the surface and a margin. Its cells are blocks of 4^3
// fine cells. Blocks that the surface passes, and their neighbours, also have fine samples. Both levels are
// triquadratic B-splines, so distance and gradient are continuous. In a block next to one without fine samples the two
// levels are blended with smoothstep weights, so they are continuous there too.
//
// The coefficients are c = d - (1/8) (sum of second differences of d). With them a quadratic B-spline reproduces cubic
// polynomials (quasi-interpolation; de Boor and Fix 1973). So the error is of third order in the spacing away from
// edges, corners and medial surfaces, and of first order there.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "geometry/shape.hpp"

namespace softhand {

class DistanceGrid {
 public:
  static constexpr std::size_t most_samples = 64'000'000;

  /// Signed distance in m of a point in m, negative inside.
  using Exact = std::function<double(const Vector3&)>;
  /// `low` and `high` are the corners of the surface's bounding box, m. `spacing` is the edge of a fine cell, m. Throws
  /// std::invalid_argument if the spacing is not finite or not > 0, or if the fine lattice over the whole box would
  /// have more than `most_samples` samples.
  DistanceGrid(const Exact& exact, const Vector3& low, const Vector3& high, double spacing);
  /// The mesh is closed and outward.
  DistanceGrid(const TriangleMesh& mesh, double spacing);

  struct Sample {
    double distance = 0;                 ///< m, negative inside
    Vector3 gradient = Vector3::Zero();  ///< of `distance`; its length is about 1 except near edges and medial surfaces
  };
  /// Distance and gradient are continuous inside the lattice, which reaches two blocks beyond the surface. Outside it
  /// the distance is a continuous lower bound, and the gradient is a unit vector.
  Sample sample(const Vector3& point) const;
  /// `point` is point - distance * normal of the sample. It is on the surface but for the error of the grid.
  SurfacePoint closest(const Vector3& point) const;
  /// Steps along the segment by the distance over the Lipschitz constant, then finds the root (regula falsi). A path
  /// that is inside for less than 1/50 of a cell can be missed. A path that starts inside gives nothing.
  std::optional<Crossing> first_crossing(const Vector3& from, const Vector3& to) const;

  double spacing() const { return spacing_; }
  double lipschitz() const { return lipschitz_; }             ///< bound on the length of the gradient
  std::size_t block_count() const { return fine_.size(); }    ///< with fine samples
  std::size_t cell_blocks() const { return blocks_.size(); }  ///< of the whole box
  std::size_t bytes() const;

 private:
  static constexpr int kBlock = 4;           // fine cells along an edge of a block
  static constexpr int kWidth = kBlock + 2;  // coefficients along an edge of a block
  using FineBlock = std::array<float, kWidth * kWidth * kWidth>;

  void build(const Exact& exact, const Vector3& low, const Vector3& high, double spacing);
  Sample inside_box(const Vector3& local) const;

  double spacing_ = 0;
  double lipschitz_ = 1;
  Vector3 origin_ = Vector3::Zero();   // corner of the lattice
  std::array<int, 3> cells_{};         // blocks along each axis
  std::vector<float> coarse_;          // coefficients at the centres of blocks, with a border of one block
  std::vector<std::int32_t> blocks_;   // per block: index in fine_, or -1
  std::vector<std::uint8_t> corners_;  // per block: bit per corner whose eight blocks all have fine samples
  std::vector<FineBlock> fine_;
  Vector3 low_ = Vector3::Zero(), high_ = Vector3::Zero();  // bounding box of the surface
};

}  // namespace softhand
