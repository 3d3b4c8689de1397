// A rig of real processes under `softhand up`, and readers of its topics. Times come from the messages' own stamps, so
// they do not depend on when the test ran.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "messages/messages.hpp"

namespace softhand::rig {

/// A finished program: its exit code, and its output on stdout and stderr together.
struct Finished {
  int exit_code = -1;
  std::string output;
};
Finished run_program(const std::vector<std::string>& command);

/// A running program. The destructor ends it.
class Program {
 public:
  explicit Program(const std::vector<std::string>& command);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  void send_signal(int number) const;
  /// Returns the exit code, or -1 if the process did not end in time.
  int wait(std::chrono::milliseconds timeout);
  std::string output() const;
  pid_t process_id() const { return pid_; }

 private:
  std::string log_;
  pid_t pid_ = 0;
};

/// A running `softhand up`.
class Up : public Program {
 public:
  /// `rig` is relative to the source tree.
  Up(const std::string& rig, const std::vector<std::string>& arguments);
};

/// True while a process with this id exists and is not a zombie.
bool is_alive(std::uint32_t process_id);

/// Reads all published data that the tests need.
class RigListener {
 public:
  RigListener();
  void poll();
  /// Polls until `done`. Returns false if this takes longer than `timeout`.
  bool wait(std::chrono::milliseconds timeout, const std::function<bool()>& done);
  void listen(std::chrono::milliseconds duration) {
    wait(duration, [] { return false; });
  }

  struct DeviceSample {
    Nanoseconds time;  // published
    std::uint64_t epoch;
    bool live;
    double largest_command;
  };
  struct HandSample {
    Nanoseconds time;  // published
    std::uint64_t epoch;
    Nanoseconds tracker_sample;  // the one that led to this sample; 0 = none
    double follow_error;  // m, mean distance of its joints from the tracked ones; negative: no tracked hand at its time
    Vec3 wrist;
  };
  struct TrackedSample {
    Nanoseconds time;  // of the sample
    Nanoseconds published;
    std::uint32_t source;
    std::array<Vec3, kJointCount> joints;
  };
  std::map<std::string, LoopStatus> modules;                   ///< newest status of each module
  std::map<std::string, std::map<std::string, double>> peaks;  ///< largest value of each counter, by module
  std::map<std::uint32_t, std::deque<DeviceSample>> devices;
  std::deque<HandSample> simulated;
  std::deque<TrackedSample> tracked;
  std::map<std::uint32_t, Vec3> objects;       ///< newest position by the world's number, m
  std::map<std::string, std::uint64_t> heard;  ///< samples by topic
  std::map<std::string, std::uint64_t>
      nonfinite;  ///< of these, samples with NaN or infinity in a valid joint or object

  double counter(const std::string& module, const std::string& name) const;
  /// -1 before its first status.
  std::int64_t process_id(const std::string& module) const;
  bool device_is_on(std::uint32_t device) const;  ///< live with a command that is not zero

 private:
  void take_skeleton(const Skeleton& skeleton, const char* topic);
  double follow_error(const Skeleton& simulated) const;

  bus::Participant participant_;
  bus::Reader<LoopStatus> status_;
  bus::Reader<Skeleton> tracked_;
  bus::Reader<Skeleton> intermediate_;
  bus::Reader<Skeleton> simulated_;
  bus::Reader<Contacts> contacts_;
  bus::Reader<SkinTraction> traction_;
  bus::Reader<ObjectCoupling> coupling_;
  bus::Reader<WorldObjects> objects_;
  bus::Reader<BoneWrench> wrench_;
  bus::Reader<DeviceState> device_;
};

}  // namespace softhand::rig
