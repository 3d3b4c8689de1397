// Checks of what a term carries from one step to the next (energies/memory.hpp).
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <vector>

#include "energies/dense_step.hpp"
#include "energies/memory.hpp"

namespace softhand::testing {

inline std::vector<std::byte> bytes_of(const Energy& term) {
  std::vector<std::byte> bytes(1 << 20);
  ByteWriter out(bytes);
  term.save_memory(out);
  EXPECT_FALSE(out.overflowed());
  bytes.resize(out.size());
  return bytes;
}

/// Steps with `step(state)`, goes back to the saved memory and state, begins a step that does not end, and steps again.
/// The second run must have the bits of the first. `step` must use `term`.
template <typename Step>
void check_memory(Energy& term, State& state, Step&& step) {
  for (int i = 0; i < 3; ++i) step(state);
  const State saved = state;
  const std::vector<std::byte> memory = bytes_of(term);
  ASSERT_FALSE(memory.empty());
  for (int i = 0; i < 5; ++i) step(state);
  const State expected = state;
  const std::vector<std::byte> after = bytes_of(term);
  EXPECT_NE(memory, after) << "nothing is carried: this test shows nothing";
  for (const bool cancels : {false, true}) {
    ByteReader in(memory);
    term.load_memory(in);
    EXPECT_TRUE(in.rest().empty());
    EXPECT_EQ(bytes_of(term), memory);
    state = saved;
    State elsewhere = perturbed(saved, 4, 0.01, 0.5);
    term.begin_step(elsewhere, 0.3);
    if (cancels) term.cancel_step();
    EXPECT_EQ(bytes_of(term), memory) << "a step that did not end changed the memory";
    for (int i = 0; i < 5; ++i) step(state);
    EXPECT_EQ(bytes_of(term), after);
    EXPECT_EQ((state.node_positions - expected.node_positions).cwiseAbs().maxCoeff(), 0);
    EXPECT_EQ((state.node_velocities - expected.node_velocities).cwiseAbs().maxCoeff(), 0);
    for (std::size_t b = 0; b < state.body_poses.size(); ++b) {
      EXPECT_EQ(state.body_poses[b].position, expected.body_poses[b].position);
      EXPECT_EQ(state.body_poses[b].orientation.coeffs(), expected.body_poses[b].orientation.coeffs());
    }
  }
  std::vector<std::byte> shorter = memory;
  shorter.pop_back();
  ByteReader in(shorter);
  EXPECT_THROW(term.load_memory(in), std::runtime_error);
}

}  // namespace softhand::testing
