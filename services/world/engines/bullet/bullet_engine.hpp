// Bullet 3.24 behind the engine's face. No Bullet header is seen from here.
#pragma once

#include <memory>

#include "world/physics_engine.hpp"

namespace softhand {

std::unique_ptr<PhysicsEngine> make_bullet_engine();

}  // namespace softhand
