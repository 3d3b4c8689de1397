// Looks for types of namespace softhand that two files define. The linker does not report them, although their methods
// replace each other at random (the one-definition rule).
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace definitions_test {
namespace {

namespace fs = std::filesystem;

// Comments, strings, characters and preprocessor lines are left out.
std::string without_text(const std::string& source) {
  std::string out;
  const auto skip_past = [&source](const std::string& end, std::size_t from) {
    const std::size_t found = source.find(end, from);
    return found == std::string::npos ? source.size() : found + end.size();
  };
  bool line_start = true;
  for (std::size_t i = 0; i < source.size();) {
    const char c = source[i];
    if (c == '/' && source.compare(i, 2, "//") == 0) {
      i = skip_past("\n", i) - 1;
    } else if (c == '/' && source.compare(i, 2, "/*") == 0) {
      i = skip_past("*/", i);
    } else if (c == '#' && line_start) {
      i = skip_past("\n", i) - 1;
    } else if (source.compare(i, 3, "R\"(") == 0) {
      i = skip_past(")\"", i);
    } else if (c == '"' || (c == '\'' && !(i > 0 && std::isdigit(source[i - 1]) != 0))) {
      for (++i; i < source.size() && source[i] != c && source[i] != '\n'; ++i) i += source[i] == '\\' ? 1 : 0;
      ++i;
    } else {
      out += c;
      line_start = c == '\n' || (line_start && std::isspace(c) != 0);
      ++i;
    }
  }
  return out;
}

// The qualified names of the types that the source defines in named namespaces. Types of anonymous namespaces and of
// functions are local to the file, and members belong to their class.
std::set<std::string> defined_types(const std::string& source) {
  static const std::regex token(
      R"(namespace\s+([\w:]*)\s*\{|\b(?:class|struct|union|enum(?:\s+class)?)\s+(?:alignas\([^)]*\)\s*)?)"
      R"((\w+)(?:\s+final)?(?:\s*:(?!:)[^;{(]*)?\s*\{|\{|\})",
      std::regex::optimize);
  std::set<std::string> names;
  std::vector<std::string> scopes;  // name of a namespace; "-" for all other scopes
  const std::string clean = without_text(source);
  for (std::sregex_iterator i(clean.begin(), clean.end(), token), end; i != end; ++i) {
    const std::string found = i->str();
    if (found == "}") {
      if (!scopes.empty()) scopes.pop_back();
    } else if (found.rfind("namespace", 0) == 0) {
      scopes.push_back((*i)[1].length() > 0 ? (*i)[1].str() : "-");
    } else {
      if ((*i)[2].length() > 0 && std::find(scopes.begin(), scopes.end(), "-") == scopes.end()) {
        std::string name;
        for (const std::string& scope : scopes) name += scope + "::";
        names.insert(name + (*i)[2].str());
      }
      scopes.push_back("-");
    }
  }
  return names;
}

TEST(Definitions, ParserSeesTypesOfNamedNamespacesOnly) {
  const std::set<std::string> names = defined_types(
      "namespace a { class B { struct C {}; }; struct D; namespace { struct E {}; } enum class F : int { x };\n"
      "// struct G {};\nvoid f() { struct H {}; } template <typename T> struct I final : B { const char* s = \"}\"; }; "
      "}\n"
      "namespace a::b { union J { int k; }; }");
  EXPECT_EQ(names, (std::set<std::string>{"a::B", "a::F", "a::I", "a::b::J"}));
}

TEST(Definitions, NoTypeIsDefinedInTwoFiles) {
  const fs::path root = SOFTHAND_SOURCE_DIR;
  std::map<std::string, std::vector<std::string>> files;
  for (const char* top : {"common", "services"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
      if (entry.path().extension() != ".hpp" && entry.path().extension() != ".cpp") continue;
      std::ifstream in(entry.path());
      std::stringstream text;
      text << in.rdbuf();
      for (const std::string& name : defined_types(text.str()))
        files[name].push_back(fs::relative(entry.path(), root).string());
    }
  }
  EXPECT_GT(files.size(), 200u);
  for (const auto& [name, where] : files) {
    std::string list;
    for (const std::string& file : where) list += " " + file;
    EXPECT_EQ(where.size(), 1u) << name << " is defined in" << list;
  }
}

}  // namespace
}  // namespace definitions_test
