#include "trackers/leap/leapc_service.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <memory>
#include <stdexcept>

#include "messages/convert.hpp"
#include "runtime/clock.hpp"

namespace softhand {
namespace {

constexpr double kMetresPerLeapUnit = 1e-3;
constexpr std::uint32_t kPollTime = 50;    // ms; a stop is noticed after it
constexpr std::uint32_t kMostHands = 100;  // in a frame; more are not those of people

Vec3 vector_of(const float* v) { return {v[0], v[1], v[2]}; }
Vec3 point_of(const float* v) {
  Vec3 out = vector_of(v);
  for (double& value : out) value *= kMetresPerLeapUnit;
  return out;
}
Vec3 dorsal_of(const float* q) { return to_wire(Vector3(Quaternion(q[3], q[0], q[1], q[2]) * Vector3::UnitY())); }

LeapHand hand_of(const leapc::Hand& from) {
  LeapHand hand;
  hand.side = from.type == 0 ? 0 : 1;
  hand.confidence = from.confidence;
  hand.palm = point_of(from.palm.position);
  hand.direction = vector_of(from.palm.direction);
  hand.normal = vector_of(from.palm.normal);
  hand.has_bones = true;
  hand.wrist = point_of(from.arm.next_joint);
  for (std::size_t finger = 0; finger < hand.bones.size(); ++finger) {
    for (std::size_t k = 0; k < hand.bones[finger].size(); ++k) {
      const leapc::Bone& bone = from.digits[finger].bones[k];
      hand.bones[finger][k] = {point_of(bone.previous_joint), point_of(bone.next_joint), dorsal_of(bone.rotation),
                               static_cast<double>(bone.width) * kMetresPerLeapUnit};
    }
  }
  return hand;
}

struct Library {
  explicit Library(const std::string& path) : handle(dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (handle == nullptr) throw std::runtime_error("LeapC cannot be loaded: " + std::string(dlerror()));
    load(create, "LeapCreateConnection");
    load(open, "LeapOpenConnection");
    load(poll, "LeapPollConnection");
    load(set_policy, "LeapSetPolicyFlags");
    load(get_now, "LeapGetNow");
    load(close, "LeapCloseConnection");
    load(destroy, "LeapDestroyConnection");
    // Libraries before version 5 lack it.
    set_mode = reinterpret_cast<leapc::SetTrackingMode>(dlsym(handle, "LeapSetTrackingMode"));
  }
  template <typename Function>
  void load(Function& function, const char* name) const {
    function = reinterpret_cast<Function>(dlsym(handle, name));
    if (function == nullptr) throw std::runtime_error("LeapC cannot be used: it lacks " + std::string(name));
  }

  void* handle;  // never closed: the library may have threads
  leapc::CreateConnection create;
  leapc::OpenConnection open;
  leapc::PollConnection poll;
  leapc::SetTrackingMode set_mode;
  leapc::SetPolicyFlags set_policy;
  leapc::GetNow get_now;
  leapc::CloseConnection close;
  leapc::DestroyConnection destroy;
};

class Connection {
 public:
  explicit Connection(const Library& library) : library_(library) {
    if (library.create(nullptr, &connection_) != leapc::kSuccess) throw std::runtime_error("LeapC: no connection");
    is_good_ = library.open(connection_) == leapc::kSuccess;
  }
  ~Connection() {
    library_.close(connection_);
    library_.destroy(connection_);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void run(DeviceThread& thread, std::int32_t mode) {
    while (is_good_ && !thread.stops()) {
      leapc::Message message{};
      message.size = sizeof message;
      const std::uint32_t result = library_.poll(connection_, kPollTime, &message);
      if (result == leapc::kTimeout) continue;
      if (result != leapc::kSuccess || message.type == leapc::kConnectionLost) return;
      if (message.type == leapc::kConnected) {
        if (library_.set_mode != nullptr) library_.set_mode(connection_, mode);
        library_.set_policy(connection_, leapc::kBackgroundFrames, 0);
        thread.opened();
      }
      if (message.type != leapc::kTracking || message.event == nullptr) continue;
      const Nanoseconds arrival = now();
      // The event is valid until the next poll.
      const auto& event = *static_cast<const leapc::TrackingEvent*>(message.event);
      thread.push(read_leapc(event, arrival - library_.get_now() * 1000).bytes(), arrival);
    }
  }

 private:
  const Library& library_;
  leapc::Connection connection_ = nullptr;
  bool is_good_ = false;
};

}  // namespace

LeapFrame read_leapc(const leapc::TrackingEvent& event, Nanoseconds offset) {
  constexpr std::int64_t kLatest = 4'000'000'000'000'000;  // us, more than a century
  LeapFrame frame;
  if (event.timestamp < 0 || event.timestamp > kLatest || event.hand_count > kMostHands ||
      (event.hands == nullptr && event.hand_count > 0)) {
    frame.refusal = LeapRefusal::content;
    return frame;
  }
  frame.has_our_time = true;
  frame.time = event.timestamp * 1000 + offset;
  for (std::uint32_t i = 0; i < event.hand_count; ++i) {
    const LeapHand hand = hand_of(event.hands[i]);
    if (!is_plausible(hand)) {
      frame = LeapFrame{};
      frame.refusal = LeapRefusal::content;
      return frame;
    }
    add_hand(frame, hand);
  }
  return frame;
}

DeviceThread::Session leapc_session(const std::string& library, const std::string& mounting) {
  const std::int32_t mode = mounting == "headset" ? 1 : mounting == "screen" ? 2 : 0;
  return [=, loaded = std::shared_ptr<Library>()](DeviceThread& thread) mutable {
    if (!loaded) loaded = std::make_shared<Library>(library);
    Connection(*loaded).run(thread, mode);
  };
}

}  // namespace softhand
