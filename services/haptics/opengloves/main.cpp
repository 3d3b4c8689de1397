// softhand-haptic-opengloves: a glove with the OpenGloves protocol. It tracks the fingers and brakes them.
#include "haptics/opengloves/opengloves.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) {
  return softhand::run_tracking_device<softhand::OpenGloves>(argc, argv, "haptic-opengloves");
}
