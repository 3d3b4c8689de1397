// softhand-tactile-bhaptics: a bHaptics TactGlove.
#include "service/device_service.hpp"
#include "tactile/bhaptics/bhaptics.hpp"

int main(int argc, char** argv) { return softhand::run_device<softhand::Bhaptics>(argc, argv, "tactile-bhaptics"); }
