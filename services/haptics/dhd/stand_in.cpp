// A library with the functions of DHD that the driver calls, for tests.
#include "stand_in.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>

namespace {

using softhand::DhdStandIn;

DhdStandIn& device() {
  static DhdStandIn own;
  static DhdStandIn* const shared = [] {
    const char* path = std::getenv(softhand::kDhdStandInFile);
    const int file = path == nullptr ? -1 : open(path, O_RDWR | O_CLOEXEC);
    void* bytes =
        file < 0 ? MAP_FAILED : mmap(nullptr, sizeof(DhdStandIn), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (file >= 0) close(file);
    return bytes == MAP_FAILED ? &own : static_cast<DhdStandIn*>(bytes);
  }();
  return *shared;
}

constexpr char kId = 3;
// Every other call returns 1, the time guard: no error.
bool is_odd = false;
int answer(char id) {
  if (!device().is_present || id != kId) return -1;
  is_odd = !is_odd;
  return is_odd ? 1 : 0;
}

}  // namespace

extern "C" {
int dhdGetDeviceCount() { return device().is_present ? 1 : 0; }
int dhdOpen() {
  if (!device().is_present) return -1;
  ++device().opened;
  return kId;
}
int dhdOpenID(char index) { return index == 0 ? dhdOpen() : -1; }
int dhdClose(char id) {
  ++device().closed;
  bool is_zero = true;
  for (const auto& force : device().force) is_zero = is_zero && force == 0;
  device().was_zero_at_close = is_zero;
  device().is_enabled = false;
  return answer(id);
}
int dhdEnableForce(unsigned char enable, char id) {
  device().is_enabled = enable != 0;
  return answer(id);
}
int dhdSetGravityCompensation(int, char id) { return answer(id); }
int dhdGetPosition(double* x, double* y, double* z, char id) {
  *x = device().position[0];
  *y = device().position[1];
  *z = device().position[2];
  return answer(id);
}
int dhdSetForce(double x, double y, double z, char id) {
  device().force[0] = x;
  device().force[1] = y;
  device().force[2] = z;
  ++device().forces;
  return answer(id);
}
const char* dhdErrorGetLastStr() { return "stand-in: no device"; }
}
