#include "trackers/openxr/openxr_session.hpp"

#include <time.h>

#define XR_USE_TIMESPEC
#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "runtime/clock.hpp"
#include "trackers/openxr/openxr_hands.hpp"

namespace softhand {
namespace {

constexpr Nanoseconds kBetweenAttempts = 500'000'000;  // to find a headset
static_assert(sizeof(OpenXrJoint) == sizeof(XrHandJointLocationEXT));
static_assert(sizeof(OpenXrVelocity) == sizeof(XrHandJointVelocityEXT));
static_assert(kJointCount == XR_HAND_JOINT_COUNT_EXT);

// XR_EXT_hand_tracking_data_source is newer than the header of Debian 12.
constexpr const char* kDataSourceExtension = "XR_EXT_hand_tracking_data_source";
enum DataSource : std::int32_t { kUnobstructed = 1, kController = 2 };
struct DataSourceInfo {
  XrStructureType type = static_cast<XrStructureType>(1000428000);
  const void* next = nullptr;
  std::uint32_t count = 0;
  const std::int32_t* sources = nullptr;
};
struct DataSourceState {
  XrStructureType type = static_cast<XrStructureType>(1000428001);
  void* next = nullptr;
  XrBool32 is_active = XR_FALSE;
  std::int32_t source = 0;
};

void check(XrResult result, const char* what) {
  if (XR_FAILED(result)) throw std::runtime_error(std::string("OpenXR: ") + what + ": error " + std::to_string(result));
}

/// Owns an instance, and with it all that was made from it.
class Instance {
 public:
  Instance() {
    std::uint32_t count = 0;
    check(xrEnumerateInstanceExtensionProperties(nullptr, 0, &count, nullptr), "no runtime answers");
    std::vector<XrExtensionProperties> all(count, {XR_TYPE_EXTENSION_PROPERTIES, nullptr, "", 0});
    check(xrEnumerateInstanceExtensionProperties(nullptr, count, &count, all.data()), "no runtime answers");
    const auto has = [&](const char* name) {
      return std::any_of(all.begin(), all.end(),
                         [&](const auto& each) { return !std::strcmp(each.extensionName, name); });
    };
    std::vector<const char*> names{XR_EXT_HAND_TRACKING_EXTENSION_NAME, XR_MND_HEADLESS_EXTENSION_NAME,
                                   XR_KHR_CONVERT_TIMESPEC_TIME_EXTENSION_NAME};
    for (const char* name : names)
      if (!has(name)) throw std::runtime_error(std::string("OpenXR: the runtime lacks ") + name);
    has_data_source = has(kDataSourceExtension);
    if (has_data_source) names.push_back(kDataSourceExtension);
    XrInstanceCreateInfo info{};
    info.type = XR_TYPE_INSTANCE_CREATE_INFO;
    std::strcpy(info.applicationInfo.applicationName, "softhand");
    info.applicationInfo.apiVersion = XR_CURRENT_API_VERSION;
    info.enabledExtensionCount = static_cast<std::uint32_t>(names.size());
    info.enabledExtensionNames = names.data();
    check(xrCreateInstance(&info, &instance), "no instance");
    load(create_tracker, "xrCreateHandTrackerEXT");
    load(destroy_tracker, "xrDestroyHandTrackerEXT");
    load(locate, "xrLocateHandJointsEXT");
    load(to_xr_time, "xrConvertTimespecTimeToTimeKHR");
  }
  ~Instance() { xrDestroyInstance(instance); }
  Instance(const Instance&) = delete;
  Instance& operator=(const Instance&) = delete;

  XrInstance instance = XR_NULL_HANDLE;
  bool has_data_source = false;
  PFN_xrCreateHandTrackerEXT create_tracker = nullptr;
  PFN_xrDestroyHandTrackerEXT destroy_tracker = nullptr;
  PFN_xrLocateHandJointsEXT locate = nullptr;
  PFN_xrConvertTimespecTimeToTimeKHR to_xr_time = nullptr;

