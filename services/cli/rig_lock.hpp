// One rig per domain. A rig holds a file lock, which other rigs of the same user on this host see at once. Rigs of
// other users and hosts see it on DDS.
#pragma once

#include <optional>
#include <string>

namespace softhand {

/// A `softhand up` that runs a rig.
struct RigHolder {
  std::string rig;
  std::string host;
  int process_id = 0;
};
std::string to_text(const RigHolder& holder);
/// This process, as the holder of `rig`.
RigHolder this_process(const std::string& rig);

/// The file softhand/rig-DOMAIN.lock in XDG_RUNTIME_DIR, or /tmp/softhand-USER/rig-DOMAIN.lock if the variable names no
/// folder of this user. The kernel releases the lock when the process ends in any way.
class RigLock {
 public:
  /// Throws std::runtime_error if the file cannot be opened.
  explicit RigLock(int domain);
  ~RigLock();
  RigLock(const RigLock&) = delete;
  RigLock& operator=(const RigLock&) = delete;

  /// Takes the lock and writes `self` into the file. Returns the holder if there is another one. Keeps a lock that it
  /// has.
  std::optional<RigHolder> take(const RigHolder& self);

 private:
  std::string path_;
  int file_ = -1;
  bool is_held_ = false;
};

}  // namespace softhand
