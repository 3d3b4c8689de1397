// A headless session with the OpenXR runtime of this machine.
#pragma once

#include "device/device_thread.hpp"
#include "trackers/openxr/openxr_options.hpp"

namespace softhand {

/// Pushes the bytes of OpenXrFrames. It throws std::runtime_error if there is no runtime, or one that lacks hand
/// tracking, headless sessions or the conversion of times. It waits for a headset that is not there yet.
DeviceThread::Session openxr_session(const OpenXrOptions& options);

}  // namespace softhand
