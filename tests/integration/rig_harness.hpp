// A rig of real processes under `softhand up`, and ears on its topics. Figures come from the messages' own stamps, so
// that they do not depend on when the test got to run.
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

/// Sets SOFTHAND_DOMAIN of this process, and so of its children, to one that other tests on this machine hardly use.
void use_own_domain();

/// A finished program: exit code and what it printed on stdout and stderr together.
struct Finished {
  int exit_code = -1;
  std::string output;
};
Finished run_program(const std::vector<std::string>& command);

/// `softhand up`, running. Ends with its handle.
class Up {
 public:
  /// `rig` relative to the source tree.
  Up(const std::string& rig, const std::vector<std::string>& arguments);
  ~Up();
  Up(const Up&) = delete;
  Up& operator=(const Up&) = delete;
  void send_signal(int number) const;
  /// Exit code, or -1 where it did not end in time.
  int wait(std::chrono::milliseconds timeout);
  std::string output() const;

 private:
  pid_t pid_ = 0;
  std::string log_;
};

/// True while a process with this id exists and is no zombie.
bool is_alive(std::uint32_t process_id);

/// Everything that is published, as far as the tests ask.
class Ears {
 public:
  Ears();
  void poll();
  /// Polls until `done`; false where that took longer than `timeout`.
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
    Nanoseconds tracker_sample;  // that led to it; 0 = none
    double
        follow_error;  // m, mean distance of its joints from the tracked ones; negative = nothing tracked at its time
    Vec3 wrist;
  };
  struct TrackedSample {
    Nanoseconds time;  // of the sample
    Nanoseconds published;
    std::uint32_t source;
    std::array<Vec3, kJointCount> joints;
  };
  std::map<std::string, LoopStatus> modules;                   ///< newest of each
  std::map<std::string, std::map<std::string, double>> peaks;  ///< largest value of each counter, by module
  std::map<std::uint32_t, std::deque<DeviceSample>> devices;
  std::deque<HandSample> simulated;
  std::deque<TrackedSample> tracked;
  std::map<std::uint32_t, Vec3> objects;       ///< newest position by the world's number, m
  std::map<std::string, std::uint64_t> heard;  ///< samples by topic
  std::map<std::string, std::uint64_t>
      nonfinite;  ///< of these, those with a number that is none, where the joint or object is said to be valid

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
  bus::Reader<ObjectCoupling> coupling_;
  bus::Reader<WorldObjects> objects_;
  bus::Reader<BoneWrench> wrench_;
  bus::Reader<DeviceState> device_;
};

}  // namespace softhand::rig
