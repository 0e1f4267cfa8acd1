#include "tools/device/openhaptics.h"

#include <algorithm>
#include <atomic>
#include <stdexcept>

#include "haptic/channel.h"
#include "tools/device/frames.h"
#include "tools/device/openhaptics_library.h"

namespace hapticd {
namespace {

constexpr std::int64_t force_lasts_ns = 8'000'000;   // without a newer one
constexpr std::int64_t force_error_ns = 500'000'000;  // a pause after the library refused a force
constexpr AxisMap base = {{1, -3, 2}};               // house from HDAPI: x right, y up, z to the person
constexpr AxisMap tool = {{1, 2, 3}};

// What crosses between the maker's thread and the driver's.
struct Tick {
  std::array<double, 16> transform{};
  int buttons = 0;
  std::int64_t at_ns = 0;
  unsigned int calibration = hd::calibration_ok;
};
struct Command {
  std::array<double, 3> force{};
  std::int64_t at_ns = 0;
};

class OpenHapticsDevice final : public VendorDevice {
 public:
  OpenHapticsDevice(const std::string& library, const std::string& device)
      : hd_(openhaptics_libraries(), library) {
    handle_ = hd_.init_device(device.empty() ? nullptr : device.c_str());
    if (const hd::ErrorInfo error = hd_.get_error(); error.code != 0 || handle_ == hd::invalid_handle)
      throw std::runtime_error("hdInitDevice(\"" + (device.empty() ? "default" : device) +
                               "\"): " + words(error.code));
    hd_.make_current(handle_);
    hd_.disable(hd::force_output);
    const auto text = [&](unsigned int what) {
      const char* s = hd_.get_string(what);
      return std::string(s ? s : "");
    };
    name_ = text(hd::device_model_type);
    if (const std::string serial = text(hd::device_serial_number); !serial.empty()) name_ += ", " + serial;
    int styles = 0;
    hd_.get_integers(hd::calibration_style, &styles);
    // The order of the maker's example: what needs the person least, last.
    for (const int style : {hd::style_encoder_reset, hd::style_inkwell, hd::style_auto})
      if (styles & style) style_ = style;
    hd_.get_error();
    last_tick_ns_ = device_clock_ns();
    callback_ = hd_.schedule([](void* self) { return static_cast<OpenHapticsDevice*>(self)->tick(); }, this,
                             hd::highest_priority);
    hd_.start_scheduler();
    if (const hd::ErrorInfo error = hd_.get_error(); error.code != 0) {
      stop();
      throw std::runtime_error("hdStartScheduler: " + words(error.code));
    }
  }
  ~OpenHapticsDevice() override {
    motors(false);
    stop();
  }

  bool sample(Sample& sample) noexcept override {
    if (ticks_.acquire()) last_tick_ns_ = ticks_.front().at_ns;
    const Tick& tick = ticks_.front();
    const auto& t = tick.transform;
    sample.at_ns = last_tick_ns_;
    sample.reading.position = base.to_house({1e-3 * t[12], 1e-3 * t[13], 1e-3 * t[14]});
    const Rotation r{{{t[0], t[4], t[8]}, {t[1], t[5], t[9]}, {t[2], t[6], t[10]}}};
    sample.reading.orientation = tick.at_ns > 0 ? quaternion(to_house(base, r, tool)) : Reading{}.orientation;
    sample.reading.buttons = static_cast<std::uint32_t>(tick.buttons);
    calibration_ = tick.calibration;
    fault_ = error_.load();
    if (fault_ != 0) return false;
    sample.motors_on = device_clock_ns() >= refused_until_ns_.load();
    return true;
  }

  void command(const Feel& feel) noexcept override {
    const Vector force = base.to_maker(feel.force);
    if (force == Vector{}) {
      // The maker's thread sets zero from now on. The change is awaited, for this may be the process's last.
      if (zero_.exchange(true)) return;
      constexpr timespec look = {0, 100'000};
      for (int i = 0; i < 30 && !zero_set_.load(); ++i) nanosleep(&look, nullptr);
      return;
    }
    commands_.back() = {force, device_clock_ns()};
    commands_.publish();
    zero_set_.store(false);
    zero_.store(false);
  }

  void motors(bool on) noexcept override { on ? hd_.enable(hd::force_output) : hd_.disable(hd::force_output); }
  std::string name() const override { return name_; }
  std::string fault() const override { return words(fault_); }
  const char* asks() const noexcept override {
    return calibration_ == hd::calibration_ok ? "" : "put the stylus into its inkwell, to calibrate";
  }

 private:
  std::string words(unsigned int code) const {
    const char* text = hd_.error_string(code);
    return text ? text : "error " + std::to_string(code);
  }

  void stop() noexcept {
    hd_.unschedule(callback_);
    hd_.stop_scheduler();
    hd_.disable_device(handle_);
  }

  // In the maker's thread.
  unsigned int tick() noexcept {
    Tick& tick = ticks_.back();
    hd_.begin_frame(handle_);
    tick.calibration = hd_.check_calibration();
    if (tick.calibration == hd::calibration_needs_update)
      hd_.update_calibration(static_cast<unsigned int>(style_));
    hd_.get_doubles(hd::current_transform, tick.transform.data());
    hd_.get_integers(hd::current_buttons, &tick.buttons);
    tick.at_ns = device_clock_ns();
    commands_.acquire();
    const Command& newest = commands_.front();
    const bool zero = zero_.load() || tick.at_ns - newest.at_ns > force_lasts_ns;
    static constexpr std::array<double, 3> none{};
    hd_.set_doubles(hd::current_force, zero ? none.data() : newest.force.data());
    hd_.end_frame(handle_);
    if (zero) zero_set_.store(true);
    const unsigned int error = hd_.get_error().code;
    if (error != 0 && (error & 0xFF00u) != hd::force_errors)
      error_.store(error);
    else if (error != 0 && error != hd::warm_motors)
      refused_until_ns_.store(tick.at_ns + force_error_ns);
    ticks_.publish();
    return hd::callback_continue;
  }

  hd::Library hd_;
  hd::Handle handle_ = hd::invalid_handle;
  int style_ = hd::style_auto;
  unsigned long callback_ = 0;
  std::string name_;
  std::int64_t last_tick_ns_ = 0;
  unsigned int calibration_ = hd::calibration_ok, fault_ = 0;
  Channel<Tick> ticks_;
  Channel<Command> commands_;
  std::atomic<bool> zero_{true}, zero_set_{true};
  std::atomic<unsigned int> error_{0};
  std::atomic<std::int64_t> refused_until_ns_{0};
};

}  // namespace

const std::vector<std::string>& openhaptics_libraries() {
  static const std::vector<std::string> names = {"libHD.so", "libHD.so.3.5", "libHD.so.3.4"};
  return names;
}

std::unique_ptr<VendorDevice> open_openhaptics(const std::string& library, const std::string& device) {
  return std::make_unique<OpenHapticsDevice>(library, device);
}

}  // namespace hapticd
