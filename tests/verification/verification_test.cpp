// Tests every known answer with the rows of `softhand report verify --quick`.
#include "verification/verification.hpp"

#include <gtest/gtest.h>

#include <set>

namespace softhand::verification {
namespace {

class KnownAnswer : public ::testing::TestWithParam<Case> {};

TEST_P(KnownAnswer, MatchesReference) {
  for (const Row& row : run(GetParam(), true)) {
    std::string parameters;
    for (const auto& [key, value] : row.parameters.values()) parameters += " " + key + "=" + std::to_string(value);
    const Measurement& m = row.measurement;
    if (!row.known_failure.empty()) {
      EXPECT_FALSE(row.passed()) << m.quantity << parameters
                                 << ": passes now; remove it from the case's known failures";
      std::printf("  known failure: %s%s: %.9g, expected %.9g: %s\n", m.quantity.c_str(), parameters.c_str(), m.value,
                  m.reference, row.known_failure.c_str());
      continue;
    }
    EXPECT_TRUE(row.passed()) << m.quantity << ':' << parameters << "\n  is " << m.value << ", expected " << m.reference
                              << " +- " << m.tolerance << ' ' << m.unit
                              << (m.order ? "; order " + std::to_string(m.order->observed) : "") << ' ' << row.error;
  }
}

INSTANTIATE_TEST_SUITE_P(All, KnownAnswer, ::testing::ValuesIn(all_cases()),
                         [](const auto& parameter) { return parameter.param.name; });

TEST(Cases, HaveUniqueNamesAndTables) {
  std::set<std::string> names;
  for (const Case& which : all_cases()) {
    EXPECT_TRUE(names.insert(which.name).second) << which.name;
    EXPECT_FALSE(which.table.empty()) << which.name;
    EXPECT_FALSE(which.statement.empty()) << which.name;
  }
}

TEST(Rows, FailOnWrongValueWrongOrderNanOrException) {
  Row row;
  row.measurement = {"q", 1.0, 1.1, 0.2, "m", {}};
  EXPECT_TRUE(row.passed());
  row.measurement.order = Order{1.2, 1, 0.1};
  EXPECT_FALSE(row.passed());
  row.measurement.order = Order{std::nan(""), 1, 0.1};
  EXPECT_FALSE(row.passed());
  row.measurement.order.reset();
  row.measurement.value = std::nan("");
  EXPECT_FALSE(row.passed());
  row.measurement.value = 1.4;
  EXPECT_FALSE(row.passed());
  const Case throws{
      "x", "y", {Parameters{}}, [](const Parameters&) -> std::vector<Measurement> { throw std::runtime_error("z"); }};
  ASSERT_EQ(run(throws, false).size(), 1u);
  EXPECT_FALSE(run(throws, false).front().passed());
  EXPECT_EQ(run(throws, false).front().error, "z");
}

}  // namespace
}  // namespace softhand::verification
