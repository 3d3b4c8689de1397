// Reports about modules with other definitions of our types.
#include <gtest/gtest.h>

#include <string>

#include "bus/definitions.hpp"

namespace softhand::bus::detail {
namespace {

constexpr std::uint64_t kHash = 1, kOtherHash = 2;

Endpoint endpoint(const std::string& module, std::uint64_t hash) { return {"topic", "type", module, hash, 1}; }

class DefinitionsTest : public ::testing::Test {
 protected:
  DefinitionsTest() { definitions_.add_own(endpoint("own", kHash)); }
  // Whether an endpoint of the module with another definition is reported when it appears.
  bool is_reported(const std::string& module) {
    ::testing::internal::CaptureStderr();
    definitions_.add(endpoint(module, kOtherHash));
    return ::testing::internal::GetCapturedStderr().find("module " + module + " has another") != std::string::npos;
  }
  Definitions definitions_{"own"};
};

TEST_F(DefinitionsTest, AModuleIsReportedOnceUntilItsLastEndpointLeft) {
  EXPECT_TRUE(is_reported("other"));
  EXPECT_FALSE(is_reported("other"));
  definitions_.remove(endpoint("other", kOtherHash));
  EXPECT_FALSE(is_reported("other"));
  definitions_.remove(endpoint("other", kOtherHash));
  definitions_.remove(endpoint("other", kOtherHash));
  EXPECT_TRUE(is_reported("other"));
}

TEST_F(DefinitionsTest, ModulesAreReportedAfterManyEndpointsLeft) {
  for (int i = 0; i < 5000; ++i) {
    definitions_.add(endpoint("module " + std::to_string(i), kHash));
    definitions_.remove(endpoint("module " + std::to_string(i), kHash));
  }
  EXPECT_TRUE(is_reported("other"));
  EXPECT_FALSE(is_reported("other"));
}

TEST_F(DefinitionsTest, ModulesAreReportedBesideManyEndpoints) {
  for (int i = 0; i < 5000; ++i) definitions_.add(endpoint("module " + std::to_string(i), kHash));
  EXPECT_TRUE(is_reported("other"));
}

}  // namespace
}  // namespace softhand::bus::detail
