#include "device/driver.hpp"

#include "trackers/fusion/fusion_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::FusionOptions> driver{
    "tracker_fusion", "softhand-tracker-fusion: one hand from several trackers."};
}
