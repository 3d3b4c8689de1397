// The saved state of a hand simulation: its own values, and the memory of each term.
#include <concepts>
#include <memory>
#include <type_traits>

#include "energies/body_coupling.hpp"
#include "energies/contact.hpp"
#include "energies/inertia.hpp"
#include "energies/object_joint.hpp"
#include "energies/plane_contact.hpp"
#include "energies/tissue.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {
namespace {

// A part with `struct Memory`, `save` and `load`.
template <typename Part>
concept HasMemory = requires(Part& part, const typename Part::Memory& memory) {
  { part.save() } -> std::convertible_to<typename Part::Memory>;
  part.load(memory);
};

template <typename Part>
void save_part(ByteWriter& out, const Part& part) {
  if constexpr (HasMemory<Part>) out.write(part.save());
}

template <typename Part>
void load_part(ByteReader& in, Part& part) {
  if constexpr (HasMemory<Part>) {
    typename Part::Memory memory = part.save();
    in.read(memory);
    part.load(memory);
  }
}

// What a part without a memory would carry to the next step is dropped.
template <typename Part>
void forget_part(Part& part) {
  if constexpr (!HasMemory<Part>) {
    if constexpr (requires { part.reset(); }) part.reset();
  }
}

}  // namespace

template <typename Self, typename Visit>
void HandSimulation::visit_own(Self& self, Visit&& visit) {
  visit(self.state_);
  visit(self.modes_);
  visit(self.restored_);
  visit(self.untangled_nodes_);
  visit(self.untangled_);
  visit(self.bone_contact_forces_);
  visit(self.ledger_enabled_);
  visit(self.ledger_);
  visit(self.stored_);
  visit(self.stored_is_valid_);
}

template <typename Visit>
void HandSimulation::for_each_memory(Visit&& visit) {
  visit(*inertia_);
  visit(*coupling_);
  if (object_coupling_ != nullptr) visit(*object_coupling_);
  if (contacts_ != nullptr) visit(*contacts_);
  if (planes_ != nullptr) visit(*planes_);
  if (joints_ != nullptr) visit(*joints_);
  visit(untangler_);
}

bool HandSimulation::can_save() const {
  if constexpr (HasMemory<ContactSet> && HasMemory<PlaneContact> && HasMemory<BodyCoupling>) {
    return true;
  } else {
    for (int slot = 0; slot < slot_count(); ++slot)
      if (slot_mode(slot) == SlotMode::dynamic || touched(slot)) return false;
    return contact_count() == 0 && object_coupling_ == nullptr;
  }
}

void HandSimulation::save(ByteWriter& out) const {
  visit_own(*this, [&out](const auto& value) { out.write(value); });
  const_cast<HandSimulation*>(this)->for_each_memory([&out](const auto& part) { save_part(out, part); });
}

void HandSimulation::load(ByteReader& in) {
  const std::size_t nodes = static_cast<std::size_t>(state_.node_positions.cols()), bodies = state_.body_poses.size();
  visit_own(*this, [&in](auto& value) { in.read(value); });
  if (static_cast<std::size_t>(state_.node_positions.cols()) != nodes || state_.body_poses.size() != bodies)
    throw std::runtime_error("the saved state has another layout than the hand");
  for_each_memory([&in](auto& part) { load_part(in, part); });
  forget();
}

void HandSimulation::forget() {
  for_each_memory([](auto& part) { forget_part(part); });
  if constexpr (!HasMemory<BodyCoupling>) {
    ledger_.restart();
    stored_is_valid_ = false;
  }
  if constexpr (!HasMemory<Untangler>) untangler_ = untouched_untangler_;
  solver_->forget();
}

}  // namespace softhand
