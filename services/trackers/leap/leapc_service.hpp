// Frames of Ultraleap's service, through its library LeapC.
#pragma once

#include <string>

#include "device/device_thread.hpp"
#include "trackers/leap/leap_frame.hpp"
#include "trackers/leap/leapc.hpp"

namespace softhand {

/// Converts a frame. `offset`: our clock minus LeapC's, ns.
LeapFrame read_leapc(const leapc::TrackingEvent& event, Nanoseconds offset);

/// A session with the service: pushes the bytes of LeapFrames. `mounting` as in LeapOptions. It throws
/// std::runtime_error if the library cannot be loaded.
DeviceThread::Session leapc_session(const std::string& library, const std::string& mounting);

}  // namespace softhand
