// Memory of Bullet. Bullet takes memory for each body, pair and growing list, also within a step. Here a freed block
// waits for the next request of its size, and a thread begins with a reserve of free blocks. So a world whose contacts
// begin, or that forgets and starts anew, allocates nothing. Only bullet_engine.cpp includes this header.
#pragma once

namespace softhand {

/// Call it before any use of Bullet. Each thread has its own blocks, so no lock is needed.
void use_bullet_memory();

}  // namespace softhand
