// The rules of docs/architecture.md about who may include whom, checked on the real include graph.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;
using Includes = std::map<std::string, std::vector<std::string>>;  // file -> what it includes, as written

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

// The room of an include path such as "energies/contact.hpp"; empty for system headers.
std::string room(const std::string& include) {
  static const std::set<std::string> rooms{"math", "model", "messages", "geometry", "energies", "solver", "scene", "runtime", "device", "bus"};
  const std::string first = include.substr(0, include.find('/'));
  return rooms.count(first) != 0 ? first : "";
}

bool starts_with(const std::string& text, const std::string& prefix) { return text.rfind(prefix, 0) == 0; }

TEST(Arrows, GraphIsNotEmpty) {
  ASSERT_GT(includes().size(), 30u);
  ASSERT_TRUE(includes().count("common/energies/energy.hpp"));
}

TEST(Arrows, EachRoomOnlyLooksDown) {
  const std::map<std::string, std::set<std::string>> allowed{
      {"math", {"math"}},
      {"messages", {"messages", "model", "math"}},
      {"model", {"model", "math"}},
      {"geometry", {"geometry", "model", "math", "messages"}},
      {"energies", {"energies", "geometry", "model", "math", "messages", "runtime"}},
      {"solver", {"solver", "energies", "model", "math", "runtime"}},
      {"scene", {"scene", "solver", "energies", "geometry", "model", "math", "messages", "runtime"}},
      {"runtime", {"runtime", "messages", "model"}},
      {"device", {"device", "runtime", "messages", "model", "math"}},
      {"bus", {"bus", "runtime", "messages", "model"}},
  };
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "common/")) continue;
    const std::string own = file.substr(7, file.find('/', 7) - 7);
    ASSERT_TRUE(allowed.count(own)) << file << " stands in a room that the rules do not know";
    for (const std::string& include : list) {
      const std::string other = room(include);
      if (other.empty()) continue;
      EXPECT_TRUE(allowed.at(own).count(other)) << file << " includes " << include;
    }
  }
}

TEST(Arrows, PhysicsUsesOnlyOptionsOfTheRuntime) {
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "common/energies/") && !starts_with(file, "common/solver/") && !starts_with(file, "common/scene/")) continue;
    for (const std::string& include : list) {
      if (room(include) == "runtime") {
        EXPECT_EQ(include, "runtime/options.hpp") << file;
      }
    }
  }
}

TEST(Arrows, SolverSeesNoConcreteTerm) {
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "common/solver/")) continue;
    for (const std::string& include : list) {
      if (room(include) == "energies") {
        EXPECT_EQ(include, "energies/energy.hpp") << file;
      }
    }
  }
}

TEST(Arrows, DdsStaysInTheBus) {
  for (const auto& [file, list] : includes()) {
    if (starts_with(file, "common/bus/") || starts_with(file, "services/engine/")) continue;
    for (const std::string& include : list) {
      const bool dds = starts_with(include, "fastdds") || starts_with(include, "fastrtps") || starts_with(include, "fastcdr") ||
                       starts_with(include, "dds/") || include.find("PubSubTypes") != std::string::npos;
      EXPECT_FALSE(dds) << file << " includes " << include;
    }
  }
}

TEST(Arrows, LoopsHaveNoClockNoBusAndNoThreads) {
  int loops = 0;
  for (const auto& [file, list] : includes()) {
    if (!starts_with(file, "services/") || file.find("_loop.") == std::string::npos) continue;
    ++loops;
    for (const std::string& include : list) {
      EXPECT_NE(room(include), "bus") << file << " includes " << include;
      EXPECT_FALSE(include == "chrono" || include == "thread" || include == "runtime/clock.hpp" || include == "runtime/periodic_loop.hpp" ||
                   include == "iostream" || include == "fstream")
          << file << " includes " << include;
    }
  }
  EXPECT_GE(loops, 3);
}

TEST(Arrows, EnginesStayInTheirFolder) {
  for (const auto& [file, list] : includes()) {
    if (starts_with(file, "services/world/engines/")) continue;
    for (const std::string& include : list) {
      EXPECT_FALSE(include.find("bullet") != std::string::npos || include.find("btBullet") != std::string::npos) << file << " includes " << include;
    }
  }
}

// Beast takes half a minute to compile.
TEST(Arrows, BeastStaysInOneFile) {
  for (const auto& [file, list] : includes()) {
    if (file == "services/web/web_server.cpp") continue;
    for (const std::string& include : list) EXPECT_FALSE(starts_with(include, "boost/")) << file << " includes " << include;
  }
}

TEST(Arrows, MesherStaysInTheHandBuilder) {
  for (const auto& [file, list] : includes()) {
    if (starts_with(file, "services/hand_builder/")) continue;
    for (const std::string& include : list) EXPECT_FALSE(starts_with(include, "CGAL/")) << file << " includes " << include;
  }
}

}  // namespace
