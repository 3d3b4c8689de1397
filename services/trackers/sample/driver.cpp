#include "device/driver.hpp"

#include "sample_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::SampleOptions> driver{"tracker_sample",
                                                               "the sample of docs/add-a-tracker.md."};
}
