// A runtime for the OpenXR loader, in place of that of a headset. The file in the environment variable FAKE_OPENXR says
// what the headset does: without it there is none; "worn" shows two hands; "lost" ends the session; "nan" shows hands
// with NaN; other text shows no hands.
#include <time.h>

#define XR_USE_TIMESPEC
#include <openxr/openxr.h>
#include <openxr/openxr_platform.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fstream>
#include <iterator>
#include <limits>
#include <mutex>
#include <string>

namespace {

// What the loader and a runtime agree on (src/common/loader_interfaces.h of the loader).
struct NegotiateLoaderInfo {
  std::int32_t type;
  std::uint32_t version;
  std::size_t size;
  std::uint32_t minimum_interface, maximum_interface;
  std::uint64_t minimum_api, maximum_api;
};
struct NegotiateRuntimeRequest {
  std::int32_t type;
  std::uint32_t version;
  std::size_t size;
  std::uint32_t interface;
  std::uint64_t api;
  PFN_xrGetInstanceProcAddr get;
};
static_assert(sizeof(NegotiateLoaderInfo) == 40 && sizeof(NegotiateRuntimeRequest) == 40);

struct Structure {  // the start of every structure of OpenXR
  XrStructureType type;
  Structure* next;
};
struct DataSourceState {
  XrStructureType type;
  void* next;
  XrBool32 is_active;
  std::int32_t source;
};
constexpr auto kDataSourceInfo = static_cast<XrStructureType>(1000428000);
constexpr auto kDataSourceState = static_cast<XrStructureType>(1000428001);

template <typename Handle>
Handle handle(std::uint64_t number) {
  return reinterpret_cast<Handle>(number);
}
constexpr std::uint64_t kInstance = 1, kSession = 2, kStage = 3, kView = 4, kLeft = 5, kRight = 6;
constexpr XrSystemId kSystem = 7;

std::mutex mutex;
std::deque<XrSessionState> events;
bool has_session = false, is_running = false, is_lost = false, has_sources = false;

std::string headset() {
  const char* const path = std::getenv("FAKE_OPENXR");
  std::ifstream file(path != nullptr ? path : "/nowhere");
  return file ? "on " + std::string(std::istreambuf_iterator<char>(file), {}) : "";
}
void go(XrSessionState state) { events.push_back(state); }

XrResult XRAPI_CALL enumerate_extensions(const char*, std::uint32_t room, std::uint32_t* count,
                                         XrExtensionProperties* out) {
  constexpr const char* names[] = {XR_EXT_HAND_TRACKING_EXTENSION_NAME, XR_MND_HEADLESS_EXTENSION_NAME,
                                   XR_KHR_CONVERT_TIMESPEC_TIME_EXTENSION_NAME, "XR_EXT_hand_tracking_data_source"};
  *count = std::size(names);
  if (room == 0) return XR_SUCCESS;
  if (room < *count) return XR_ERROR_SIZE_INSUFFICIENT;
  for (std::size_t i = 0; i < std::size(names); ++i) {
    std::strcpy(out[i].extensionName, names[i]);
    out[i].extensionVersion = 1;
  }
  return XR_SUCCESS;
}
XrResult XRAPI_CALL create_instance(const XrInstanceCreateInfo*, XrInstance* out) {
  *out = handle<XrInstance>(kInstance);
  return XR_SUCCESS;
}
XrResult XRAPI_CALL destroy_instance(XrInstance) { return XR_SUCCESS; }
XrResult XRAPI_CALL get_instance_properties(XrInstance, XrInstanceProperties* out) {
  out->runtimeVersion = XR_MAKE_VERSION(1, 0, 0);
  std::strcpy(out->runtimeName, "fake");
  return XR_SUCCESS;
}
XrResult XRAPI_CALL get_system(XrInstance, const XrSystemGetInfo* info, XrSystemId* out) {
  if (info->formFactor != XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY) return XR_ERROR_FORM_FACTOR_UNSUPPORTED;
  if (headset().empty()) return XR_ERROR_FORM_FACTOR_UNAVAILABLE;
  *out = kSystem;
  return XR_SUCCESS;
}
XrResult XRAPI_CALL get_system_properties(XrInstance, XrSystemId, XrSystemProperties* out) {
  for (auto* each = static_cast<Structure*>(out->next); each != nullptr; each = each->next)
    if (each->type == XR_TYPE_SYSTEM_HAND_TRACKING_PROPERTIES_EXT)
      reinterpret_cast<XrSystemHandTrackingPropertiesEXT*>(each)->supportsHandTracking = XR_TRUE;
  return XR_SUCCESS;
}
XrResult XRAPI_CALL create_session(XrInstance, const XrSessionCreateInfo* info, XrSession* out) {
  const std::lock_guard lock(mutex);
  if (info->next != nullptr || info->systemId != kSystem || has_session) return XR_ERROR_VALIDATION_FAILURE;
  *out = handle<XrSession>(kSession);
  has_session = true;
  is_lost = false;
  events.clear();
  go(XR_SESSION_STATE_IDLE);
  go(XR_SESSION_STATE_READY);
  return XR_SUCCESS;
}
XrResult XRAPI_CALL destroy_session(XrSession) {
  const std::lock_guard lock(mutex);
  has_session = is_running = false;
  return XR_SUCCESS;
}
XrResult XRAPI_CALL begin_session(XrSession, const XrSessionBeginInfo*) {
  const std::lock_guard lock(mutex);
  is_running = true;
  for (const XrSessionState state : {XR_SESSION_STATE_SYNCHRONIZED, XR_SESSION_STATE_VISIBLE, XR_SESSION_STATE_FOCUSED})
    go(state);
  return XR_SUCCESS;
}
XrResult XRAPI_CALL end_session(XrSession) {
  const std::lock_guard lock(mutex);
  is_running = false;
  for (const XrSessionState state : {XR_SESSION_STATE_IDLE, XR_SESSION_STATE_EXITING}) go(state);
  return XR_SUCCESS;
}
XrResult XRAPI_CALL request_exit_session(XrSession) {
  const std::lock_guard lock(mutex);
  go(XR_SESSION_STATE_STOPPING);
  return XR_SUCCESS;
}
XrResult XRAPI_CALL poll_event(XrInstance, XrEventDataBuffer* out) {
  const std::lock_guard lock(mutex);
  const std::string now = headset();
  if (is_running && !is_lost && (now.empty() || now == "on lost")) {
    is_lost = true;
    go(now.empty() ? XR_SESSION_STATE_LOSS_PENDING : XR_SESSION_STATE_STOPPING);
  }
  if (events.empty()) return XR_EVENT_UNAVAILABLE;
  auto& event = reinterpret_cast<XrEventDataSessionStateChanged&>(*out);
  event = {XR_TYPE_EVENT_DATA_SESSION_STATE_CHANGED, nullptr, handle<XrSession>(kSession), events.front(), 0};
  events.pop_front();
  return XR_SUCCESS;
}
XrResult XRAPI_CALL create_reference_space(XrSession, const XrReferenceSpaceCreateInfo* info, XrSpace* out) {
  *out = handle<XrSpace>(info->referenceSpaceType == XR_REFERENCE_SPACE_TYPE_VIEW ? kView : kStage);
  return XR_SUCCESS;
}
XrResult XRAPI_CALL destroy_space(XrSpace) { return XR_SUCCESS; }
XrResult XRAPI_CALL locate_space(XrSpace space, XrSpace base, XrTime, XrSpaceLocation* out) {
  if (space != handle<XrSpace>(kView) || base != handle<XrSpace>(kStage)) return XR_ERROR_VALIDATION_FAILURE;
  out->locationFlags = 15;
  out->pose = {{0, 0, 0, 1}, {0, 1.6f, 0}};
  return XR_SUCCESS;
}
XrResult XRAPI_CALL create_hand_tracker(XrSession, const XrHandTrackerCreateInfoEXT* info, XrHandTrackerEXT* out) {
  *out = handle<XrHandTrackerEXT>(info->hand == XR_HAND_LEFT_EXT ? kLeft : kRight);
  has_sources = info->next != nullptr && static_cast<const Structure*>(info->next)->type == kDataSourceInfo;
  return XR_SUCCESS;
}
XrResult XRAPI_CALL destroy_hand_tracker(XrHandTrackerEXT) { return XR_SUCCESS; }
XrResult XRAPI_CALL locate_hand_joints(XrHandTrackerEXT tracker, const XrHandJointsLocateInfoEXT* info,
                                       XrHandJointLocationsEXT* out) {
  if (out->jointCount != XR_HAND_JOINT_COUNT_EXT || info->baseSpace != handle<XrSpace>(kStage) || info->time <= 0)
    return XR_ERROR_VALIDATION_FAILURE;
  const std::string now = headset();
  const bool is_left = tracker == handle<XrHandTrackerEXT>(kLeft);
  out->isActive = now == "on worn" || now == "on nan" ? XR_TRUE : XR_FALSE;
  const double seconds = static_cast<double>(info->time) * 1e-9;
  const auto sway = static_cast<float>(0.05 * std::sin(seconds)), speed = static_cast<float>(0.05 * std::cos(seconds));
  for (std::uint32_t j = 0; j < out->jointCount; ++j) {
    // Straight fingers side by side, 25 mm a bone.
    const float finger = j < 2 ? 2 : j < 6 ? 0 : static_cast<float>((j - 6) / 5 + 1);
    const float along = j < 2 ? 0 : static_cast<float>(j < 6 ? j - 2 : (j - 6) % 5) + 1;
    XrHandJointLocationEXT& joint = out->jointLocations[j];
    joint.locationFlags = 15;
    joint.pose = {
        {0, 0, 0, 1},
        {(is_left ? -0.2f : 0.2f) + (is_left ? -0.02f : 0.02f) * (finger - 2) + sway, 1.1f, -0.3f - 0.025f * along}};
    joint.radius = 0.009f;
    if (now == "on nan") joint.pose.position.x = std::numeric_limits<float>::quiet_NaN();
  }
  for (auto* each = static_cast<Structure*>(out->next); each != nullptr; each = each->next) {
    if (each->type == XR_TYPE_HAND_JOINT_VELOCITIES_EXT) {
      auto& velocities = *reinterpret_cast<XrHandJointVelocitiesEXT*>(each);
      for (std::uint32_t j = 0; j < velocities.jointCount; ++j)
        velocities.jointVelocities[j] = {3, {speed, 0, 0}, {0, 0, 0}};
    }
    if (each->type == kDataSourceState && has_sources) {
      auto& state = *reinterpret_cast<DataSourceState*>(each);
      state.is_active = XR_TRUE;
      state.source = is_left ? 2 : 1;  // the left hand holds a controller
    }
  }
  return XR_SUCCESS;
}
XrResult XRAPI_CALL to_time(XrInstance, const timespec* from, XrTime* out) {
  *out = from->tv_sec * 1'000'000'000 + from->tv_nsec;
  return XR_SUCCESS;
}

XrResult XRAPI_CALL get(XrInstance, const char* name, PFN_xrVoidFunction* out) {
  const std::pair<const char*, PFN_xrVoidFunction> functions[] = {
      {"xrGetInstanceProcAddr", reinterpret_cast<PFN_xrVoidFunction>(get)},
      {"xrEnumerateInstanceExtensionProperties", reinterpret_cast<PFN_xrVoidFunction>(enumerate_extensions)},
      {"xrCreateInstance", reinterpret_cast<PFN_xrVoidFunction>(create_instance)},
      {"xrDestroyInstance", reinterpret_cast<PFN_xrVoidFunction>(destroy_instance)},
      {"xrGetInstanceProperties", reinterpret_cast<PFN_xrVoidFunction>(get_instance_properties)},
      {"xrGetSystem", reinterpret_cast<PFN_xrVoidFunction>(get_system)},
      {"xrGetSystemProperties", reinterpret_cast<PFN_xrVoidFunction>(get_system_properties)},
      {"xrCreateSession", reinterpret_cast<PFN_xrVoidFunction>(create_session)},
      {"xrDestroySession", reinterpret_cast<PFN_xrVoidFunction>(destroy_session)},
      {"xrBeginSession", reinterpret_cast<PFN_xrVoidFunction>(begin_session)},
      {"xrEndSession", reinterpret_cast<PFN_xrVoidFunction>(end_session)},
      {"xrRequestExitSession", reinterpret_cast<PFN_xrVoidFunction>(request_exit_session)},
      {"xrPollEvent", reinterpret_cast<PFN_xrVoidFunction>(poll_event)},
      {"xrCreateReferenceSpace", reinterpret_cast<PFN_xrVoidFunction>(create_reference_space)},
      {"xrDestroySpace", reinterpret_cast<PFN_xrVoidFunction>(destroy_space)},
      {"xrLocateSpace", reinterpret_cast<PFN_xrVoidFunction>(locate_space)},
      {"xrCreateHandTrackerEXT", reinterpret_cast<PFN_xrVoidFunction>(create_hand_tracker)},
      {"xrDestroyHandTrackerEXT", reinterpret_cast<PFN_xrVoidFunction>(destroy_hand_tracker)},
      {"xrLocateHandJointsEXT", reinterpret_cast<PFN_xrVoidFunction>(locate_hand_joints)},
      {"xrConvertTimespecTimeToTimeKHR", reinterpret_cast<PFN_xrVoidFunction>(to_time)}};
  *out = nullptr;
  for (const auto& [known, function] : functions)
    if (std::strcmp(known, name) == 0) *out = function;
  return *out != nullptr ? XR_SUCCESS : XR_ERROR_FUNCTION_UNSUPPORTED;
}

}  // namespace

extern "C" XrResult xrNegotiateLoaderRuntimeInterface(const NegotiateLoaderInfo* info, NegotiateRuntimeRequest* out) {
  if (info == nullptr || out == nullptr || info->type != 1 || out->type != 3) return XR_ERROR_INITIALIZATION_FAILED;
  out->interface = 1;
  out->api = XR_MAKE_VERSION(1, 0, 0);
  out->get = get;
  return XR_SUCCESS;
}
