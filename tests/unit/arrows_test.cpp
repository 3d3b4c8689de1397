// Checks the include rules of docs/architecture.md on the real include graph.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace arrows_test {
namespace {

namespace fs = std::filesystem;
using Includes = std::map<std::string, std::vector<std::string>>;  // file -> its include paths, as written

const Includes& includes() {
  static const Includes all = [] {
    Includes found;
    const fs::path root = SOFTHAND_SOURCE_DIR;
    const std::regex line_pattern(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
    for (const char* top : {"common", "services"}) {
      for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
        const auto extension = entry.path().extension();
        if (extension != ".hpp" && extension != ".cpp" && extension != ".h" && extension != ".c") continue;
        auto& list = found[fs::relative(entry.path(), root).string()];
        std::ifstream in(entry.path());
        for (std::string line; std::getline(in, line);) {
          std::smatch match;
          if (std::regex_search(line, match, line_pattern)) list.push_back(match[1]);
        }
      }
    }
    return found;
  }();
  return all;
}

// The folder of common/ in an include path, such as "energies" in "energies/contact.hpp". Empty for system headers.
std::string folder_of(const std::string& include) {
  static const std::set<std::string> folders{"math",   "model", "messages", "geometry", "contact", "energies",
                                             "solver", "scene", "runtime",  "device",   "bus"};
  const std::string first = include.substr(0, include.find('/'));
  return folders.count(first) != 0 ? first : "";
}

bool starts_with(const std::string& text, const std::string& prefix) { return text.rfind(prefix, 0) == 0; }

// Only files below one of `places` may include a path that matches `pattern` (ignoring case). At least one file must.
void expect_only_below(const std::vector<std::string>& places, const char* pattern) {
  const std::regex matcher(pattern, std::regex::icase);
  int found = 0;
  for (const auto& [file, list] : includes()) {
    for (const std::string& include : list) {
      if (!std::regex_search(include, matcher)) continue;
      ++found;
      EXPECT_TRUE(std::any_of(places.begin(), places.end(),
                              [&file = file](const std::string& place) { return starts_with(file, place); }))
          << file << " includes " << include;
    }
  }
  EXPECT_GT(found, 0) << pattern;
}

TEST(Arrows, GraphIsNotEmpty) {
  ASSERT_GT(includes().size(), 30u);
  ASSERT_TRUE(includes().count("common/energies/energy.hpp"));
}

TEST(Arrows, EachFolderIncludesOnlyLowerFolders) {
  const std::map<std::string, std::set<std::string>> allowed{
      {"math", {"math"}},
      {"messages", {"messages", "model", "math"}},
      {"model", {"model", "math"}},
      {"geometry", {"geometry", "model", "math", "messages"}},
      {"contact", {"contact", "geometry", "model", "math", "messages"}},
      {"energies", {"energies", "contact", "geometry", "model", "math", "messages", "runtime"}},
      {"solver", {"solver", "energies", "model", "math", "runtime"}},
      {"scene", {"scene", "solver", "energies", "contact", "geometry", "model", "math", "messages", "runtime"}},
      {"runtime", {"runtime", "messages", "model"}},
      {"device", {"device", "runtime", "messages", "model", "math"}},
      {"bus", {"bus", "runtime", "messages", "model"}},
  };
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "common/")) continue;
    const std::string own = file.substr(7, file.find('/', 7) - 7);
    ASSERT_TRUE(allowed.count(own)) << file << " is in a folder that the include rules do not list";
    for (const std::string& include : list) {
      const std::string other = folder_of(include);
      if (other.empty()) continue;
      EXPECT_TRUE(allowed.at(own).count(other)) << file << " includes " << include;
    }
  }
}

TEST(Arrows, PhysicsUsesOnlyOptionsOfTheRuntime) {
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "common/energies/") && !starts_with(file, "common/solver/") &&
        !starts_with(file, "common/scene/"))
      continue;
    for (const std::string& include : list) {
      if (folder_of(include) == "runtime") {
        EXPECT_EQ(include, "runtime/options.hpp") << file;
      }
    }
  }
}

