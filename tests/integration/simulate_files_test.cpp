// The files of `softhand simulate`.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "cli/commands.hpp"

namespace softhand::simulate_files_test {
namespace {

namespace fs = std::filesystem;

class SimulateFiles : public ::testing::Test {
 protected:
  SimulateFiles() {
    fs::create_directories(folder_);
    arguments_.scene = write("scene.toml");
    arguments_.json = (folder_ / "out.json").string();
    arguments_.seconds = 0.1;
  }
  ~SimulateFiles() override { fs::remove_all(folder_); }
  std::string write(const std::string& name) const {
    const fs::path path = folder_ / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path) << "[hand]\nmodel = \"" SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json\"\n";
    return path.string();
  }
  fs::path folder_ = fs::temp_directory_path() / ("softhand_simulate_files_" + std::to_string(getpid()));
  SimulateArguments arguments_;
};

TEST_F(SimulateFiles, ATableOnAFullDiskIsAnError) {
  arguments_.csv = "/dev/full";
  EXPECT_THROW(run_simulate(arguments_), std::runtime_error);
  arguments_.csv = (folder_ / "out.csv").string();
  EXPECT_EQ(run_simulate(arguments_), 0);
  EXPECT_GT(fs::file_size(arguments_.csv), 1000u);
}

TEST_F(SimulateFiles, ASummaryThatCannotBeWrittenIsRefusedBeforeTheRun) {
  arguments_.seconds = 1e9;
  arguments_.json = (folder_ / "missing" / "out.json").string();
  EXPECT_THROW(run_simulate(arguments_), std::runtime_error);
}

// A path is any bytes, here "Gerät" in Latin-1.
TEST_F(SimulateFiles, AScenePathThatIsNotUtf8IsNoError) {
  arguments_.scene = write("Ger\xe4t/scene.toml");
  EXPECT_EQ(run_simulate(arguments_), 0);
  std::ifstream in(arguments_.json);
  EXPECT_TRUE(nlohmann::json::parse(in)["scene"].get<std::string>().ends_with("Ger\ufffdt/scene.toml"));
}

}  // namespace
}  // namespace softhand::simulate_files_test
