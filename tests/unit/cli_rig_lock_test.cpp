// The lock that lets one rig of a user hold a domain.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>

#include "cli/rig_lock.hpp"

namespace softhand::cli_rig_lock_test {
namespace {

namespace fs = std::filesystem;

class Lock : public ::testing::Test {
 protected:
  Lock() {
    fs::create_directories(folder_);
    setenv("XDG_RUNTIME_DIR", folder_.c_str(), 1);
  }
  ~Lock() override { fs::remove_all(folder_); }
  fs::path folder_ = fs::temp_directory_path() / ("softhand_lock_test_" + std::to_string(getpid()));
};

TEST_F(Lock, ASecondOneIsToldWhoHoldsIt) {
  std::optional<RigLock> first(3);
  RigLock second(3), elsewhere(4);
  EXPECT_FALSE(first->take({"a rig with spaces", "host", 12}));
  EXPECT_FALSE(first->take({"a rig with spaces", "host", 12})) << "it has the lock";
  const auto holder = second.take({"second", "host", 13});
  ASSERT_TRUE(holder);
  EXPECT_EQ(to_text(*holder), "rig a rig with spaces (process 12 on host)");
  EXPECT_FALSE(elsewhere.take({"other", "host", 14})) << "another domain";
  first.reset();
  EXPECT_FALSE(second.take({"second", "host", 13}));
  EXPECT_EQ(RigLock(3).take({"third", "host", 15})->rig, "second") << "a shorter text replaces the former one";
}

// As in a container, or with sudo.
TEST_F(Lock, AMissingRuntimeFolderIsNoError) {
  setenv("XDG_RUNTIME_DIR", (folder_ / "missing").c_str(), 1);
  const int domain = 100000 + getpid();  // in a folder that other programs use
  RigLock first(domain), second(domain);
  EXPECT_FALSE(first.take({"first", "host", 12}));
  EXPECT_TRUE(second.take({"second", "host", 13}));
  fs::remove("/tmp/softhand-" + std::to_string(getuid()) + "/rig-" + std::to_string(domain) + ".lock");
}

TEST_F(Lock, AFolderThatIsAFileIsRefused) {
  std::FILE* file = std::fopen((folder_ / "softhand").c_str(), "w");
  ASSERT_NE(file, nullptr);
  std::fclose(file);
  EXPECT_THROW(RigLock(3), std::runtime_error);
}

TEST_F(Lock, ALinkInPlaceOfTheFileIsRefused) {
  fs::create_directories(folder_ / "softhand");
  fs::create_symlink(folder_ / "elsewhere", folder_ / "softhand" / "rig-3.lock");
  EXPECT_THROW(RigLock(3), std::runtime_error);
  EXPECT_FALSE(fs::exists(folder_ / "elsewhere"));
}

TEST_F(Lock, ThisProcessHasANameAHostAndANumber) {
  const RigHolder self = this_process("demo");
  EXPECT_EQ(self.rig, "demo");
  EXPECT_EQ(self.process_id, getpid());
  EXPECT_FALSE(self.host.empty());
}

}  // namespace
}  // namespace softhand::cli_rig_lock_test