TEST(Arrows, SolverIncludesNoConcreteTerm) {
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "common/solver/")) continue;
    for (const std::string& include : list) {
      if (folder_of(include) == "energies") {
        EXPECT_EQ(include, "energies/energy.hpp") << file;
      }
    }
  }
}

TEST(Arrows, AnchorLawKnowsNoColliderAndColliderKnowsNoAnchor) {
  const auto never = [](const std::string& file, const std::set<std::string>& others) {
    for (const char* extension : {".hpp", ".cpp"}) {
      ASSERT_TRUE(includes().count(file + extension)) << file;
      for (const std::string& include : includes().at(file + extension))
        EXPECT_FALSE(others.count(include)) << file << extension << " includes " << include;
    }
  };
  never("common/contact/anchor_law",
        {"contact/collider.hpp", "contact/candidates.hpp", "contact/contact_report.hpp", "contact/contact_point.hpp"});
  never("common/contact/collider", {"contact/anchor_law.hpp", "contact/coulomb.hpp", "contact/contact_report.hpp"});
  never("common/contact/candidates", {"contact/anchor_law.hpp", "contact/coulomb.hpp", "contact/contact_report.hpp"});
}

TEST(Arrows, DdsStaysInTheBus) { expect_only_below({"common/bus/"}, "^(fastdds|fastrtps|fastcdr|dds)/|PubSubTypes"); }

TEST(Arrows, LoopsHaveNoClockNoBusAndNoThreads) {
  int loops = 0;
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "services/") || file.find("_loop.") == std::string::npos) continue;
    ++loops;
    for (const std::string& include : list) {
      EXPECT_NE(folder_of(include), "bus") << file << " includes " << include;
      EXPECT_FALSE(include == "chrono" || include == "thread" || include == "runtime/clock.hpp" ||
                   include == "runtime/periodic_loop.hpp" || include == "iostream" || include == "fstream")
          << file << " includes " << include;
    }
  }
  EXPECT_GE(loops, 3);
}

TEST(Arrows, EnginesStayInTheirFolder) { expect_only_below({"services/world/engines/"}, "bullet|^LinearMath/"); }

// The replay tracker also serves the simulation without processes. `sockets` is shared by trackers of web pages.
TEST(Arrows, TrackersStayInTheirFolders) {
  int found = 0;
  for (const auto& [file, list] : includes()) {
    for (const std::string& include : list) {
      if (!starts_with(include, "trackers/") || starts_with(include, "trackers/replay/")) continue;
      ++found;
      const std::string folder = include.substr(0, include.find('/', 9) + 1);
      EXPECT_TRUE(starts_with(file, "services/" + folder) ||
                  (folder == "trackers/sockets/" && starts_with(file, "services/trackers/")))
          << file << " includes " << include;
    }
  }
  EXPECT_GT(found, 5);
}

// Beast takes half a minute to compile.
TEST(Arrows, BeastStaysInThreeFiles) {
  expect_only_below(
      {"services/web/web_server.cpp", "common/device/websocket_client.cpp", "common/device/simulated_service.cpp"},
      "^boost/");
}

// CGAL is GPL-3.0+, and slow to compile.
TEST(Arrows, CgalStaysInTwoFilesOfTheOfflineTools) {
  int found = 0;
  for (const auto& [file, list] : includes()) {
    for (const std::string& include : list) {
      if (!starts_with(include, "CGAL/")) continue;
      ++found;
      EXPECT_TRUE(file == "services/hand_builder/cgal_mesh.cpp" || file == "services/object_builder/cgal_solid.cpp")
          << file << " includes " << include;
    }
  }
  EXPECT_GT(found, 0);
}

}  // namespace
}  // namespace arrows_test
