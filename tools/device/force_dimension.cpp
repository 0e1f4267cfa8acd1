#include "tools/device/force_dimension.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <stdexcept>

#include "tools/device/force_dimension_library.h"
#include "tools/device/frames.h"

namespace hapticd {
namespace {

constexpr AxisMap base = {{2, -1, 3}};  // house from DHD: x to the person, y right, z up
constexpr AxisMap tool = {{2, 3, 1}};   // z along the handle's shaft, DHD's x
constexpr auto watchdog = static_cast<unsigned char>(8e-3 / dhd::watchdog_unit_s);

class ForceDimensionDevice final : public VendorDevice {
 public:
  ForceDimensionDevice(const std::string& library, const std::string& device, bool falcon)
      : dhd_(force_dimension_libraries(), library) {
    id_ = static_cast<char>(opened(device));
    const bool is_falcon = dhd_.system_type(id_) == dhd::falcon;
    const char* name = dhd_.system_name(id_);
    name_ = name ? name : "unnamed device";
    if (is_falcon != falcon) {
      const std::string found = name_;
      dhd_.close(id_);
      throw std::runtime_error("the device is a " + found + ": use `haptic device run " +
                               (is_falcon ? "falcon`" : "force-dimension`"));
    }
    const auto has = [&](bool (*what)(char)) { return what && what(id_); };
    if (unsigned short number = 0; dhd_.serial_number && dhd_.serial_number(&number, id_) >= 0 && number > 0)
      name_ += ", serial number " + std::to_string(number);
    if (has(dhd_.is_left_handed)) name_ += ", left-handed";
    turns_ = dhd_.pose && has(dhd_.has_wrist);
    wrench_ = dhd_.set_wrench && has(dhd_.has_active_wrist);
    if (has(dhd_.has_gripper) && dhd_.emulate_button) dhd_.emulate_button(1, id_);
    status_ = dhd_.status && dhd_.status(flags_, id_) >= 0;
    if (!dhd_.set_watchdog || dhd_.set_watchdog(watchdog, id_) < 0) name_ += ", no watchdog of its own";
    dhd_.enable_force(0, id_);
  }
  ~ForceDimensionDevice() override {
    command({});
    motors(false);
    dhd_.close(id_);
  }

  bool sample(Sample& sample) noexcept override {
    Vector p{};
    double r[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    if (turns_ ? failed(dhd_.pose(&p[0], &p[1], &p[2], r, id_), "dhdGetPositionAndOrientationFrame")
               : failed(dhd_.position(&p[0], &p[1], &p[2], id_), "dhdGetPosition"))
      return false;
    sample.reading.position = base.to_house(p);
    if (turns_) {
      const Rotation rows{{{r[0][0], r[0][1], r[0][2]}, {r[1][0], r[1][1], r[1][2]}, {r[2][0], r[2][1], r[2][2]}}};
      sample.reading.orientation = quaternion(to_house(base, rows, tool));
    }
    sample.reading.buttons = dhd_.button_mask(id_);
    if (status_ && failed(dhd_.status(flags_, id_), "dhdGetStatus")) return false;
    if (status_ && !flags_[dhd::status_force]) {
      const int cause = flags_[dhd::status_cause];
      if (cause == dhd::cause_button || cause == dhd::cause_dead_man)
        sample.reading.enable = false;
      else
        sample.motors_on = !on_ || cause == dhd::cause_none;
    }
    sample.at_ns = device_clock_ns();
    return failed_call_ == nullptr;
  }

  void command(const Feel& feel) noexcept override {
    const Vector f = base.to_maker(feel.force), t = base.to_maker(feel.torque);
    const bool lost = wrench_ ? failed(dhd_.set_wrench(f[0], f[1], f[2], t[0], t[1], t[2], 0, id_),
                                       "dhdSetForceAndTorqueAndGripperForce")
                              : failed(dhd_.set_force(f[0], f[1], f[2], id_), "dhdSetForce");
    if (lost) motors(false);
  }

  void motors(bool on) noexcept override {
    on_ = on;
    dhd_.enable_force(on ? 1 : 0, id_);
  }
  std::string name() const override { return name_; }
  std::string fault() const override { return std::string(failed_call_ ? failed_call_ : "") + ": " + words_; }
  const char* asks() const noexcept override {
    return status_ && flags_[dhd::status_reset] ? "put the handle into its calibration position" : "";
  }

 private:
  int opened(const std::string& device) {
    int number = -1;
    if (!device.empty()) {
      const auto [end, error] = std::from_chars(device.data(), device.data() + device.size(), number);
      if (error != std::errc{} || end != device.data() + device.size() || number < 0 || number > 127)
        throw std::invalid_argument("--device " + device + ": a number from 0, as `haptic device list` has them");
    }
    const int id = device.empty() ? dhd_.open() : dhd_.open_id(static_cast<char>(number));
    if (id < 0) throw std::runtime_error(std::string(device.empty() ? "dhdOpen: " : "dhdOpenID: ") + error());
    return id;
  }

  const char* error() const noexcept {
    const char* text = dhd_.last_error();
    return text ? text : "no reason given";
  }

  // Positive returns are no errors (DHD_TIMEGUARD, DHD_MOTOR_SATURATED). The first failure is the one to tell.
  bool failed(int code, const char* call) noexcept {
    if (code >= 0) return false;
    if (!failed_call_) {
      failed_call_ = call;
      words_ = error();
    }
    return true;
  }

  dhd::Library dhd_;
  char id_ = -1;
  std::string name_;
  bool turns_ = false, wrench_ = false, status_ = false;
  std::atomic<bool> on_{false};
  int flags_[dhd::status_count] = {};
  const char* failed_call_ = nullptr;
  const char* words_ = "";
};

}  // namespace

const std::vector<std::string>& force_dimension_libraries() {
  static const std::vector<std::string> names = {"libdhd.so", "libdhd.so.3", "libdrd.so"};
  return names;
}

int force_dimension_count(const std::string& library) {
  const dhd::Library dhd(force_dimension_libraries(), library);
  return std::max(0, dhd.device_count());
}

std::unique_ptr<VendorDevice> open_force_dimension(const std::string& library, const std::string& device,
                                                   bool falcon) {
  return std::make_unique<ForceDimensionDevice>(library, device, falcon);
}

}  // namespace hapticd
