// Calls a function with each member of an aggregate, in the order of declaration. So a new member of a struct cannot be
// forgotten by code that writes, reads or hashes the struct. C++20 has no reflection: the number of members is found by
// trial, and structured bindings give access to them.
#pragma once

#include <cstddef>
#include <type_traits>

namespace softhand {
namespace members_detail {

/// Converts to anything, in unevaluated code only.
struct Anything {
  template <typename T>
  constexpr operator T() const noexcept;
};

template <typename T, typename... Found>
consteval std::size_t count() {
  if constexpr (requires { T{Found{}..., Anything{}}; }) {
    return count<T, Found..., Anything>();
  } else {
    return sizeof...(Found);
  }
}

}  // namespace members_detail

inline constexpr std::size_t kMostMembers = 36;

/// Number of members of the aggregate T. T has no base classes and no members that are C arrays.
template <typename T>
inline constexpr std::size_t member_count = members_detail::count<std::remove_cv_t<T>>();

// clang-format off
/// Calls visit(member) for each member of `value`.
template <typename T, typename Visit>
constexpr void for_each_member(T& value, Visit&& visit) {
  constexpr std::size_t n = member_count<T>;
  static_assert(std::is_aggregate_v<std::remove_cv_t<T>>, "only aggregates have members that can be visited");
  static_assert(n >= 1 && n <= kMostMembers, "the aggregate has too many members");
  if constexpr (n == 1) {
    auto& [m0] = value; visit(m0);
  } else if constexpr (n == 2) {
    auto& [m0, m1] = value; visit(m0); visit(m1);
  } else if constexpr (n == 3) {
    auto& [m0, m1, m2] = value; visit(m0); visit(m1); visit(m2);
  } else if constexpr (n == 4) {
    auto& [m0, m1, m2, m3] = value; visit(m0); visit(m1); visit(m2); visit(m3);
  } else if constexpr (n == 5) {
    auto& [m0, m1, m2, m3, m4] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4);
  } else if constexpr (n == 6) {
    auto& [m0, m1, m2, m3, m4, m5] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5);
  } else if constexpr (n == 7) {
    auto& [m0, m1, m2, m3, m4, m5, m6] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5);
    visit(m6);
  } else if constexpr (n == 8) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5);
    visit(m6); visit(m7);
  } else if constexpr (n == 9) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4);
    visit(m5); visit(m6); visit(m7); visit(m8);
  } else if constexpr (n == 10) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4);
    visit(m5); visit(m6); visit(m7); visit(m8); visit(m9);
  } else if constexpr (n == 11) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10] = value; visit(m0); visit(m1); visit(m2); visit(m3);
    visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10);
  } else if constexpr (n == 12) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11] = value; visit(m0); visit(m1); visit(m2); visit(m3);
    visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11);
  } else if constexpr (n == 13) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12] = value; visit(m0); visit(m1); visit(m2); visit(m3);
    visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12);
  } else if constexpr (n == 14) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13] = value; visit(m0); visit(m1); visit(m2);
    visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12);
    visit(m13);
  } else if constexpr (n == 15) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14] = value; visit(m0); visit(m1); visit(m2);
    visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12);
    visit(m13); visit(m14);
  } else if constexpr (n == 16) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15] = value; visit(m0); visit(m1);
    visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11);
    visit(m12); visit(m13); visit(m14); visit(m15);
  } else if constexpr (n == 17) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16] = value; visit(m0); visit(m1);
    visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11);
    visit(m12); visit(m13); visit(m14); visit(m15); visit(m16);
  } else if constexpr (n == 18) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17] = value; visit(m0);
    visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10);
    visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16); visit(m17);
  } else if constexpr (n == 19) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18] = value; visit(m0);
    visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10);
    visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16); visit(m17); visit(m18);
  } else if constexpr (n == 20) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19] = value;
    visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9);
    visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16); visit(m17); visit(m18);
    visit(m19);
  } else if constexpr (n == 21) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20] = value;
    visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9);
    visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16); visit(m17); visit(m18);
    visit(m19); visit(m20);
  } else if constexpr (n == 22) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21] =
    value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8);
    visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16); visit(m17);
    visit(m18); visit(m19); visit(m20); visit(m21);
  } else if constexpr (n == 23) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22] =
    value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8);
    visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16); visit(m17);
    visit(m18); visit(m19); visit(m20); visit(m21); visit(m22);
  } else if constexpr (n == 24) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8);
    visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16); visit(m17);
    visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23);
  } else if constexpr (n == 25) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7);
    visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16);
    visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23); visit(m24);
  } else if constexpr (n == 26) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6); visit(m7);
    visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15); visit(m16);
    visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23); visit(m24); visit(m25);
  } else if constexpr (n == 27) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6);
    visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15);
    visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23); visit(m24);
    visit(m25); visit(m26);
  } else if constexpr (n == 28) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5); visit(m6);
    visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14); visit(m15);
    visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23); visit(m24);
    visit(m25); visit(m26); visit(m27);
  } else if constexpr (n == 29) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5);
    visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14);
    visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23);
    visit(m24); visit(m25); visit(m26); visit(m27); visit(m28);
  } else if constexpr (n == 30) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28, m29] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5);
    visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14);
    visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23);
    visit(m24); visit(m25); visit(m26); visit(m27); visit(m28); visit(m29);
  } else if constexpr (n == 31) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28, m29, m30] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4); visit(m5);
    visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14);
    visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23);
    visit(m24); visit(m25); visit(m26); visit(m27); visit(m28); visit(m29); visit(m30);
  } else if constexpr (n == 32) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28, m29, m30, m31] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4);
    visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14);
    visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23);
    visit(m24); visit(m25); visit(m26); visit(m27); visit(m28); visit(m29); visit(m30); visit(m31);
  } else if constexpr (n == 33) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28, m29, m30, m31, m32] = value; visit(m0); visit(m1); visit(m2); visit(m3); visit(m4);
    visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13); visit(m14);
    visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22); visit(m23);
    visit(m24); visit(m25); visit(m26); visit(m27); visit(m28); visit(m29); visit(m30); visit(m31); visit(m32);
  } else if constexpr (n == 34) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28, m29, m30, m31, m32, m33] = value; visit(m0); visit(m1); visit(m2); visit(m3);
    visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13);
    visit(m14); visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22);
    visit(m23); visit(m24); visit(m25); visit(m26); visit(m27); visit(m28); visit(m29); visit(m30); visit(m31);
    visit(m32); visit(m33);
  } else if constexpr (n == 35) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28, m29, m30, m31, m32, m33, m34] = value; visit(m0); visit(m1); visit(m2); visit(m3);
    visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12); visit(m13);
    visit(m14); visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21); visit(m22);
    visit(m23); visit(m24); visit(m25); visit(m26); visit(m27); visit(m28); visit(m29); visit(m30); visit(m31);
    visit(m32); visit(m33); visit(m34);
  } else if constexpr (n == 36) {
    auto& [m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14, m15, m16, m17, m18, m19, m20, m21, m22,
    m23, m24, m25, m26, m27, m28, m29, m30, m31, m32, m33, m34, m35] = value; visit(m0); visit(m1); visit(m2);
    visit(m3); visit(m4); visit(m5); visit(m6); visit(m7); visit(m8); visit(m9); visit(m10); visit(m11); visit(m12);
    visit(m13); visit(m14); visit(m15); visit(m16); visit(m17); visit(m18); visit(m19); visit(m20); visit(m21);
    visit(m22); visit(m23); visit(m24); visit(m25); visit(m26); visit(m27); visit(m28); visit(m29); visit(m30);
    visit(m31); visit(m32); visit(m33); visit(m34); visit(m35);
  }
}
// clang-format on

}  // namespace softhand
