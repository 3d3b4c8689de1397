// Indices of nodes, blocks and triangles are 32 bits wide with a sign; those of the standard library have none.
#pragma once

#include <cstddef>
#include <cstdint>

namespace softhand {

/// The same index for a container of the standard library. `i` is not negative.
constexpr std::size_t at(std::int32_t i) { return static_cast<std::size_t>(i); }

}  // namespace softhand
