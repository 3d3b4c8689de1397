// The saved state of a hand simulation: its own values, and the memory of each term.
#include <array>
#include <stdexcept>
#include <utility>

#include "energies/memory.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {

template <typename Self, typename Visit>
void HandSimulation::visit_own(Self& self, Visit&& visit) {
  visit(self.state_);
  visit(self.modes_);
  visit(self.restored_);
  visit(self.untangled_nodes_);
  visit(self.untangled_);
  visit(self.bone_contact_forces_);
  visit(self.carpus_velocity_);
  visit(self.ledger_enabled_);
  visit(self.ledger_);
  visit(self.stored_);
  visit(self.stored_is_valid_);
}

void HandSimulation::save(ByteWriter& out) const {
  visit_own(*this, [&out](const auto& value) { out.write(value); });
  for (const auto& term : terms_) term->save_memory(out);
  for (const auto& hand : hands_) out.write(hand->untangler().save());
  if (soft_) out.write(soft_->save());
}

void HandSimulation::load(ByteReader& in) {
  const auto layout = [this] {
    return std::array{static_cast<std::size_t>(state_.node_positions.cols()),
                      static_cast<std::size_t>(state_.node_velocities.cols()),
                      state_.body_poses.size(),
                      state_.body_velocities.size(),
                      modes_.size(),
                      bone_contact_forces_.size()};
  };
  const auto own = layout();
  visit_own(*this, [&in](auto& value) { in.read(value); });
  if (layout() != own) throw std::runtime_error("the saved state has another layout than the hand");
  try {
    for (const auto& term : terms_) term->load_memory(in);
    for (const auto& hand : hands_) hand->untangler().load(in.take<Untangler::Memory>());
    if (soft_) soft_->load(in.take<SoftObjects::Memory>());
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(std::string("the saved state does not fit: ") + error.what());
  }
  forget();
}

void HandSimulation::forget() { solver_->forget(); }

}  // namespace softhand
