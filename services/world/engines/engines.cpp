// List of the available engines, one line each.
#include <stdexcept>
#include <string>

#include "world/engines/bullet/bullet_engine.hpp"

namespace softhand {

std::unique_ptr<PhysicsEngine> make_physics_engine(std::string_view name) {
  if (name == "bullet") return make_bullet_engine();
  throw std::invalid_argument("physics engine '" + std::string(name) + "' is unknown; expected: bullet");
}

}  // namespace softhand
