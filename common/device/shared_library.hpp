// Libraries of vendors that are loaded at run time, because they may not be distributed with this project.
#pragma once

#include <dlfcn.h>

#include <memory>
#include <string>

#include "runtime/config.hpp"

namespace softhand {

class SharedLibrary {
 public:
  /// `path`: a path, or a name that the system's loader finds. Throws ConfigError with the loader's reason.
  explicit SharedLibrary(const std::string& path) : path_(path), handle_(dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (handle_ == nullptr) throw ConfigError("cannot load " + path + ": " + dlerror());
  }
  /// Throws ConfigError if the library has no such function.
  template <typename Function>
  void find(const char* name, Function*& out) const {
    out = reinterpret_cast<Function*>(dlsym(handle_.get(), name));
    if (out == nullptr) throw ConfigError(path_ + ": has no function " + name);
  }

 private:
  struct Close {
    void operator()(void* handle) const { dlclose(handle); }
  };
  std::string path_;
  std::unique_ptr<void, Close> handle_;
};

}  // namespace softhand
