#include "math/instruction_set.hpp"

#include <cstddef>

namespace softhand {

std::string_view to_string(InstructionSet set) {
  constexpr std::array<std::string_view, 3> names{"baseline", "AVX2", "AVX-512"};
  return names[static_cast<std::size_t>(set)];
}

bool is_supported(InstructionSet set) {
  if (set == InstructionSet::baseline) return true;
#if defined(__x86_64__)
  if (set == InstructionSet::avx2) return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
#else
  return false;
#endif
}

InstructionSet widest_instruction_set() {
  InstructionSet widest = InstructionSet::baseline;
  for (const InstructionSet set : kInstructionSets) widest = is_supported(set) ? set : widest;
  return widest;
}

}  // namespace softhand
