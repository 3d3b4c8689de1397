#include "mesh_files/gltf_file.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace softhand {
namespace {

using nlohmann::json;

std::string bytes_of(std::istream& in) {
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

// Empty if `text` is not base64 (RFC 4648).
std::string from_base64(const std::string& text) {
  static const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    if (c == '=') break;
    const std::size_t digit = digits.find(c);
    if (digit == std::string::npos) return "";
    bits = (bits << 6 | static_cast<std::uint32_t>(digit)) & 0xFFFFFF;
    count += 6;
    if (count >= 8) {
      count -= 8;
      out += static_cast<char>(bits >> count & 0xFF);
    }
  }
  return out;
}

// Decodes %XX (RFC 3986).
std::string decoded(const std::string& uri) {
  std::string out;
  for (std::size_t i = 0; i < uri.size(); ++i) {
    unsigned code = 0;
    if (uri[i] == '%' && i + 2 < uri.size() &&
        std::from_chars(uri.data() + i + 1, uri.data() + i + 3, code, 16).ptr == uri.data() + i + 3) {
      out += static_cast<char>(code);
      i += 2;
    } else {
      out += uri[i];
    }
  }
  return out;
}

}  // namespace

GltfFile::GltfFile(std::istream& in, std::string name, const std::string* folder) : name_(std::move(name)) {
  const std::string bytes = bytes_of(in);
  const auto word = [&](std::size_t place) {
    std::uint32_t value = 0;
    std::memcpy(&value, bytes.data() + place, sizeof value);
    return value;
  };
  const bool text_file = folder != nullptr && bytes.find_first_not_of(" \t\r\n") != std::string::npos &&
                         bytes[bytes.find_first_not_of(" \t\r\n")] == '{';
  std::string chunk;
  bool has_chunk = false;
  if (text_file) {
    document_ = json::parse(bytes, nullptr, false);
    check(document_.is_object(), "document", "valid JSON");
  } else {
    check(bytes.size() >= 20 && word(0) == 0x46546C67 && word(4) == 2, "header",
          "a binary glTF file of version 2 (.glb)");
    const std::size_t text = word(12);
    check(word(16) == 0x4E4F534A && text <= bytes.size() - 20, "chunk 0", "JSON inside the file");
    has_chunk =
        bytes.size() - 20 - text >= 8 && word(24 + text) == 0x004E4942 && word(20 + text) <= bytes.size() - 28 - text;
    check(has_chunk || folder != nullptr, "chunk 1", "binary data inside the file");
    document_ = json::parse(bytes.begin() + 20, bytes.begin() + 20 + static_cast<std::ptrdiff_t>(text), nullptr, false);
    check(document_.is_object(), "chunk 0", "valid JSON");
    if (has_chunk) chunk = bytes.substr(28 + text, word(20 + text));
  }
  const auto found = document_.find("buffers");
  const std::size_t count = found != document_.end() && found->is_array() ? found->size() : 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::string where = "buffers[" + std::to_string(i) + "]";
    const json& buffer = element("buffers", i);
    const auto uri = buffer.find("uri");
    if (uri == buffer.end()) {
      check(i == 0 && has_chunk, where + ".uri", "data in a file, or the binary chunk as the first buffer");
      buffers_.push_back(std::move(chunk));
    } else {
      check(folder != nullptr && uri->is_string(), where + ".uri", "the binary chunk of the file");
      buffers_.push_back(load_buffer(uri->get<std::string>(), *folder, where + ".uri"));
    }
  }
}

std::string GltfFile::load_buffer(const std::string& uri, const std::string& folder, const std::string& where) const {
  if (uri.rfind("data:", 0) == 0) {
    const std::size_t start = uri.find(";base64,");
    const std::string data = start == std::string::npos ? "" : from_base64(uri.substr(start + 8));
    check(!data.empty(), where, "base64 data");
    return data;
  }
  // A document from elsewhere must not open devices or other people's files.
  const std::filesystem::path path = decoded(uri);
  std::error_code error;
  check(path.is_relative() && std::find(path.begin(), path.end(), "..") == path.end() &&
            std::filesystem::is_regular_file(std::filesystem::path(folder) / path, error),
        where, "a file in the folder of the document, found '" + uri + "'");
  std::ifstream in(std::filesystem::path(folder) / path, std::ios::binary);
  return bytes_of(in);
}

