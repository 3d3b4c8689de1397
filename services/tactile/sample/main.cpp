// softhand-tactile-sample: the sample pad.
#include "sample_pad.hpp"
#include "service/device_service.hpp"

int main(int argc, char** argv) { return softhand::run_device<softhand::SamplePad>(argc, argv, "tactile-sample"); }
