// The example of docs/add-an-energy.md is complete, and the page shows it as it is.
#include "energies/leash.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>

#include "energies/dense_step.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"

namespace softhand {
namespace {

std::string text_of(const std::string& file) {
  std::ifstream in(SOFTHAND_SOURCE_DIR "/" + file);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(AddAnEnergy, DerivativesOfTheExample) {
  Leash leash(0, 300, 0.01);
  const State state = testing::random_state({1, 1}, 1);
  testing::check_term(leash, state, 0.01, testing::perturbed(state, 2, 0.02, 0.1));
}

TEST(AddAnEnergy, MemoryOfTheExampleRepeatsTheBits) {
  Leash leash(0, 300, 0.001);
  Inertia inertia({0.1}, 0);
  State state = testing::random_state({1, 0}, 1);
  state.node_velocities.col(0) = Vector3(1, 0.5, 0);
  testing::DenseStepper stepper({&inertia, &leash}, state);
  testing::check_memory(leash, state, [&](State& s) { stepper.step(s, 0.01); });
}

TEST(AddAnEnergy, PageShowsTheExample) {
  const std::string example = text_of("tests/energies/leash.hpp"), page = text_of("docs/add-an-energy.md");
  ASSERT_FALSE(example.empty());
  EXPECT_NE(page.find("```cpp\n" + example + "```"), std::string::npos);
}

// One line registers a term. No other code of the scene asks a term for its memory by name.
TEST(AddAnEnergy, SceneAsksEveryTermForItsMemory) {
  const std::string scene = text_of("common/scene/hand_simulation.cpp") + text_of("common/scene/hand_memory.cpp");
  for (const char* call : {"save_memory(out)", "load_memory(in)", "reset_memory()", "cancel_step()"})
    EXPECT_NE(scene.find(std::string("for (const auto& term : terms_) term->") + call), std::string::npos) << call;
  const std::regex by_name("(contacts_|planes_|joints_|coupling_)->(save|load|cancel_step)\\(");
  EXPECT_FALSE(std::regex_search(scene, by_name));
}

}  // namespace
}  // namespace softhand
