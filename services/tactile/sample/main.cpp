// softhand-tactile-sample: the sample pad.
#include "service/device_service.hpp"
#include "tactile/sample/sample_pad.hpp"

int main(int argc, char** argv) { return softhand::run_device<softhand::SamplePad>(argc, argv, "tactile-sample"); }
