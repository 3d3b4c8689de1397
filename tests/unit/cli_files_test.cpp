// The command's checks of files (scenes, rigs, hands, the reference page), and its status table of modules.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>

#include "cli/check.hpp"
#include "cli/commands.hpp"
#include "cli/demo.hpp"
#include "cli/idl_text.hpp"
#include "cli/rig.hpp"
#include "cli/status_table.hpp"
#include "device/driver.hpp"
#include "messages/convert.hpp"
#include "runtime/config.hpp"
#include "support/own_domain.hpp"

namespace softhand::cli_files_test {
namespace {

namespace fs = std::filesystem;

const fs::path kSource = SOFTHAND_SOURCE_DIR;
const std::string kShippedHand = "[hand]\nmodel = \"" SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json\"\n";

std::string text_of(const fs::path& path) {
  std::ifstream in(path);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

class FilesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("softhand_cli_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) {
    const fs::path path = folder_ / name;
    std::ofstream(path) << text;
    return path.string();
  }
  // The error that the command would print. Empty if the command finds no error.
  static std::string complaint(const std::string& path) {
    try {
      ::testing::internal::CaptureStdout();
      run_check(path);
      ::testing::internal::GetCapturedStdout();
      return {};
    } catch (const std::exception& error) {
      ::testing::internal::GetCapturedStdout();
      return error.what();
    }
  }
  fs::path folder_;
};

TEST_F(FilesTest, ShippedScenesAreValid) {
  for (const auto& entry : fs::recursive_directory_iterator(kSource / "config/scenes")) {
    if (entry.path().extension() == ".toml") {
      EXPECT_EQ(complaint(entry.path().string()), "") << entry.path();
    }
  }
}

// The programs of a rig are beside `softhand`, not beside this test.
TEST_F(FilesTest, ShippedRigsAreValid) {
  for (const auto& entry : fs::recursive_directory_iterator(kSource / "config/rigs")) {
    if (entry.path().extension() == ".toml") {
      EXPECT_NO_THROW(read_checked_scene(read_rig(entry.path().string()).scene)) << entry.path();
    }
  }
}

TEST_F(FilesTest, RefusesAMisspeltKeyWithFileLineAndTheNearestKey) {
  const std::string path = write("scene.toml", "name = \"x\"\n[hand]\nrate_hs = 90\n");
  const std::string what = complaint(path);
  EXPECT_NE(what.find(path + ":3"), std::string::npos) << what;
  EXPECT_NE(what.find("rate_hz"), std::string::npos) << what;
}

TEST_F(FilesTest, BrokenTomlIsRefusedWithFileAndLine) {
  const std::string path = write("scene.toml", "name = \"x\"\n\n[hand\n");
  EXPECT_NE(complaint(path).find(path + ":3"), std::string::npos) << complaint(path);
}

TEST_F(FilesTest, RefusesAnUnstableWorldAndNamesTheFile) {
  const std::string path = write("scene.toml", "[world]\nfollow_stiffness = 4\n");
  const std::string what = complaint(path);
  EXPECT_NE(what.find(path + ": world.follow_stiffness"), std::string::npos) << what;
}

TEST_F(FilesTest, RefusesOptionsThatTrackingOrHandWouldRefuseAtStart) {
  const std::string mount = "_mount_orientation = [0, 0, 0, 0]\n";
  const std::string unstable = "[tracking]\nstiffness_ratio = 1\nfeedback_ratio = 1\nmass_fraction = 0.9\n";
  const std::pair<std::string, std::string> cases[]{
      {unstable, "tracking: stiffness_ratio"},
      {"[tracking.input]\ndesk" + mount, "tracking.input.desk_mount_orientation"},
      {"[hand.tracked_input]\nheadset" + mount, "hand.tracked_input.headset_mount_orientation"},
  };
  for (const auto& [text, key] : cases) {
    const std::string path = write("scene.toml", kShippedHand + text);
    EXPECT_NE(complaint(path).find(path + ": " + key), std::string::npos) << complaint(path);
  }
  // If the hand runs without the intermediate layer, nobody reads the layer's options.
  EXPECT_EQ(complaint(write("scene.toml", kShippedHand + "direct = true\n" + unstable)), "");
}

TEST_F(FilesTest, ARigMayHaveAFlexibleObject) {
  const std::string scene = (kSource / "config/scenes/sponge.toml").string();
  EXPECT_EQ(complaint(scene), "");
  EXPECT_EQ(complaint(write("rig.toml", "scene = \"" + scene + "\"\nprocess = []\n")), "");
}

TEST_F(FilesTest, ARigStartsInItsOwnFolder) {
  write("scene.toml", kShippedHand);
  write("rig.toml", "scene = \"scene.toml\"\n");
  testing::use_own_domain();
  const fs::path before = fs::current_path();
  fs::current_path(folder_);
  UpArguments arguments;
  arguments.rig = "rig.toml";
  arguments.seconds = 0.01;
  EXPECT_EQ(run_up(arguments), 0);
  fs::current_path(before);
}

// `softhand up ... | tee log`: Ctrl-C ends tee before the supervisor has stopped the devices.
TEST_F(FilesTest, ARigRunsOnWhenNobodyReadsItsOutput) {
  write("scene.toml", kShippedHand);
  UpArguments arguments;
  arguments.rig = write("rig.toml",
                        "scene = \"scene.toml\"\n[[process]]\nname = \"a\"\nprogram = \"/bin/sleep\"\n"
                        "arguments = \"60\"\nready_timeout = 0.01\nlongest_silence = 0\n");
  arguments.seconds = 0.01;
  testing::use_own_domain();
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  close(ends[0]);
  std::fflush(stdout);
  const int before = dup(STDOUT_FILENO);
  dup2(ends[1], STDOUT_FILENO);
  int code = -1;
  EXPECT_NO_THROW(code = run_up(arguments));
  std::fflush(stdout);
  std::clearerr(stdout);
  dup2(before, STDOUT_FILENO);
  close(before);
  close(ends[1]);
  EXPECT_EQ(code, 0);
}

TEST_F(FilesTest, ARigWithAProgramThatCannotStartIsRefused) {
  write("scene.toml", kShippedHand);
  write("text.txt", "no program");
  UpArguments arguments;
  testing::use_own_domain();
  for (const char* program : {"softhand-wrold", "./nothing", "text.txt", "./text.txt", "/tmp", ""}) {
    arguments.rig = write(
        "rig.toml", std::string("scene = \"scene.toml\"\n[[process]]\nname = \"a\"\nprogram = \"") + program + "\"\n");
    EXPECT_NE(complaint(arguments.rig).find("process 'a': program "), std::string::npos) << program;
    EXPECT_THROW(run_up(arguments), ConfigError) << program;
  }
  EXPECT_EQ(complaint(write("rig.toml",
                            "scene = \"scene.toml\"\n[[process]]\nname = \"a\"\nprogram = \"softhand-not-built\"\n"
                            "optional = true\n")),
            "");
}

TEST_F(FilesTest, AProgramWithASlashIsRelativeToItsRigFile) {
  fs::create_directories(folder_ / "bin");
  fs::create_symlink("/bin/true", folder_ / "bin/mine");
  write("scene.toml", kShippedHand);
  const std::string rig =
      write("rig.toml", "scene = \"scene.toml\"\n[[process]]\nname = \"a\"\nprogram = \"bin/mine\"\n");
  EXPECT_EQ(complaint(rig), "");
  EXPECT_EQ(command_of(read_rig(rig).processes[0], "", {}), std::vector{(folder_ / "bin/mine").string()});
}

TEST_F(FilesTest, TheSceneIsReplacedWithinAnArgument) {
  RigProcess process;
  process.program = "/bin/p";
  process.arguments = "{scene} --config={scene} {scene}:{scene} {scen}";
  EXPECT_EQ(command_of(process, "a {scene}", {"x=1"}),
            (std::vector<std::string>{"/bin/p", "a {scene}", "--config=a {scene}", "a {scene}:a {scene}", "{scen}",
                                      "--set", "x=1"}));
}

TEST_F(FilesTest, ASummaryThatCannotBeWrittenIsRefusedBeforeTheStart) {
  write("scene.toml", kShippedHand);
  const fs::path started = folder_ / "started";
  UpArguments arguments;
  arguments.rig = write("rig.toml",
                        "scene = \"scene.toml\"\n[[process]]\nname = \"a\"\nprogram = \"/usr/bin/touch\"\n"
                        "arguments = \"" +
                            started.string() + "\"\nready_timeout = 0.5\nlongest_silence = 0\n");
  arguments.seconds = 0.01;
  arguments.json = (folder_ / "missing" / "out.json").string();
  testing::use_own_domain();
  EXPECT_THROW(run_up(arguments), std::runtime_error);
  EXPECT_FALSE(fs::exists(started));
}

TEST_F(FilesTest, AMissingHandIsRefusedByItsName) {
  const std::string path = write("scene.toml", "[hand]\nmodel = \"nobody.hand.json\"\n");
  EXPECT_NE(complaint(path).find("nobody.hand.json"), std::string::npos) << complaint(path);
}

TEST_F(FilesTest, ASceneElsewhereFindsShippedHandsAndObjects) {
  const std::string object = "[[objects]]\nname = \"a\"\nshape = \"file\"\nfile = \"mug\"\n";
  const std::string path = write("scene.toml", "[hand]\nmodel = \"right_400.hand.json\"\n" + object);
  EXPECT_EQ(complaint(path), "");
  EXPECT_EQ(object_folders(read_scene(path)).back(), kSource / "config/objects");
  const std::string missing = complaint(write("scene.toml", "[hand]\nmodel = \"nobody.hand.json\"\n"));
  for (const fs::path& folder : {folder_, fs::current_path(), kSource / "config/hands"})
    EXPECT_NE(missing.find(folder.string() + "/"), std::string::npos) << missing;
}

TEST_F(FilesTest, RefusesAFolderInPlaceOfAFile) {
  for (const char* key : {"[hand]\nmodel = \"\"\n", "[hand]\nmodel = \".\"\n", "motion = \".\"\n"}) {
    const std::string path = write("scene.toml", key);
    EXPECT_EQ(complaint(path).rfind(path + ": no file '", 0), 0u) << complaint(path);
  }
}

TEST_F(FilesTest, RefusesAJudgeOfAMissingObject) {
  const std::string path = write("scene.toml", "[judge]\nobject = \"ball\"\n");
  EXPECT_NE(complaint(path).find("ball"), std::string::npos) << complaint(path);
}

TEST_F(FilesTest, AMissingFileIsRefusedByItsName) {
  for (const char* name : {"/nonexistent/scene.toml", "/nonexistent/hand.json"})
    EXPECT_NE(complaint(name).find(name), std::string::npos) << complaint(name);
}

TEST_F(FilesTest, ARigWhoseSceneIsMissingIsRefused) {
  const std::string path =
      write("rig.toml", "scene = \"gone.toml\"\n[[process]]\nname = \"world\"\nprogram = \"softhand-world\"\n");
  EXPECT_NE(complaint(path).find("gone.toml"), std::string::npos) << complaint(path);
}

TEST_F(FilesTest, ARigWithoutASceneIsRefusedByItsName) {
  const std::string path = write("rig.toml", "[[process]]\nname = \"world\"\nprogram = \"softhand-world\"\n");
  EXPECT_EQ(complaint(path), path + ": scene: expected a scene file");
}

TEST_F(FilesTest, ARigNamesItsProcessesInOrder) {
  RigOptions rig;
  read_toml_text(rig,
                 "name = \"r\"\nscene = \"s.toml\"\n"
                 "[[process]]\nname = \"a\"\nprogram = \"p\"\narguments = \"--x {scene}\"\nready_timeout = 2.5\n"
                 "[[process]]\nname = \"b\"\nprogram = \"/bin/q\"\n",
                 "rig.toml");
  ASSERT_EQ(rig.processes.size(), 2u);
  EXPECT_EQ(rig.scene, "s.toml");
  EXPECT_EQ(rig.processes[0].name, "a");
  EXPECT_EQ(rig.processes[0].arguments, "--x {scene}");
  EXPECT_EQ(rig.processes[0].ready_timeout, 2.5);
  EXPECT_EQ(rig.processes[1].program, "/bin/q");
  EXPECT_THROW(read_toml_text(rig, "[[process]]\nready_timeout = -1\n", "rig.toml"), ConfigError);
}

TEST_F(FilesTest, ARigExtendsAnotherAndChoosesAmongProcessesOfOneName) {
  write("base.toml",
        "name = \"base\"\nscene = \"scenes/s.toml\"\n"
        "[[process]]\nname = \"world\"\nprogram = \"w\"\n"
        "[[process]]\nname = \"tracker\"\nchoice = \"replay\"\nprogram = \"r\"\n"
        "[[process]]\nname = \"tracker\"\nchoice = \"camera\"\nprogram = \"c\"\n");
  const std::string path = write("rig.toml",
                                 "name = \"mine\"\nextends = \"base.toml\"\nchoose = \"camera\"\n"
                                 "[[process]]\nname = \"viewer\"\nprogram = \"v\"\n");
  const auto programs = [](const RigOptions& rig) {
    std::string all;
    for (const RigProcess& process : chosen_processes(rig)) all += process.program;
    return all;
  };
  RigOptions rig = read_rig(path);
  EXPECT_EQ(rig.name, "mine");
  EXPECT_EQ(rig.scene, (fs::path(path).parent_path() / "scenes/s.toml").string());
  EXPECT_EQ(programs(rig), "wcv");
  EXPECT_FALSE(choose(rig, "tracker", "telepathy"));
  EXPECT_FALSE(choose(rig, "viewer", ""));
  EXPECT_TRUE(choose(rig, "tracker", "replay"));
  EXPECT_EQ(programs(rig), "wrv");
  EXPECT_TRUE(choose(rig, "tracker", "camera"));
  EXPECT_EQ(programs(rig), "wcv");
  EXPECT_THROW(read_rig(write("a.toml", "extends = \"a.toml\"\n")), ConfigError);
  EXPECT_THROW(read_rig(write("b.toml", "extends = \"base.toml\"\nchoose = \"telepathy\"\n")), ConfigError);
  EXPECT_THROW(read_rig(write("c.toml", "extends = \"base.toml\"\n[[process]]\nname = \"world\"\nprogram = \"x\"\n")),
               ConfigError);
}

// Two trackers and a glove, each real or simulated.
TEST_F(FilesTest, AChoiceOfOneProcessLeavesTheOthers) {
  std::string text = "scene = \"s.toml\"\n";
  for (const char* name : {"glove", "tracker"})
    for (const char* choice : {"real", "simulated"})
      text += std::string("[[process]]\nname = \"") + name + "\"\nchoice = \"" + choice + "\"\nprogram = \"" + name[0] +
              choice[0] + " \"\n";
  const auto programs = [](const RigOptions& rig) {
    std::string all;
    for (const RigProcess& process : chosen_processes(rig)) all += process.program;
    return all;
  };
  RigOptions rig = read_rig(write("rig.toml", text));
  EXPECT_EQ(programs(rig), "gr tr ");
  EXPECT_TRUE(choose(rig, "tracker", "simulated"));
  EXPECT_EQ(programs(rig), "gr ts ");
  EXPECT_TRUE(choose(rig, "glove", "simulated"));
  EXPECT_TRUE(choose(rig, "tracker", "real"));
  EXPECT_EQ(programs(rig), "gs tr ");
  EXPECT_EQ(programs(read_rig(write("all.toml", "choose = \"simulated\"\n" + text))), "gs ts ") << "of all processes";
}

// `choose` could not name it, or named two others.
TEST_F(FilesTest, AChoiceWithASpaceIsRefused) {
  for (const char* choice : {"two words", "tab\\t", " "}) {
    const std::string text =
        std::string("scene = \"s.toml\"\n[[process]]\nname = \"a\"\nchoice = \"") + choice + "\"\nprogram = \"p\"\n";
    EXPECT_THROW(read_rig(write("rig.toml", text)), ConfigError) << choice;
  }
}

TEST_F(FilesTest, OnlyDifferentPartsOfOneRigShareADomain) {
  EXPECT_EQ(full_name(read_rig(SOFTHAND_SOURCE_DIR "/config/rigs/hosts/solver.toml")), "hosts/solver");
  EXPECT_EQ(full_name(read_rig(SOFTHAND_SOURCE_DIR "/config/rigs/demo.toml")), "demo");
  EXPECT_TRUE(share_domain("hosts/solver", "hosts/world"));
  EXPECT_FALSE(share_domain("hosts/solver", "hosts/solver"));
  EXPECT_FALSE(share_domain("hosts/solver", "other/world"));
  EXPECT_FALSE(share_domain("hosts/solver", "hosts"));
  EXPECT_FALSE(share_domain("hosts", "hosts/solver"));
  EXPECT_FALSE(share_domain("demo", "demo"));
  EXPECT_FALSE(share_domain("demo", "other"));
}

TEST_F(FilesTest, RigsWithLongNamesAreRefused) {
  const auto reads = [this](std::size_t rig, std::size_t name, std::size_t choice) {
    const std::string text = "name = \"" + std::string(rig, 'r') + "\"\nscene = \"s.toml\"\n[[process]]\nname = \"" +
                             std::string(name, 'n') + "\"\nchoice = \"" + std::string(choice, 'c') +
                             "\"\nprogram = \"x\"\n";
    try {
      read_rig(write("rig.toml", text));
      return true;
    } catch (const ConfigError&) {
      return false;
    }
  };
  EXPECT_TRUE(reads(63, 63, 0));
  EXPECT_FALSE(reads(64, 63, 0));
  EXPECT_FALSE(reads(63, 64, 0));
  EXPECT_FALSE(reads(63, 0, 0));
  EXPECT_TRUE(reads(63, 10, 63));
  EXPECT_FALSE(reads(63, 10, 64));
}

TEST_F(FilesTest, OverridesReachTheSceneAndAreRemembered) {
  const std::string path = write("scene.toml", "[[objects]]\nname = \"cube\"\nmass = 0.05\n");
  const Scene scene = read_scene(path, {"objects.cube.mass=0.2", "hand.rate_hz=60"});
  EXPECT_EQ(scene.options.objects.at(0).mass, 0.2);
  EXPECT_EQ(scene.options.hand.rate_hz, 60);
  ASSERT_EQ(scene.overrides.size(), 2u);
  EXPECT_EQ(scene.overrides[0].key, "objects.cube.mass");
  EXPECT_THROW(read_scene(path, {"objects.ball.mass=1"}), ConfigError);
}

TEST_F(FilesTest, ShippedDemosRunLiveWithoutEnd) {
  const std::vector<Demo> demos = find_demos((kSource / "config/scenes").string());
  std::set<std::string> names;
  for (const Demo& demo : demos) {
    names.insert(demo.name);
    const SceneOptions options = read_scene(demo.scene).options;
    EXPECT_TRUE(options.tracker.repeat) << demo.name;
    EXPECT_EQ(options.hand.model, "auto") << demo.name;
    EXPECT_EQ(options.motion, "") << demo.name << " needs a file that is not in the repository";
    EXPECT_EQ(options.name, demo.name);
    EXPECT_LE(demo.watch.size(), 110u) << demo.name << ": one line of a terminal";
  }
  EXPECT_EQ(names, (std::set<std::string>{"bottle", "button", "drawer", "fist", "free_motion", "grasp", "mug", "pinch",
                                          "scissors", "shake", "soft_cup", "sponge"}));
}

TEST_F(FilesTest, DemosAreTheScenesWithTheKeyWatch) {
  write("b.toml", "watch = \"The second.\"\n");
  write("a.toml", "name = \"other\"\nwatch = \"The first.\"\n");
  write("no_demo.toml", "name = \"no demo\"\n");
  write("broken.toml", "watch = \n");
  write("number.toml", "watch = 3\n");
  write("notes.txt", "watch = \"no scene\"\n");
  const std::vector<Demo> demos = find_demos(folder_.string());
  ASSERT_EQ(demos.size(), 2u);
  EXPECT_EQ(demos[0].name, "a");
  EXPECT_EQ(demos[1].watch, "The second.");
  EXPECT_EQ(find_demo(demos, "b").scene, (folder_ / "b.toml").string());
  const std::string list = demo_list(demos);
  EXPECT_EQ(list.rfind("a  The first.\nb  The second.\n\n", 0), 0u) << list;
  try {
    find_demo(demos, "c");
    FAIL() << "an unknown name was accepted";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "no demonstration is called 'c'; expected one of: a, b");
  }
}

TEST_F(FilesTest, AFolderWithoutDemosIsRefusedByItsName) {
  for (const std::string& folder : {folder_.string(), (folder_ / "gone").string()}) {
    try {
      find_demos(folder);
      FAIL() << folder << " was accepted";
    } catch (const std::runtime_error& error) {
      EXPECT_EQ(std::string(error.what()).rfind(folder + ": expected scenes", 0), 0u) << error.what();
    }
  }
}

TEST_F(FilesTest, DemoWithoutNameListsTheScenesAndStartsNone) {
  ::testing::internal::CaptureStdout();
  const int code = run_demo({});
  const std::string list = ::testing::internal::GetCapturedStdout();
  EXPECT_EQ(code, 0);
  for (const Demo& demo : find_demos((kSource / "config/scenes").string()))
    EXPECT_NE(list.find(demo.watch), std::string::npos) << list;
}

TEST_F(FilesTest, CommittedReferencePageEqualsTheGeneratedOne) {
  EXPECT_TRUE(text_of(kSource / "docs/reference.md") == reference_page())
      << "an option has changed: write the page again with `softhand reference > docs/reference.md`";
}

// So a new driver changes no file outside its folder.
TEST_F(FilesTest, TheOptionsOfADriverAreInItsFolderOnly) {
  EXPECT_GE(registered_drivers().size(), 10u);
  for (const auto& [section, driver] : registered_drivers()) {
    const std::string file = driver_options_file(section);
    EXPECT_TRUE(text_of(kSource / file) == driver_reference_page(section))
        << file << ": an option has changed: write the page again with `softhand reference " << section << " > " << file
        << "`";
    EXPECT_EQ(reference_page().find("**[" + section), std::string::npos) << section;
  }
  EXPECT_THROW(driver_reference_page("tracker_nothing"), std::runtime_error);
}

LoopStatus status_of(const std::string& module, Nanoseconds published) {
  LoopStatus status;
  set_text(status.module, module);
  status.stamp.publish_time = published;
  status.rate_hz = 89.9;
  status.nominal_rate_hz = 90;
  status.step_ms_p50 = 4.25;
  status.deadline_misses = 12;
  status.input_age_ms = -1;
  add_counter(status, "teleports", 3);
  add_counter(status, "refused", 0);
  return status;
}

TEST(StatusTable, ShowsValuesAndOnlyNonZeroCounters) {
  const std::string table = status_table({{"hand", status_of("hand", 1'000'000'000)}}, 1'500'000'000);
  for (const char* part : {"hand", "89.9", "90.0", "4.250", "12", "teleports=3"})
    EXPECT_NE(table.find(part), std::string::npos) << part << "\n" << table;
  EXPECT_EQ(table.find("refused"), std::string::npos) << table;
  EXPECT_EQ(table.find("SILENT"), std::string::npos) << table;
}

TEST(StatusTable, ShowsThePhysicsBelowALoopThatSolves) {
  LoopStatus status = status_of("hand", 1'000'000'000);
  EXPECT_EQ(status_table({{"hand", status}}, 1'500'000'000).find("penetration"), std::string::npos);
  status.step_ms_p999 = 7.125;
  status.input_drops = 41;
  status.iterations = 3;
  status.inverted_elements = 2;
  status.penetration = 0.25e-3;
  status.coupling_stretch = 1.5e-3;
  status.passivity_energy = -0.03125;
  NamedValue row;
  set_text(row.name, "friction");
  row.value = 0.0125;
  status.ledger.push_back(row);
  const std::string table = status_table({{"hand", status}}, 1'500'000'000);
  for (const char* part : {"7.125", " 41 ", "inverted=2", "penetration=0.250 mm", "stretch=1.50 mm",
                           "passivity=-0.0312 J", "friction=0.0125"}) {
    EXPECT_NE(table.find(part), std::string::npos) << part << "\n" << table;
  }
  const auto json = status_json(status);
  EXPECT_EQ(json["step_ms_p999"], 7.125);
  EXPECT_EQ(json["ledger_j"]["friction"], 0.0125);
  EXPECT_EQ(json["passivity_energy_j"], -0.03125);
}

TEST(StatusTable, FlagsAModuleThatFellSilent) {
  const std::string table = status_table(
      {{"hand", status_of("hand", 1'000'000'000)}, {"world", status_of("world", 3'900'000'000)}}, 4'000'000'000);
  std::istringstream lines(table);
  std::string line;
  while (std::getline(lines, line)) {
    EXPECT_EQ(line.find("SILENT for 3.0 s") != std::string::npos, line.starts_with("hand")) << line;
    EXPECT_EQ(line.find("SILENT") != std::string::npos, line.starts_with("hand")) << line;
  }
}

TEST(StatusTable, JsonHasTheKeysOfTheContract) {
  LoopStatus status = status_of("hand", 1);
  status.process_id = 7;
  status.residual = 0.5;
  NamedValue tissue;
  set_text(tissue.name, "tissue");
  status.energies.push_back(tissue);
  status.ledger.push_back(tissue);
  const auto json = status_json(status);
  for (const char* key :
       {"process_id",        "rate_hz",       "nominal_rate_hz",    "step_ms_p50",        "step_ms_p99",
        "step_ms_p999",      "steps",         "deadline_misses",    "input_age_ms",       "input_drops",
        "second_writer",     "residual_n",    "iterations",         "solver_status",      "contact_count",
        "inverted_elements", "penetration_m", "coupling_stretch_m", "passivity_energy_j", "energies_j",
        "ledger_j",          "counters"})
    EXPECT_TRUE(json.contains(key)) << key;
  EXPECT_EQ(json["process_id"], 7);
  EXPECT_EQ(json["residual_n"], 0.5);
  EXPECT_EQ(json["energies_j"]["tissue"], 0);
  EXPECT_EQ(json["counters"]["teleports"], 3);
}

// Fields that others add to the IDL are in the JSON too.
struct KeysOfNumbers {
  const nlohmann::ordered_json& json;

  template <typename T>
  void field(const std::string& name, const T& value) {
    if constexpr (std::is_arithmetic_v<T>) {
      const std::string unit(unit_of_status(name));
      EXPECT_EQ(json.at(unit.empty() ? name : name + "_" + unit), value) << name;
    }
  }
  void key(const char*, const auto&) {}
};

TEST(StatusTable, JsonHasEveryNumber) {
  const LoopStatus status = status_of("hand", 1);
  const auto json = status_json(status);
  visit_fields(KeysOfNumbers{json}, status);
  EXPECT_EQ(unit_of_status("penetration"), "m");
  EXPECT_EQ(unit_of_status("rate_hz"), "") << "the name ends with its unit";
}

// Any process may publish a status under a name in another encoding. Here the name is "Gerät" in Latin-1.
TEST(StatusTable, NameThatIsNotUtf8DoesNotBreakTheSummary) {
  LoopStatus status = status_of("hand", 1);
  add_counter(status, "Ger\xe4t", 4);
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  json["Ger\xe4t"] = status_json(status);
  const auto read = nlohmann::ordered_json::parse(json_text(json));
  EXPECT_EQ(read["Ger\ufffdt"]["counters"]["Ger\ufffdt"], 4);
}

TEST(IdlText, DeclaresTheTypeAndTheTypesItNeeds) {
  const std::string idl = idl_of("softhand::v1::BoneWrench");
  for (const char* part : {"struct BoneWrench {", "struct BoneSample {", "struct Stamp {", "module softhand"}) {
    EXPECT_NE(idl.find(part), std::string::npos) << part;
  }
  EXPECT_EQ(idl.find("#include"), std::string::npos) << "a recording cannot include files";
  EXPECT_EQ(idl.find("struct Contacts {"), std::string::npos) << "unused types are not declared";
  EXPECT_EQ(idl_of("softhand::v1::Nothing"), "");
}

}  // namespace
}  // namespace softhand::cli_files_test
