// libdhd as the Force Dimension SDK describes it, for one omega.6 (or, where FAKE_FALCON is set, a Falcon) that is
// a FakeDevice. Its firmware switches the motors off where dhdSetWatchdog's time passes without a force.
#include <thread>

#include "tests/support/devices/fake_device.h"

namespace {

using hapticd::FakeDevice;
using hapticd::fake_device;

const bool falcon = std::getenv("FAKE_FALCON") != nullptr;
const char* last_error = "no error";
std::atomic<int> cause{0};
std::atomic<std::int64_t> force_ns{0};
std::atomic<bool> powered{false};
std::thread firmware;

int failed(const char* what) {
  last_error = what;
  return -1;
}

int answer(int of_call = FakeDevice::unplugged) {
  const int fault = fake_device().fault;
  return fault == FakeDevice::unplugged || fault == of_call ? failed("communication error") : 0;
}

void watch() {
  while (powered) {
    hapticd::fake_sleep(250'000);
    FakeDevice& device = fake_device();
    const std::int64_t limit = 125'000 * device.watchdog;
    if (limit > 0 && device.motors && FakeDevice::now_ns() - force_ns > limit) {
      cause = 3;  // DHD_FORCEOFF_WATCHDOG
      device.set_motors(false);
    }
    if (device.person_switched_off && device.motors) {
      cause = 1;  // DHD_FORCEOFF_BUTTON
      device.set_motors(false);
    }
  }
}

void read_pose(double* x, double* y, double* z) {
  FakeDevice& device = fake_device();
  while (device.fault == FakeDevice::hangs) hapticd::fake_sleep(1'000'000);
  if (device.fault == FakeDevice::slow) hapticd::fake_sleep(50'000'000);
  *x = device.position[0];
  *y = device.position[1];
  *z = device.position[2];
}

}  // namespace

extern "C" {

int dhdGetDeviceCount() { return 1; }
int dhdOpenID(char id) {
  if (id != 0) return failed("no device found");
  fake_device().open = 1;
  powered = true;
  firmware = std::thread(watch);
  return 0;
}
int dhdOpen() { return dhdOpenID(0); }
int dhdClose(char) {
  if (powered.exchange(false)) firmware.join();
  fake_device().set_motors(false);
  fake_device().open = 0;
  return 0;
}
const char* dhdErrorGetLastStr() { return last_error; }
const char* dhdGetSystemName(char) { return falcon ? "Falcon" : "omega.6"; }
int dhdGetSystemType(char) { return falcon ? 60 : 36; }
int dhdGetSerialNumber(unsigned short* number, char) {
  *number = 1042;
  return 0;
}
bool dhdIsLeftHanded(char) { return !falcon; }
bool dhdHasWrist(char) { return !falcon; }
bool dhdHasActiveWrist(char) { return false; }
bool dhdHasGripper(char) { return false; }
int dhdEnableForce(unsigned char on, char) {
  if (on) {
    force_ns = FakeDevice::now_ns();
    cause = 0;
  } else {
    cause = 4;  // DHD_FORCEOFF_SOFTWARE
  }
  fake_device().set_motors(on != 0);
  return answer();
}
int dhdGetPosition(double* x, double* y, double* z, char) {
  read_pose(x, y, z);
  return answer(FakeDevice::call_fails);
}
int dhdGetPositionAndOrientationFrame(double* x, double* y, double* z, double r[3][3], char) {
  read_pose(x, y, z);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) r[i][j] = fake_device().rotation[i][j];
  return answer(FakeDevice::call_fails);
}
unsigned int dhdGetButtonMask(char) { return fake_device().buttons; }
int dhdGetStatus(int status[16], char) {
  for (int i = 0; i < 16; ++i) status[i] = 0;
  status[1] = 1;
  status[3] = fake_device().calibrated ? 0 : 1;
  status[5] = fake_device().motors ? 1 : 0;
  status[14] = cause;
  return answer();
}
int dhdSetWatchdog(unsigned char duration, char) {
  if (!fake_device().has_watchdog) return failed("not available");
  fake_device().watchdog = duration;
  return 0;
}
int dhdSetForce(double x, double y, double z, char) {
  if (fake_device().fault == FakeDevice::force_fails) return failed("communication error");
  force_ns = FakeDevice::now_ns();
  fake_device().set_force(x, y, z);
  return answer();
}

}  // extern "C"
