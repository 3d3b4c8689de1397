// A struct that a test shares with the processes that it starts, through a file in memory.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>
#include <new>
#include <string>

namespace softhand::testing {

/// The environment variable `variable` has the path of the file.
template <typename T>
class SharedStruct {
 public:
  explicit SharedStruct(const std::string& variable)
      : path_("/dev/shm/softhand_" + std::to_string(getpid()) + "_" + variable) {
    const int file = open(path_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    EXPECT_EQ(ftruncate(file, sizeof(T)), 0);
    void* bytes = mmap(nullptr, sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    value_ = new (bytes) T;
    setenv(variable.c_str(), path_.c_str(), 1);
  }
  ~SharedStruct() {
    munmap(value_, sizeof(T));
    unlink(path_.c_str());
  }
  SharedStruct(const SharedStruct&) = delete;
  SharedStruct& operator=(const SharedStruct&) = delete;
  T* operator->() { return value_; }

 private:
  std::string path_;
  T* value_;
};

}  // namespace softhand::testing