void GltfFile::check(bool good, const std::string& field, const std::string& expected) const {
  if (!good) throw std::runtime_error(name_ + ": " + field + ": expected " + expected);
}

const json& GltfFile::element(const char* list, std::size_t index) const {
  const auto found = document_.find(list);
  check(found != document_.end() && found->is_array() && index < found->size() && (*found)[index].is_object(), list,
        "an element " + std::to_string(index));
  return (*found)[index];
}

std::size_t GltfFile::index(const json& object, const char* key, const std::string& where,
                            std::optional<std::size_t> absent) const {
  const auto found = object.find(key);
  if (found == object.end() && absent) return *absent;
  check(found != object.end() && found->is_number_unsigned(), where + "." + key, "a whole number from 0");
  return found->get<std::size_t>();
}

std::vector<double> GltfFile::numbers(std::size_t accessor_index, const std::string& type,
                                      const std::string& what) const {
  const std::string where = "accessors[" + std::to_string(accessor_index) + "] (" + what + ")";
  const json& accessor = element("accessors", accessor_index);
  check(accessor.value("type", std::string()) == type, where + ".type", type);
  check(!accessor.contains("sparse"), where + ".sparse", "no sparse data");
  const json& view = element("bufferViews", index(accessor, "bufferView", where));
  const std::size_t buffer = index(view, "buffer", where + ".bufferView");
  check(buffer < buffers_.size(), where + ".bufferView.buffer", "a buffer of the file");
  const std::string& binary = buffers_[buffer];
  const std::size_t columns = type == "SCALAR" ? 1 : type == "VEC3" ? 3 : type == "VEC4" ? 4 : 16;
  const std::size_t component = index(accessor, "componentType", where), count = index(accessor, "count", where);
  check(component == 5121 || component == 5123 || component == 5125 || component == 5126, where + ".componentType",
        "5121, 5123, 5125 or 5126");
  const std::size_t width = component == 5121 ? 1 : component == 5123 ? 2 : 4;
  const std::size_t start = index(view, "byteOffset", where + ".bufferView", 0),
                    offset = index(accessor, "byteOffset", where, 0);
  const std::size_t length = index(view, "byteLength", where + ".bufferView");
  const std::size_t stride = index(view, "byteStride", where + ".bufferView", columns * width);
  const std::size_t size = binary.size();
  check(count > 0 && count <= size && offset <= size && stride >= columns * width && stride <= 252 && length <= size &&
            start <= size - length && offset + (count - 1) * stride + columns * width <= length,
        where, "data inside the buffer");
  const bool normalised = accessor.value("normalized", false);
  std::vector<double> out;
  out.reserve(count * columns);
  const auto read = [&]<typename T>(T value, std::size_t place, double scale) {
    std::memcpy(&value, binary.data() + place, sizeof value);
    out.push_back(static_cast<double>(value) / (normalised ? scale : 1.0));
    check(std::isfinite(out.back()), where, "finite numbers");
  };
  for (std::size_t row = 0; row < count; ++row) {
    for (std::size_t column = 0; column < columns; ++column) {
      const std::size_t place = start + offset + row * stride + column * width;
      if (component == 5121)
        read(std::uint8_t{}, place, 255);
      else if (component == 5123)
        read(std::uint16_t{}, place, 65535);
      else if (component == 5125)
        read(std::uint32_t{}, place, 1);
      else
        read(float{}, place, 1);
    }
  }
  return out;
}

std::vector<std::size_t> GltfFile::indices(std::size_t accessor_index, const std::string& type, const std::string& what,
                                           std::size_t limit) const {
  const json& accessor = element("accessors", accessor_index);
  const std::string where = "accessors[" + std::to_string(accessor_index) + "] (" + what + ")";
  check(index(accessor, "componentType", where) != 5126 && !accessor.value("normalized", false), where,
        "whole numbers");
  std::vector<std::size_t> out;
  for (const double value : numbers(accessor_index, type, what)) {
    check(value < static_cast<double>(limit), where, "indices below " + std::to_string(limit));
    out.push_back(static_cast<std::size_t>(value));
  }
  return out;
}

}  // namespace softhand
