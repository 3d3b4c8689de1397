// The point of a triangle that is nearest to a given point.
#pragma once

#include "math/types.hpp"

namespace softhand {

struct TrianglePoint {
  Vector3 point;
  int feature = 0;  ///< 0-2 = a corner, 3-5 = the edge that starts there, 6 = the inside
  Vector3 weights;  ///< of the corners, >= 0, sum 1
};

/// Ericson, Real-Time Collision Detection, 5.1.5.
inline TrianglePoint nearest_on_triangle(const Vector3& p, const Vector3& a, const Vector3& b, const Vector3& c) {
  const Vector3 ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap), d3 = ab.dot(bp), d4 = ac.dot(bp), d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d1 <= 0 && d2 <= 0) return {a, 0, Vector3(1, 0, 0)};
  if (d3 >= 0 && d4 <= d3) return {b, 1, Vector3(0, 1, 0)};
  if (d6 >= 0 && d5 <= d6) return {c, 2, Vector3(0, 0, 1)};
  const double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) {
    const double t = d1 / (d1 - d3);
    return {a + t * ab, 3, Vector3(1 - t, t, 0)};
  }
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    const double t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return {b + t * (c - b), 4, Vector3(0, 1 - t, t)};
  }
  if (vb <= 0 && d2 >= 0 && d6 <= 0) {
    const double t = d2 / (d2 - d6);
    return {a + t * ac, 5, Vector3(1 - t, 0, t)};
  }
  const double sum = va + vb + vc;
  return {a + (vb * ab + vc * ac) / sum, 6, Vector3(va, vb, vc) / sum};
}

}  // namespace softhand
