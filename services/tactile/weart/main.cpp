// softhand-tactile-weart: a WEART TouchDIVER. It tracks the fingers and acts on their skin.
#include "service/device_service.hpp"
#include "tactile/weart/weart.hpp"

int main(int argc, char** argv) { return softhand::run_tracking_device<softhand::Weart>(argc, argv, "tactile-weart"); }
