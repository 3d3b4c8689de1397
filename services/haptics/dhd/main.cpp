// softhand-haptic-dhd: a device of Force Dimension. It tracks the point that the user holds and pushes it.
#include "haptics/dhd/dhd.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) { return softhand::run_tracking_device<softhand::Dhd>(argc, argv, "haptic-dhd"); }
