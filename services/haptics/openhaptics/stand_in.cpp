// A library with the functions of HD that the driver calls, for tests. Its scheduler calls back at 1 kHz.
#include "stand_in.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <thread>

namespace {

using softhand::HdStandIn;

HdStandIn& device() {
  static HdStandIn own;
  static HdStandIn* const shared = [] {
    const char* path = std::getenv(softhand::kHdStandInFile);
    const int file = path == nullptr ? -1 : open(path, O_RDWR | O_CLOEXEC);
    void* bytes = file < 0 ? MAP_FAILED : mmap(nullptr, sizeof(HdStandIn), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (file >= 0) close(file);
    return bytes == MAP_FAILED ? &own : static_cast<HdStandIn*>(bytes);
  }();
  return *shared;
}

struct Error {
  unsigned code;
  int internal_code;
  unsigned device;
};
using Callback = unsigned (*)(void*);
constexpr unsigned kDevice = 5, kNoDevice = 0xffffffff, kCommunication = 0x0302;

thread_local bool is_in_frame = false;
thread_local bool is_scheduler = false;
std::atomic<unsigned> newest_error{0};
Callback scheduled = nullptr;
void* scheduled_data = nullptr;
std::atomic<bool> stop{false};
std::thread scheduler;

void check_frame() {
  if (!is_in_frame || !is_scheduler) ++device().outside;
}

}  // namespace

extern "C" {
unsigned hdInitDevice(const char*) {
  if (!device().is_present) return kNoDevice;
  ++device().opened;
  newest_error = device().init_error.exchange(0);
  return kDevice;
}
void hdDisableDevice(unsigned) {
  ++device().closed;
  bool is_zero = true;
  for (const auto& force : device().force) is_zero = is_zero && force == 0;
  device().was_zero_at_close = is_zero;
  device().is_enabled = false;
}
void hdMakeCurrentDevice(unsigned) {}
void hdEnable(unsigned capability) { device().is_enabled = capability == 0x4000; }
Error hdGetError() {
  if (!device().is_present) return {kCommunication, 0, kDevice};
  const unsigned newest = newest_error.exchange(0);
  if (newest != 0 || device().older_errors == 0) return {newest, 0, kDevice};
  --device().older_errors;
  return {kCommunication, 0, kDevice};
}
unsigned long hdScheduleAsynchronous(Callback callback, void* data, unsigned short) {
  scheduled = callback;
  scheduled_data = data;
  return 1;
}
void hdStartScheduler() {
  stop = false;
  scheduler = std::thread([] {
    is_scheduler = true;
    while (!stop && scheduled != nullptr) {
      if (scheduled(scheduled_data) == 0) scheduled = nullptr;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
}
void hdStopScheduler() {
  stop = true;
  if (scheduler.joinable()) scheduler.join();
}
void hdBeginFrame(unsigned) { is_in_frame = true; }
void hdEndFrame(unsigned) {
  check_frame();
  is_in_frame = false;
  newest_error = device().error.load();
  ++device().frames;
}
void hdGetDoublev(unsigned parameter, double* values) {
  check_frame();
  if (parameter != 0x2050) return;
  for (std::size_t i = 0; i < 3; ++i) values[i] = device().position[i];
}
void hdSetDoublev(unsigned parameter, const double* values) {
  check_frame();
  if (parameter != 0x2700 || !device().is_enabled) return;
  for (std::size_t i = 0; i < 3; ++i) device().force[i] = values[i];
}
}
