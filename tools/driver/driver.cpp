#include "tools/driver/driver.h"

#include <sys/prctl.h>
#include <time.h>

#include <algorithm>
#include <optional>

#include "server/dds/force_reader.h"
#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "server/scene/device_reader.h"
#include "tools/driver/ending.h"
#include "tools/driver/force_watch.h"

namespace hapticd {
namespace {

constexpr std::int64_t period_ns = 1'000'000;
constexpr std::int64_t margin_ns = 100'000;  // left of a slot when waiting for its answer ends
constexpr int fifo_priority = 50;            // below the daemon's loop (80) and Cyclone's threads (70, 60)

DeviceSettings limits_of(const std::string& device) {
  if (device.empty())
    throw std::invalid_argument(
        "DriverOptions::device is empty: whose limits may its forces reach? Name a file of config/devices "
        "(touch, "
        "omega_6, …) or give one of your own, with a slash or .yaml in it");
  return read_named_device(device, std::filesystem::current_path()).limits;
}

std::int64_t now_ns() noexcept {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1'000'000'000 * t.tv_sec + t.tv_nsec;
}

Domain make_domain(const DriverOptions& options) {
  if (options.open_network) open_network();
  return Domain(options.domain, default_dds_profile());
}

class Driver {
 public:
  Driver(HapticDevice& device, const DriverOptions& options, const DeviceSettings& limits, Ending& ending)
      : device_(device),
        options_(options),
        ending_(ending),
        domain_(make_domain(options)),
        participant_(domain_, options.keys.empty() ? std::nullopt
                                                   : std::optional(security_files(options.keys, "device"))),
        states_(participant_),
        forces_(participant_, options.device_id, ForceReader::Side::client),
        arrival_(require(dds_create_waitset(participant_.handle()), "a waitset")),
        watch_(limits) {
    require(dds_set_status_mask(forces_.handle(), DDS_DATA_AVAILABLE_STATUS), "a status mask");
    require(dds_waitset_attach(arrival_.handle(), forces_.handle(), 0), "a waitset");
    state_.device_id = options.device_id;
    report_.place = dds_place(options.domain, default_dds_profile_name());
  }

  // The device feels zero and the daemon knows that its client is gone, however the run ends.
  ~Driver() {
    try {
      device_.write({});
    } catch (...) {  // the first exception is the one to tell
    }
    ending_.at_zero();
    state_.enable = false;
    send();
    states_.dispose(state_);
  }
  Driver(const Driver&) = delete;
  Driver& operator=(const Driver&) = delete;

  DriverReport run() {
    if (options_.realtime)
      if (const Grant grant = use_fifo(fifo_priority); !grant.granted)
        report_.realtime_refused = grant.detail;
    prctl(PR_SET_TIMERSLACK, 1);
    std::int64_t next = now_ns();
    // Rising over a restart of the driver too.
    state_.number = static_cast<std::uint64_t>(next / period_ns);
    const std::int64_t end =
        options_.duration > 0 ? next + static_cast<std::int64_t>(1e9 * options_.duration) : INT64_MAX;
    for (;; next += period_ns * (1 + std::max<std::int64_t>(0, (now_ns() - next) / period_ns))) {
      const timespec t{next / 1'000'000'000, next % 1'000'000'000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
      if (ending_.asked()) return ended(DriverReport::End::signal);
      if (next >= end) return ended(DriverReport::End::duration);
      Reading reading;
      if (!device_.read(reading)) return ended(DriverReport::End::device_lost);
      slot(reading, next + period_ns - margin_ns);
    }
  }

 private:
  void slot(const Reading& reading, std::int64_t until_ns) {
    const std::uint32_t status = watch_.status();
    watch_.slot(forces_.stranger(now_ns()), reading.enable);
    std::copy(reading.position.begin(), reading.position.end(), state_.position);
    std::copy(reading.orientation.begin(), reading.orientation.end(), state_.orientation);
    state_.buttons = reading.buttons;
    state_.enable = arming_.enable(now_ns(), reading.enable, status & status_disarmed,
                                   (status & status_latched) || watch_.latched());
    send();
    ++report_.sent;
    // An answer to the state before may come first; it is felt too.
    bool written = false;
    while (true) {
      if (take()) {
        ++report_.answered;
        device_.write(watch_.feel(now_ns()));
        written = true;
      }
      const std::int64_t left = until_ns - now_ns();
      if (watch_.answered() == state_.number || left <= 0 || ending_.asked()) break;
      dds_waitset_wait(arrival_.handle(), nullptr, 0, left);
    }
    if (!written) device_.write(watch_.feel(now_ns()));
  }

  void send() noexcept {
    ++state_.number;
    state_.client_time_ns = now_ns();
    watch_.sent(state_.number, state_.client_time_ns);
    states_.write(state_);
  }

  // Whether a force came that answers a state of ours for the first time.
  bool take() noexcept {
    std::array<hapticd_msg_ForceCommand, 4> forces;
    std::array<dds_sample_info_t, 4> infos;
    const int n = forces_.take_into(forces, infos);
    bool fresh = false;
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const hapticd_msg_ForceCommand& f = forces[k];
      if (!infos[k].valid_data) continue;
      const Feel feel{
          {f.force[0], f.force[1], f.force[2]}, {f.torque[0], f.torque[1], f.torque[2]}, f.status};
      fresh |= watch_.heard(now_ns(), f.echo_number, f.echo_client_time_ns, feel);
    }
    return fresh;
  }

  DriverReport ended(DriverReport::End end) {
    report_.end = end;
    report_.strange_forces = forces_.strange_forces();
    report_.silences = watch_.silences();
    report_.longest_silence_ms = 1e-6 * static_cast<double>(watch_.longest_silence_ns());
    return report_;
  }

  HapticDevice& device_;
  DriverOptions options_;
  Ending& ending_;
  Domain domain_;
  Participant participant_;
  Writer<hapticd_msg_DeviceState> states_;
  ForceReader forces_;
  DdsEntity arrival_;
  ForceWatch watch_;
  Arming arming_;
  hapticd_msg_DeviceState state_{};
  DriverReport report_;
};

}  // namespace

DriverReport run_driver(HapticDevice& device, const DriverOptions& options) {
  const DeviceSettings limits = limits_of(options.device);
  Ending ending(device);
  Driver driver(device, options, limits, ending);
  return driver.run();
}

}  // namespace hapticd
