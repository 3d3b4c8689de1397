// Counts every malloc, calloc and aligned_alloc of the process while `counting` is true (operator new, Eigen and Bullet
// call them). The functions are weak, because several files of a test program may include this. Sanitizers have their
// own malloc. With them SOFTHAND_COUNT_MALLOC is not defined, and nothing is counted.
#pragma once

#include <cstddef>

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define SOFTHAND_COUNT_MALLOC 1
#endif
inline bool counting = false;
inline long allocations = 0;
#ifdef SOFTHAND_COUNT_MALLOC
extern "C" void* __libc_malloc(std::size_t size);
extern "C" void* __libc_calloc(std::size_t count, std::size_t size);
extern "C" void* __libc_memalign(std::size_t alignment, std::size_t size);
extern "C" [[gnu::weak]] void* malloc(std::size_t size) {
  if (counting) ++allocations;
  return __libc_malloc(size);
}
extern "C" [[gnu::weak]] void* calloc(std::size_t count, std::size_t size) {
  if (counting) ++allocations;
  return __libc_calloc(count, size);
}
extern "C" [[gnu::weak]] void* aligned_alloc(std::size_t alignment, std::size_t size) {
  if (counting) ++allocations;
  return __libc_memalign(alignment, size);
}
#endif
