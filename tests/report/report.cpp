#include "report/report.hpp"

#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>

namespace softhand::report {
namespace {

// First line of the output of a shell command. Empty if the command fails.
std::string first_line(const std::string& command) {
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::array<char, 256> buffer{};
  if (!pipe || std::fgets(buffer.data(), buffer.size(), pipe.get()) == nullptr) return {};
  std::string line(buffer.data());
  while (!line.empty() && line.back() == '\n') line.pop_back();
  return line;
}

}  // namespace

Provenance provenance() {
  Provenance from;
  std::ifstream cpu("/proc/cpuinfo");
  for (std::string line; from.processor.empty() && std::getline(cpu, line);) {
    if (line.rfind("model name", 0) == 0) from.processor = line.substr(line.find(':') + 2);
  }
  if (from.processor.empty()) from.processor = "unknown processor";
#ifdef __clang__
  from.compiler = "Clang " __clang_version__;
#else
  from.compiler = "GCC " __VERSION__;
#endif
  from.commit = first_line("git -C '" SOFTHAND_SOURCE_DIR
                           "' describe --always --abbrev=10 --dirty=-modified --exclude='*' 2>/dev/null");
  if (from.commit.empty()) from.commit = "unknown";
  return from;
}

std::string in_quotes(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"') out += '"';
    out += c;
  }
  return out + '"';
}

std::string in_cell(std::string text) {
  for (std::size_t at = 0; (at = text.find_first_of("|\n", at)) != std::string::npos; at += 2)
    text.replace(at, 1, text[at] == '|' ? "\\|" : "; ");
  return text;
}

void write_file(const std::string& path, const std::string& text) {
  if (path.empty()) return;
  std::ofstream out(path);
  out << text;
  out.flush();
  if (!out) throw std::runtime_error(path + ": cannot be written");
}

void draw(const std::string& part, const std::string& rows, const std::string& folder) {
  namespace fs = std::filesystem;
  if (folder.empty()) return;
  fs::create_directories(folder);
  const std::string file =
      (fs::temp_directory_path() / ("softhand_" + part + "_" + std::to_string(getpid()) + ".json")).string();
  write_file(file, rows);
  const std::string command =
      "/usr/bin/python3 '" SOFTHAND_SOURCE_DIR "/tests/" + part + "/plot.py' '" + file + "' '" + folder + "'";
  const int status = std::system(command.c_str());
  fs::remove(file);
  if (status != 0) throw std::runtime_error("no pictures (python3-matplotlib is needed): " + command + " failed");
}

}  // namespace softhand::report
