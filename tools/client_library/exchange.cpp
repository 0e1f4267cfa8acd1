#include "tools/client_library/exchange.h"

#include <sys/prctl.h>
#include <time.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>

#include "server/files/paths.h"
#include "server/scene/device_reader.h"

namespace hapticd {
namespace {

constexpr std::int64_t period_ns = 1'000'000;
constexpr std::int64_t margin_ns = 100'000;        // left of a slot when waiting for its answer ends
constexpr std::int64_t patience_ns = 150'000'000;  // for the first force, until nobody is there
constexpr std::int64_t other_stays_ns = 100'000'000;

DeviceSettings limits_of(const std::string& device) {
  if (device.empty())
    throw std::invalid_argument(
        "no device is named: whose limits may its forces reach? Name a file of config/devices (touch, "
        "omega_6, "
        "…) or give one of your own, with a slash or .yaml in it");
  return read_named_device(device, std::filesystem::current_path()).limits;
}

// A process has one of each number, as Cyclone does.
class Domains {
 public:
  static std::shared_ptr<Domain> open(const ExchangeSettings& settings) {
    static Domains domains;
    if (settings.open_network) open_network();
    const std::lock_guard lock(domains.mutex_);
    Entry& entry = domains.entries_[settings.domain];
    if (!entry.domain) entry.domain = std::make_unique<Domain>(settings.domain, default_dds_profile());
    ++entry.users;
    return {entry.domain.get(), [id = settings.domain](Domain*) {
              const std::lock_guard closing(domains.mutex_);
              Entry& used = domains.entries_[id];
              if (--used.users == 0) used.domain.reset();
            }};
  }

 private:
  struct Entry {
    std::unique_ptr<Domain> domain;
    int users = 0;
  };
  std::mutex mutex_;
  std::map<std::uint32_t, Entry> entries_;
};

// A pattern would hear several stations at once.
const std::string& checked_station(const std::string& station) {
  const std::string fault = station.empty() ? "" : network_name_fault(station);
  if (!fault.empty()) throw std::invalid_argument("station: " + fault);
  return station;
}

std::optional<Security> security_of(const ExchangeSettings& settings) {
  if (settings.keys.empty()) return std::nullopt;
  return security_files(settings.keys, "device");
}

}  // namespace

std::int64_t client_now_ns() noexcept {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1'000'000'000 * t.tv_sec + t.tv_nsec;
}

Exchange::Exchange(const ExchangeSettings& settings)
    : Exchange(settings, StationHere(checked_station(settings.station))) {}

Exchange::Exchange(const ExchangeSettings& settings, const StationHere&)
    : limits_(limits_of(settings.device)),
      domain_(Domains::open(settings)),
      participant_(*domain_, security_of(settings)),
      states_(participant_),
      forces_(participant_, settings.device_id, ForceReader::Side::client),
      arrival_(require(dds_create_waitset(participant_.handle()), "a waitset")),
      place_(dds_place(settings.domain, default_dds_profile_name())),
      watch_(limits_) {
  require(dds_set_status_mask(forces_.handle(), DDS_DATA_AVAILABLE_STATUS), "a status mask");
  require(dds_waitset_attach(arrival_.handle(), forces_.handle(), 0), "a waitset");
  state_.device_id = settings.device_id;
  // Rising over a restart of the client too.
  state_.number = static_cast<std::uint64_t>(client_now_ns() / period_ns);
}

Exchange::~Exchange() {
  state_.enable = false;
  if (sent_ > 0) send();
  states_.dispose(state_);
}

void Exchange::next_slot() noexcept {
  const std::int64_t now = client_now_ns();
  if (next_ns_ == 0) {
    prctl(PR_SET_TIMERSLACK, 1);
    next_ns_ = now;
    return;
  }
  next_ns_ += phase_.take_shift_ns(state_.number + 1);
  // What is late by less than a period is sent at once; whole periods are left out.
  next_ns_ += period_ns * std::max<std::int64_t>(1, (now - next_ns_) / period_ns);
  const timespec t{next_ns_ / 1'000'000'000, next_ns_ % 1'000'000'000};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) continue;
}

// Returns when waiting for the answer ends.
std::int64_t Exchange::send(const Reading& reading) noexcept {
  const std::int64_t now = client_now_ns();
  if (begun_ns_ == 0) begun_ns_ = now;
  const std::uint32_t status = watch_.status();
  watch_.slot(forces_.stranger(now), reading.enable);
  std::copy(reading.position.begin(), reading.position.end(), state_.position);
  std::copy(reading.orientation.begin(), reading.orientation.end(), state_.orientation);
  state_.buttons = reading.buttons;
  state_.enable = arming_.enable(now, reading.enable, status & status_disarmed,
                                 (status & status_latched) || watch_.latched());
  send();
  ++sent_;
  const bool in_slot = now - next_ns_ < period_ns;  // a caller with a clock of its own has no grid
  return (in_slot ? next_ns_ : now) + period_ns - margin_ns;
}

void Exchange::send() noexcept {
  ++state_.number;
  state_.client_time_ns = client_now_ns();
  watch_.sent(state_.number, state_.client_time_ns);
  states_.write(state_);
}

bool Exchange::await(std::int64_t until_ns) noexcept {
  const std::int64_t left = until_ns - client_now_ns();
  if (left <= 0) return false;
  dds_waitset_wait(arrival_.handle(), nullptr, 0, left);
  return true;
}

// Whether a force came that answers a state of ours for the first time.
bool Exchange::take() noexcept {
  std::array<hapticd_msg_ForceCommand, forces_kept> forces;
  std::array<dds_sample_info_t, forces_kept> infos;
  const int n = forces_.take_into(forces, infos);
  const std::int64_t now = client_now_ns();
  bool fresh = false;
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const hapticd_msg_ForceCommand& f = forces[k];
    if (!infos[k].valid_data) continue;
    if (f.echo_number != 0 && !watch_.ours(f.echo_number, f.echo_client_time_ns)) other_ns_ = now;
    const Feel feel{{f.force[0], f.force[1], f.force[2]}, {f.torque[0], f.torque[1], f.torque[2]}, f.status};
    if (!watch_.heard(now, f.echo_number, f.echo_client_time_ns, feel)) continue;
    fresh = true;
    ++answered_;
    phase_.heard(f.echo_number, f.state_age_us, f.status & (status_disarmed | status_ramping_up));
  }
  return fresh;
}

Feel Exchange::feel() noexcept { return watch_.feel(client_now_ns()); }

Hearing Exchange::hearing() const noexcept {
  const std::int64_t now = client_now_ns();
  if (watch_.latched()) return Hearing::second_daemon;
  if (!watch_.is_silent(now)) return Hearing::daemon;
  const bool waited = begun_ns_ != 0 && now - begun_ns_ > patience_ns;
  if (waited && other_ns_ != 0 && now - other_ns_ < other_stays_ns) return Hearing::other_client;
  if (watch_.ever_heard()) return Hearing::silence;
  return waited ? Hearing::nobody : Hearing::connecting;
}

ExchangeCounts Exchange::counts() const noexcept {
  return {sent_, answered_, watch_.silences(), forces_.strange_forces(),
          1e-6 * static_cast<double>(watch_.longest_silence_ns())};
}

}  // namespace hapticd
