#include "world/engines/bullet/bullet_memory.hpp"

#include <LinearMath/btAlignedAllocator.h>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <new>

namespace softhand {
namespace {

constexpr std::size_t kAlignment = 64;  // bytes; Bullet asks for 16
// Free blocks that a thread begins with: 128 KiB of each size class up to 64 KiB, less than 2 MB in all. Contacts that
// begin in a step take from them.
constexpr std::size_t kReservedBytes = 128 * 1024;
constexpr std::size_t kLastReservedClass = 16;

// 2^(size class) bytes is the least power of two that holds `size`, and no less than `kAlignment`.
constexpr std::size_t size_class_of(std::size_t size) {
  return static_cast<std::size_t>(std::bit_width((size > kAlignment ? size : kAlignment) - 1));
}

/// Lies before the memory of each block.
struct alignas(kAlignment) Block {
  std::size_t size_class = 0;  ///< the memory has 2^size_class bytes
  Block* next = nullptr;       ///< while it is free
};

class FreeBlocks {
 public:
  FreeBlocks() {
    for (std::size_t size_class = size_class_of(0); size_class <= kLastReservedClass; ++size_class) {
      for (std::size_t i = 0; i < kReservedBytes >> size_class; ++i) give(fresh_block(size_class) + 1);
    }
  }
  ~FreeBlocks() {
    for (Block*& first : first_) {
      while (first != nullptr) {
        Block* const block = first;
        first = block->next;
        std::free(block);
      }
    }
  }

  void* take(std::size_t size) {
    const std::size_t size_class = size_class_of(size);
    Block*& first = first_[size_class];
    Block* block = first;
    if (block != nullptr)
      first = block->next;
    else
      block = fresh_block(size_class);
    void* const memory = block + 1;
    std::memset(memory, 0, size);  // as Bullet's own allocator: Bullet reads members that it never sets
    return memory;
  }

  void give(void* memory) {
    Block* const block = static_cast<Block*>(memory) - 1;
    block->next = first_[block->size_class];
    first_[block->size_class] = block;
  }

 private:
  static Block* fresh_block(std::size_t size_class) {
    void* const memory = std::aligned_alloc(kAlignment, sizeof(Block) + (std::size_t{1} << size_class));
    if (memory == nullptr) throw std::bad_alloc();
    return new (memory) Block{size_class, nullptr};
  }

  std::array<Block*, 64> first_{};  // by size class
};

thread_local FreeBlocks free_blocks;

void* take(std::size_t size, int) { return free_blocks.take(size); }
void give(void* memory) {
  if (memory != nullptr) free_blocks.give(memory);
}

}  // namespace

void use_bullet_memory() { btAlignedAllocSetCustomAligned(take, give); }

}  // namespace softhand
