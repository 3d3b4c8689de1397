// The engines that can be chosen: one line each.
#include <stdexcept>
#include <string>

#include "world/engines/bullet/bullet_engine.hpp"

namespace softhand {

std::unique_ptr<PhysicsEngine> make_physics_engine(std::string_view name) {
  if (name == "bullet") return make_bullet_engine();
  throw std::invalid_argument("physics engine '" + std::string(name) + "' is not built in; there is: bullet");
}

}  // namespace softhand
