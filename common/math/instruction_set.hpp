// Detects the vector instructions of this processor. Programs are built for the baseline of their architecture. A
// kernel that gains from wider vectors is one source, compiled once per instruction set and selected here at run time.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace softhand {

/// In ascending order of vector width: 2, 4 and 8 doubles. `baseline` is the target of the program's build (SSE2 on
/// x86-64).
enum class InstructionSet : std::uint8_t { baseline, avx2, avx512 };

inline constexpr std::array kInstructionSets{InstructionSet::baseline, InstructionSet::avx2, InstructionSet::avx512};

std::string_view to_string(InstructionSet set);

/// True if the processor and the operating system support the set. `avx512` means F, DQ and VL.
bool is_supported(InstructionSet set);

/// The widest supported set.
InstructionSet widest_instruction_set();

}  // namespace softhand
