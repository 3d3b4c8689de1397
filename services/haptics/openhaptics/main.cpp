// softhand-haptic-openhaptics: a Touch or Phantom. It tracks the point that the user holds and pushes it.
#include "haptics/openhaptics/openhaptics.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) {
  return softhand::run_tracking_device<softhand::OpenHaptics>(argc, argv, "haptic-openhaptics");
}
