// softhand-haptic-haply: a Haply Inverse3. It tracks the point that the user holds and pushes it.
#include "haptics/haply/haply.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) { return softhand::run_tracking_device<softhand::Haply>(argc, argv, "haptic-haply"); }
