#include "viewer/recording.hpp"

#include <stdexcept>

namespace softhand::viewer {
namespace {

template <typename T>
void put(std::ofstream& out, const T& value) {
  out.write(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

Recording::Recording(const std::string& path) : path_(path), out_(path, std::ios::binary) {
  if (!out_) throw std::runtime_error(path + ": cannot be written");
  out_.write("SHVR", 4);
  put(out_, std::uint32_t{1});
}

void Recording::add(double seconds, const Frame& frame) {
  if (frame == nullptr) return;
  put(out_, 1e3 * seconds);
  put(out_, static_cast<std::uint32_t>(frame->size()));
  out_.write(reinterpret_cast<const char*>(frame->data()), static_cast<std::streamsize>(frame->size()));
}

void Recording::close() {
  out_.close();
  if (!out_) throw std::runtime_error(path_ + ": cannot be written");
}

}  // namespace softhand::viewer
