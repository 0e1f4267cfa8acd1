// libHD as the OpenHaptics API Reference describes it, for one Touch that is a FakeDevice: a scheduler of 1 kHz
// in a thread of its own, frames whose force counts from hdEndFrame on, errors that wait for hdGetError.
#include <pthread.h>

#include <thread>

#include "tests/support/devices/fake_device.h"

namespace {

using hapticd::FakeDevice;
using hapticd::fake_device;

struct HDErrorInfo {
  unsigned int errorCode;
  int internalErrorCode;
  unsigned int hHD;
};

std::atomic<unsigned> error{0};
std::atomic<bool> running{false};
std::thread scheduler;
unsigned int (*callback)(void*) = nullptr;
void* user_data = nullptr;
std::array<double, 3> force_of_frame{};

void run() {
  sched_param priority{};
  priority.sched_priority = 55;
  pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
  while (running) {
    hapticd::fake_sleep(fake_device().fault == FakeDevice::slow ? 50'000'000 : 1'000'000);
    if (running && callback) callback(user_data);
  }
}

}  // namespace

extern "C" {

unsigned int hdInitDevice(const char* name) {
  if (name && std::string(name) != "Default Device") {
    error = 0x0302;
    return 0xFFFFFFFF;
  }
  fake_device().open = 1;
  return 0;
}
void hdDisableDevice(unsigned int) {
  fake_device().set_motors(false);
  fake_device().open = 0;
}
void hdMakeCurrentDevice(unsigned int) {}
void hdBeginFrame(unsigned int) {}
void hdEndFrame(unsigned int) {
  FakeDevice& device = fake_device();
  device.set_force(force_of_frame[0], force_of_frame[1], force_of_frame[2]);
  if (device.fault == FakeDevice::unplugged) error = 0x0302;                     // HD_COMM_ERROR
  if (device.fault == FakeDevice::call_fails) error = 0x0300;                    // HD_DEVICE_FAULT
  int refused = FakeDevice::refused;
  if (device.fault.compare_exchange_strong(refused, FakeDevice::none)) error = 0x0201;  // HD_EXCEEDED_MAX_FORCE
}
void hdGetIntegerv(unsigned int what, int* value) {
  if (what == 0x2000) *value = static_cast<int>(fake_device().buttons.load());
  if (what == 0x2555) *value = 4;  // HD_CALIBRATION_INKWELL
}
void hdGetDoublev(unsigned int what, double* value) {
  FakeDevice& device = fake_device();
  while (device.fault == FakeDevice::hangs) hapticd::fake_sleep(1'000'000);
  if (what != 0x2052) return;
  for (std::size_t column = 0; column < 4; ++column)
    for (std::size_t row = 0; row < 4; ++row)
      value[4 * column + row] = row == 3      ? (column == 3 ? 1 : 0)
                                : column == 3 ? device.position[row].load()
                                              : device.rotation[row][column];
}
void hdSetDoublev(unsigned int what, const double* value) {
  if (what == 0x2700) force_of_frame = {value[0], value[1], value[2]};
}
const char* hdGetString(unsigned int what) { return what == 0x2501 ? "Touch" : what == 0x2504 ? "2016-0042" : ""; }
void hdEnable(unsigned int what) {
  if (what == 0x4000) fake_device().set_motors(true);
}
void hdDisable(unsigned int what) {
  if (what == 0x4000) fake_device().set_motors(false);
}
HDErrorInfo hdGetError() { return {error.exchange(0), 0, 0}; }
const char* hdGetErrorString(unsigned int code) {
  return code == 0x0302   ? "HD_COMM_ERROR"
         : code == 0x0300 ? "HD_DEVICE_FAULT"
         : code == 0x0201 ? "HD_EXCEEDED_MAX_FORCE"
                          : "HD_SUCCESS";
}
unsigned int hdCheckCalibration() { return fake_device().calibrated ? 0x5000 : 0x5002; }
void hdUpdateCalibration(unsigned int) { ++fake_device().updates_of_calibration; }
void hdStartScheduler() {
  if (!running.exchange(true)) scheduler = std::thread(run);
}
void hdStopScheduler() {
  if (running.exchange(false)) scheduler.join();
}
unsigned long hdScheduleAsynchronous(unsigned int (*function)(void*), void* data, unsigned short) {
  callback = function;
  user_data = data;
  return 1;
}
void hdUnschedule(unsigned long) {}

}  // extern "C"
