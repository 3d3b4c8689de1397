// Bullet 3.24 behind the PhysicsEngine interface. This header includes no Bullet header.
#pragma once

#include <memory>

#include "world/physics_engine.hpp"

namespace softhand {

std::unique_ptr<PhysicsEngine> make_bullet_engine();

}  // namespace softhand
