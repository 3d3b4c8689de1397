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

/// Lies before the memory of each block.
struct alignas(kAlignment) Block {
  std::size_t size_class = 0;  ///< the memory has 2^size_class bytes
  Block* next = nullptr;       ///< while it is free
};

class FreeBlocks {
 public:
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
    const auto size_class = static_cast<std::size_t>(std::bit_width(size > kAlignment ? size - 1 : kAlignment - 1));
    Block*& first = first_[size_class];
    Block* block = first;
    if (block != nullptr) {
      first = block->next;
    } else {
      void* const fresh = std::aligned_alloc(kAlignment, sizeof(Block) + (std::size_t{1} << size_class));
      if (fresh == nullptr) throw std::bad_alloc();
      block = new (fresh) Block{size_class, nullptr};
    }
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
