#include "device/driver.hpp"

#include "outside_options.hpp"

namespace {
const softhand::RegisterDriver<OutsideOptions> driver{"tracker_outside", "a wrist that does not move."};
}
