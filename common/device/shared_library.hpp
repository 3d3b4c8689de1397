// Libraries of vendors that are loaded at run time, because they may not be distributed with this project.
#pragma once

#include <dlfcn.h>

#include <memory>
#include <stdexcept>
#include <string>

namespace softhand {

class SharedLibrary {
 public:
  /// `path`: a path, or a name that the system's loader finds. Throws std::runtime_error with the loader's reason.
  explicit SharedLibrary(const std::string& path) : path_(path), handle_(dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (handle_ == nullptr) throw std::runtime_error("cannot load " + path + ": " + dlerror());
  }
  /// Throws std::runtime_error if the library has no such function.
  template <typename Function>
  void find(const char* name, Function*& out) const {
    out = reinterpret_cast<Function*>(dlsym(handle_.get(), name));
    if (out == nullptr) throw std::runtime_error(path_ + ": has no function " + name);
  }

 private:
  struct Close {
    void operator()(void* handle) const { dlclose(handle); }
  };
  std::string path_;
  std::unique_ptr<void, Close> handle_;
};

}  // namespace softhand
