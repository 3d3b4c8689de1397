// softhand-haptic-sample: the sample glove.
#include "sample_glove.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) { return softhand::run_device<softhand::SampleGlove>(argc, argv, "haptic-sample"); }
