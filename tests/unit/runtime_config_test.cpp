#include <gtest/gtest.h>

#include <fstream>

#include "runtime/config.hpp"
#include "runtime/config_json.hpp"

namespace softhand::runtime_config_test {
namespace {

struct ObjectSample {
  std::string name;
  double mass = 1;
  std::array<double, 3> position{0, 1, 0};
};
void describe(OptionVisitor& v, ObjectSample& o) {
  v.string("name", o.name, "Name.");
  v.number("mass", o.mass, "kg", {0, 1000}, "Mass.");
  v.numbers("position", o.position.data(), 3, "m", {-10, 10}, "Centre of mass.");
}
struct InnerSample {
  double rate_hz = 1000;
  std::int64_t iterations = 3;
  bool enabled = true;
  std::string mode = "owner";
};
void describe(OptionVisitor& v, InnerSample& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {1, 10000}, "Rate.");
  v.integer("iterations", o.iterations, "", {1, 100}, "Newton | iterations.");
  v.flag("enabled", o.enabled, "Whether.");
  v.choice("mode", o.mode, {"owner", "symmetric"}, "Mode.");
}
struct Sample {
  std::string hand = "hand.json";
  double offset = -0.5;
  InnerSample solver;
  std::vector<ObjectSample> objects;
};
void describe(OptionVisitor& v, Sample& o) {
  v.string("hand", o.hand, "Hand file.");
  v.number("offset", o.offset, "m", {}, "Offset.");
  describe_section(v, "solver", "The solver.", o.solver);
  describe_list(v, "objects", "What lies around.", o.objects);
}

Sample read(std::string_view text) {
  Sample sample;
  read_toml_text(sample, text, "f.toml");
  return sample;
}
std::string refusal(std::string_view text) {
  try {
    read(text);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}
std::string override_refusal(Sample sample, std::string_view assignment) {
  try {
    apply_override(sample, assignment);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}
Sample two_objects() { return read("[[objects]]\nname = \"cube\"\n[[objects]]\nname = \"ball\"\nmass = 2\n"); }

TEST(ReadToml, ReadsEveryKindAndKeepsMissingKeys) {
  const Sample s = read(
      "hand = \"a.json\"\n[solver]\nrate_hz = 90\niterations = 5\nenabled = false\nmode = \"symmetric\"\n"
      "[[objects]]\nname = \"cube\"\nposition = [1, 2.5, 3]\n[[objects]]\nmass = 1e-3\n");
  EXPECT_EQ(s.hand, "a.json");
  EXPECT_EQ(s.offset, -0.5);
  EXPECT_EQ(s.solver.rate_hz, 90);
  EXPECT_EQ(s.solver.iterations, 5);
  EXPECT_FALSE(s.solver.enabled);
  EXPECT_EQ(s.solver.mode, "symmetric");
  ASSERT_EQ(s.objects.size(), 2u);
  EXPECT_EQ(s.objects[0].position, (std::array<double, 3>{1, 2.5, 3}));
  EXPECT_EQ(s.objects[0].mass, 1);
  EXPECT_EQ(s.objects[1].mass, 1e-3);
}

TEST(ReadToml, NamesFileLineKeyRangeUnitAndValue) {
  EXPECT_EQ(refusal("[solver]\nrate_hz = 0.5\n"),
            "f.toml:2: key 'solver.rate_hz': expected number in [1, 10000] Hz, got 0.5");
  EXPECT_EQ(refusal("offset = nan\n"), "f.toml:1: key 'offset': expected number m, got nan");
  EXPECT_EQ(refusal("offset = -inf\n"), "f.toml:1: key 'offset': expected number m, got -inf");
  EXPECT_EQ(refusal("offset = \"x\"\n"), "f.toml:1: key 'offset': expected number m, got 'x'");
  EXPECT_EQ(refusal("[solver]\niterations = 2.0\n"),
            "f.toml:2: key 'solver.iterations': expected integer in [1, 100], got 2.0");
  EXPECT_EQ(refusal("[solver]\nenabled = 1\n"), "f.toml:2: key 'solver.enabled': expected true or false, got 1");
  EXPECT_EQ(refusal("[solver]\nmode = \"both\"\n"),
            "f.toml:2: key 'solver.mode': expected one of \"owner\", \"symmetric\", got 'both'");
  EXPECT_EQ(refusal("[[objects]]\nposition = [1, 2]\n"),
            "f.toml:2: key 'objects.0.position': expected array of 3 numbers, each in [-10, 10] m, got [ 1, 2 ]");
  EXPECT_NE(refusal("[[objects]]\nposition = [1, 2, nan]\n"), "");
  EXPECT_NE(refusal("[[objects]]\nposition = [1, 2, 11]\n"), "");
  EXPECT_NE(refusal("solver = 3\n").find("expected a table [solver]"), std::string::npos);
  EXPECT_NE(refusal("objects = [1]\n").find("expected an array of tables [[objects]]"), std::string::npos);
  EXPECT_EQ(refusal("hand = \n").rfind("f.toml:1: ", 0), 0u);
}

TEST(ReadToml, AcceptsTheEndsOfARange) {
  EXPECT_EQ(read("[solver]\nrate_hz = 1").solver.rate_hz, 1);
  EXPECT_EQ(read("[solver]\nrate_hz = 10000").solver.rate_hz, 10000);
  EXPECT_NE(refusal("[solver]\nrate_hz = 10000.0001"), "");
}

TEST(ReadToml, ReportsAllErrorsInLineOrderAndSuggestsKeys) {
  const std::string text =
      refusal("hnad = \"x\"\noffset = nan\n[solver]\nrate = 3\nmode = 2\n[[objects]]\nzzzzzzzzz = 1\n");
  const std::size_t a = text.find("f.toml:1: unknown key 'hnad'; did you mean 'hand'?");
  const std::size_t b = text.find("f.toml:2: key 'offset'");
  const std::size_t c = text.find("f.toml:4: unknown key 'solver.rate'; did you mean 'rate_hz'?");
  const std::size_t d = text.find("f.toml:5: key 'solver.mode'");
  const std::size_t e = text.find("f.toml:7: unknown key 'objects.0.zzzzzzzzz'; known here: name, mass, position");
  EXPECT_TRUE(a < b && b < c && c < d && d < e && e != std::string::npos) << text;
}

TEST(ReadToml, IgnoresOnlyForeignTables) {
  Sample sample;
  const ForeignKey foreign = [](std::string_view key) { return key == "world" || key == "hand"; };
  read_toml_text(sample, "hand = \"b.json\"\n[world]\nrate_hz = 3\n", "f.toml", foreign);
  EXPECT_EQ(sample.hand, "b.json");
  EXPECT_THROW(read_toml_text(sample, "[wolrd]\nrate_hz = 3\n", "f.toml", foreign), ConfigError);
  EXPECT_THROW(read_toml_text(sample, "[solver.world]\nrate_hz = 3\n", "f.toml", foreign), ConfigError);
}

TEST(ReadToml, LeavesOptionsUnchangedWhenItRefuses) {
  Sample sample;
  EXPECT_THROW(read_toml_text(sample, "hand = \"b.json\"\noffset = nan\n", "f.toml"), ConfigError);
  EXPECT_EQ(sample.hand, "hand.json");
}

TEST(ReadToml, RefusesFilesThatCannotBeRead) {
  Sample sample;
  EXPECT_THROW(read_toml(sample, "/does/not/exist.toml"), ConfigError);
  EXPECT_THROW(read_toml(sample, "/tmp"), ConfigError);
  const std::string path = testing::TempDir() + "softhand_runtime_config_test.toml";
  std::ofstream(path) << "hand = \"c.json\"\n";
  read_toml(sample, path);
  EXPECT_EQ(sample.hand, "c.json");
  std::ofstream(path, std::ios::trunc).flush();
  read_toml(sample, path);  // an empty file changes nothing
  EXPECT_EQ(sample.hand, "c.json");
}

TEST(Override, SetsLeavesByPathIndexAndName) {
  Sample s = two_objects();
  const AppliedOverride applied = apply_override(s, "solver.rate_hz=90");
  EXPECT_EQ(s.solver.rate_hz, 90);
  EXPECT_EQ(applied.key, "solver.rate_hz");
  EXPECT_EQ(applied.before, "1000");
  EXPECT_EQ(applied.after, "90");
  apply_override(s, "objects.0.mass=0.25");
  apply_override(s, "objects.ball.mass=0.5");
  EXPECT_EQ(s.objects[0].mass, 0.25);
  EXPECT_EQ(s.objects[1].mass, 0.5);
  apply_override(s, "objects.ball.position=[1, 2, 3]");
  EXPECT_EQ(s.objects[1].position[2], 3);
  apply_override(s, "hand=a=b.json");
  EXPECT_EQ(s.hand, "a=b.json");
  apply_override(s, "hand=\"quoted\"");
  EXPECT_EQ(s.hand, "quoted");
  apply_override(s, "hand=12");
  EXPECT_EQ(s.hand, "12");
  apply_override(s, "hand=");
  EXPECT_EQ(s.hand, "");
  apply_override(s, "solver.mode=symmetric");
  EXPECT_EQ(s.solver.mode, "symmetric");
  apply_override(s, "solver.enabled=false");
  EXPECT_FALSE(s.solver.enabled);
}

TEST(Override, NamesTheKeyAndWhatWasExpected) {
  const Sample s = two_objects();
  EXPECT_EQ(override_refusal(s, "solver.rate_hz=0"), "--set solver.rate_hz: expected number in [1, 10000] Hz, got 0");
  EXPECT_EQ(override_refusal(s, "solver.rate_hz=fast"),
            "--set solver.rate_hz: expected number in [1, 10000] Hz, got fast");
  EXPECT_EQ(override_refusal(s, "solver.rate_hz="), "--set solver.rate_hz: expected number in [1, 10000] Hz, got ");
  EXPECT_EQ(override_refusal(s, "solver.rat_hz=3"),
            "--set solver.rat_hz: unknown key 'rat_hz'; did you mean 'rate_hz'?");
  EXPECT_NE(override_refusal(s, "objects.cub.mass=3").find("did you mean 'cube'?"), std::string::npos);
  EXPECT_NE(override_refusal(s, "objects.2.mass=3").find("no element '2' in a list of 2"), std::string::npos);
  for (const char* bad : {"", "=3", "solver", "solver=3", "objects=3", "objects.0=3", "hand.x=3", "solver.rate_hz.=3",
                          ".=3", "solver.rate_hz=1\nx=2", "objects.-1.mass=1", "objects.99999999999999999999.mass=1"}) {
    EXPECT_NE(override_refusal(s, bad), "") << bad;
  }
  Sample twins = s;
  twins.objects[1].name = "cube";
  EXPECT_NE(override_refusal(twins, "objects.cube.mass=3").find("two elements are named"), std::string::npos);
}

TEST(Reference, PrintsEveryKeyOnceWithDefaultUnitRangeAndMeaning) {
  const std::string page = reference_markdown<Sample>("Sample");
  EXPECT_EQ(page, reference_markdown<Sample>("Sample"));
  EXPECT_NE(page.find("| `solver.rate_hz` | `1000` | Hz | [1, 10000] | Rate. |\n"), std::string::npos) << page;
  EXPECT_NE(page.find("| `objects[].mass` | `1` | kg | [0, 1000] | Mass. |\n"), std::string::npos) << page;
  EXPECT_NE(page.find("| `objects[].position` | `[0, 1, 0]` | m | each [-10, 10] | Centre of mass. |\n"),
            std::string::npos)
      << page;
  EXPECT_NE(page.find("Newton \\| iterations."), std::string::npos) << page;
  EXPECT_NE(page.find("| **[solver]** |"), std::string::npos) << page;
  EXPECT_NE(page.find("| **[[objects]]** | 0 elements |"), std::string::npos) << page;
}

TEST(Json, HoldsEffectiveValuesInOrder) {
  EXPECT_EQ(
      options_to_json(two_objects()).dump(),
      R"({"hand":"hand.json","offset":-0.5,"solver":{"rate_hz":1000.0,"iterations":3,"enabled":true,"mode":"owner"},)"
      R"("objects":[{"name":"cube","mass":1.0,"position":[0.0,1.0,0.0]},)"
      R"({"name":"ball","mass":2.0,"position":[0.0,1.0,0.0]}]})");
}

}  // namespace
}  // namespace softhand::runtime_config_test
