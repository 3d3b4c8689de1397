// What a term carries from one step to the next, as one value (docs/add-an-energy.md).
//
// A term with memory derives from `EnergyWithMemory<Term>` instead of `Energy` and has:
//
//   struct Memory {                // a plain value (messages/plain_bytes.hpp)
//     std::vector<Item> items;
//     double heat = 0;
//   };
//   const Memory& save() const;    // between two steps; valid until the next call; does not allocate after `bind`
//   void load(const Memory& m);    // throws std::invalid_argument if `m` does not fit the term
//   void reset();                  // forgets what the last steps left; values set by the caller stay
//
// A step must change the memory only in `end_step`. So a step that begins and does not end has no effect.
#pragma once

#include "energies/energy.hpp"
#include "messages/plain_bytes.hpp"

namespace softhand {

/// The base of a term with memory. `Term` has Memory, save, load and reset.
template <typename Term>
class EnergyWithMemory : public Energy {
 public:
  void save_memory(ByteWriter& out) const final { out.write(static_cast<const Term&>(*this).save()); }
  void load_memory(ByteReader& in) final { static_cast<Term&>(*this).load(in.take<typename Term::Memory>()); }
  void copy_memory(const Energy& other) final {
    static_cast<Term&>(*this).load(dynamic_cast<const Term&>(other).save());
  }
  void reset_memory() final { static_cast<Term&>(*this).reset(); }
};

}  // namespace softhand