 private:
  template <typename Function>
  void load(Function& function, const char* name) {
    const XrResult result = xrGetInstanceProcAddr(instance, name, reinterpret_cast<PFN_xrVoidFunction*>(&function));
    if (XR_FAILED(result)) xrDestroyInstance(instance);
    check(result, name);
  }
};

class Session {
 public:
  Session(const Instance& of, XrSystemId system, const std::string& space) : of_(of) {
    XrSessionCreateInfo info{XR_TYPE_SESSION_CREATE_INFO, nullptr, 0, system};
    check(xrCreateSession(of.instance, &info, &session_), "no session without graphics");
    try {
      make_spaces(space);
      make_trackers();
    } catch (...) {
      xrDestroySession(session_);
      throw;
    }
  }
  // Spaces and trackers end with their session.
  ~Session() {
    for (const XrHandTrackerEXT tracker : trackers_) of_.destroy_tracker(tracker);
    xrDestroySession(session_);
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Until the thread stops or the session ends.
  void run(DeviceThread& thread, Nanoseconds period) {
    bool is_running = false;
    Nanoseconds next = now();
    while (!thread.stops()) {
      XrEventDataBuffer event{XR_TYPE_EVENT_DATA_BUFFER, nullptr, {}};
      XrResult result = XR_SUCCESS;
      while ((result = xrPollEvent(of_.instance, &event)) == XR_SUCCESS) {
        if (event.type == XR_TYPE_EVENT_DATA_INSTANCE_LOSS_PENDING) return;
        if (event.type == XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED) {
          const auto state = reinterpret_cast<const XrEventDataSessionStateChanged&>(event).state;
          if (state == XR_SESSION_STATE_READY) {
            XrSessionBeginInfo begin{XR_TYPE_SESSION_BEGIN_INFO, nullptr, XrViewConfigurationType{}};
            check(xrBeginSession(session_, &begin), "the session does not begin");
            is_running = true;
            thread.opened();
          } else if (state == XR_SESSION_STATE_STOPPING) {
            xrEndSession(session_);
            is_running = false;
          } else if (state == XR_SESSION_STATE_EXITING || state == XR_SESSION_STATE_LOSS_PENDING) {
            return;
          }
        }
        event = {XR_TYPE_EVENT_DATA_BUFFER, nullptr, {}};
      }
      check(result, "events");
      if (is_running) push_frame(thread);
      // A runtime that was slow is not asked for what it missed.
      next = std::max(next + period, now());
      thread.sleep(next - now());
    }
  }

 private:
  void make_spaces(const std::string& space) {
    XrReferenceSpaceCreateInfo info{XR_TYPE_REFERENCE_SPACE_CREATE_INFO, nullptr, XR_REFERENCE_SPACE_TYPE_STAGE, {}};
    info.poseInReferenceSpace.orientation.w = 1;
    const bool has_stage = space == "stage" && XR_SUCCEEDED(xrCreateReferenceSpace(session_, &info, &world_));
    info.referenceSpaceType = XR_REFERENCE_SPACE_TYPE_LOCAL;
    if (!has_stage) check(xrCreateReferenceSpace(session_, &info, &world_), "no space");
    info.referenceSpaceType = XR_REFERENCE_SPACE_TYPE_VIEW;
    check(xrCreateReferenceSpace(session_, &info, &view_), "no space of the head");
  }
  void make_trackers() {
    for (std::size_t side = 0; side < trackers_.size(); ++side) {
      constexpr std::array<std::int32_t, 2> sources{kUnobstructed, kController};
      DataSourceInfo source;
      source.count = sources.size();
      source.sources = sources.data();
      XrHandTrackerCreateInfoEXT info{XR_TYPE_HAND_TRACKER_CREATE_INFO_EXT, of_.has_data_source ? &source : nullptr,
                                      side == 0 ? XR_HAND_LEFT_EXT : XR_HAND_RIGHT_EXT, XR_HAND_JOINT_SET_DEFAULT_EXT};
      check(of_.create_tracker(session_, &info, &trackers_[side]), "no hand tracker");
    }
  }

  void push_frame(DeviceThread& thread) {
    OpenXrFrame frame;
    frame.time = now();
    const timespec stamp{static_cast<time_t>(frame.time / 1'000'000'000),
                         static_cast<long>(frame.time % 1'000'000'000)};
    XrTime time = 0;
    check(of_.to_xr_time(of_.instance, &stamp, &time), "no time");
    XrSpaceLocation head{XR_TYPE_SPACE_LOCATION, nullptr, 0, {}};
    check(xrLocateSpace(view_, world_, time, &head), "the head cannot be located");
    frame.head.flags = head.locationFlags;
    std::memcpy(frame.head.orientation.data(), &head.pose.orientation, sizeof head.pose.orientation);
    std::memcpy(frame.head.position.data(), &head.pose.position, sizeof head.pose.position);
    for (std::size_t side = 0; side < trackers_.size(); ++side) {
      OpenXrHand& hand = frame.hands[side];
      XrHandJointVelocitiesEXT velocities{XR_TYPE_HAND_JOINT_VELOCITIES_EXT, nullptr, kJointCount,
                                          reinterpret_cast<XrHandJointVelocityEXT*>(hand.velocities.data())};
      DataSourceState source;
      if (of_.has_data_source) velocities.next = &source;
      XrHandJointLocationsEXT joints{XR_TYPE_HAND_JOINT_LOCATIONS_EXT, &velocities, XR_FALSE, kJointCount,
                                     reinterpret_cast<XrHandJointLocationEXT*>(hand.joints.data())};
      const XrHandJointsLocateInfoEXT info{XR_TYPE_HAND_JOINTS_LOCATE_INFO_EXT, nullptr, world_, time};
      check(of_.locate(trackers_[side], &info, &joints), "the hands cannot be located");
      hand.is_active = joints.isActive == XR_TRUE;
      hand.is_from_controller = source.is_active == XR_TRUE && source.source == kController;
    }
    thread.push(frame.bytes(), now());
  }

  const Instance& of_;
  XrSession session_ = XR_NULL_HANDLE;
  XrSpace world_ = XR_NULL_HANDLE, view_ = XR_NULL_HANDLE;
  std::array<XrHandTrackerEXT, 2> trackers_{};
};

// The headset; 0 if the thread stops before there is one.
XrSystemId find_system(const Instance& of, DeviceThread& thread) {
  const XrSystemGetInfo info{XR_TYPE_SYSTEM_GET_INFO, nullptr, XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY};
  XrSystemId system = XR_NULL_SYSTEM_ID;
  while (!thread.stops()) {
    const XrResult result = xrGetSystem(of.instance, &info, &system);
    // Some runtimes have no headset until it is on.
    if (result != XR_ERROR_FORM_FACTOR_UNAVAILABLE) {
      check(result, "no headset");
      break;
    }
    thread.sleep(kBetweenAttempts);
  }
  return system;
}

}  // namespace

DeviceThread::Session openxr_session(const OpenXrOptions& options) {
  // The loader would print each attempt without a runtime.
  setenv("XR_LOADER_DEBUG", "none", 0);
  return [options](DeviceThread& thread) {
    const Instance instance;
    const XrSystemId system = find_system(instance, thread);
    if (system == XR_NULL_SYSTEM_ID) return;
    XrSystemHandTrackingPropertiesEXT hands{XR_TYPE_SYSTEM_HAND_TRACKING_PROPERTIES_EXT, nullptr, XR_FALSE};
    XrSystemProperties properties{};
    properties.type = XR_TYPE_SYSTEM_PROPERTIES;
    properties.next = &hands;
    check(xrGetSystemProperties(instance.instance, system, &properties), "no properties");
    if (hands.supportsHandTracking != XR_TRUE) throw std::runtime_error("OpenXR: the headset does not track hands");
    Session(instance, system, options.space).run(thread, static_cast<Nanoseconds>(1e9 / options.rate));
  };
}

}  // namespace softhand
