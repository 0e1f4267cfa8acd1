// Why the details: a killed process disposes nothing and its lease lasts 10 s, hence the 500 ms; a starved
// client is disarmed after 100 ms, but keeps its device against whoever is heard meanwhile. What is for
// another device, or from a stranger while the client is heard, is refused by a filter in Cyclone's receive
// thread before a sample is kept: it can neither displace the client's states nor keep the loop busy. Of two
// daemons started at once both hear the other before either arms. The wait's own time-out would cost an
// answer 8 µs: hence the timer, whose thread has the loop's priority where it may.
#include "server/dds/device_bridge.h"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <limits>

#include "haptic/clock.h"
#include "server/os/realtime.h"

namespace hapticd {
namespace {

constexpr std::int64_t silence_ns = 500'000'000;
constexpr std::int64_t listens_first_ns = 500'000'000;
constexpr std::int64_t wakeup_period_ns = 1'000'000;  // the loop's
constexpr std::int64_t looks_again_ns = 1'000'000;    // who is still there, where nothing comes

dds_topic_filter state_filter(dds_topic_filter_sample_sampleinfo_arg_fn f, void* self) noexcept {
  dds_topic_filter filter{};
  filter.mode = DDS_TOPIC_FILTER_SAMPLE_SAMPLEINFO_ARG;
  filter.f.sample_sampleinfo_arg = f;
  filter.arg = self;
  return filter;
}

constexpr std::int64_t nothing = std::numeric_limits<std::int64_t>::max();  // is there, ever

// Until the word is no longer `value`, at most for so long, or for nothing.
void wait_while(const std::atomic<std::uint32_t>& word, std::uint32_t value,
                std::int64_t at_most_ns) noexcept {
  // A time-out costs a timer: only where something is due before the alarm.
  const timespec t{at_most_ns / 1'000'000'000, at_most_ns % 1'000'000'000};
  syscall(SYS_futex, &word, FUTEX_WAIT_PRIVATE, value, at_most_ns < 1'000'000'000 ? &t : nullptr, nullptr, 0);
}

void wake_one(const std::atomic<std::uint32_t>& word) noexcept {
  syscall(SYS_futex, &word, FUTEX_WAKE_PRIVATE, 1, nullptr, nullptr, 0);
}

}  // namespace

DeviceSample sample_from(const hapticd_msg_DeviceState& m) noexcept {
  DeviceSample s;
  s.sequence = m.number;
  s.client_time_ns = m.client_time_ns;
  s.pose.p = Vec3(m.position[0], m.position[1], m.position[2]);
  s.pose.q = Quat(m.orientation[3], m.orientation[0], m.orientation[1], m.orientation[2]);
  s.buttons = m.buttons;
  s.enable = m.enable;
  return s;
}

hapticd_msg_ForceCommand message_from(std::uint32_t device_id, const ForceSample& f) noexcept {
  const auto microseconds = [](std::int64_t ns) {
    return static_cast<float>(1e-3 * static_cast<double>(ns));
  };
  const auto small = [](std::uint32_t n) { return static_cast<std::uint16_t>(std::min(n, 65535u)); };
  hapticd_msg_ForceCommand m{};
  m.device_id = device_id;
  m.number = f.sequence;
  m.echo_number = f.echo_sequence;
  m.echo_client_time_ns = f.echo_client_time_ns;
  for (int i = 0; i < 3; ++i) {
    m.force[i] = f.force[i];
    m.torque[i] = f.torque[i];
  }
  m.status = f.status;
  m.energy = static_cast<float>(f.energy);
  m.step = f.step;
  m.state_age_us = microseconds(f.state_age_ns);
  m.problem_age_ms = 1e-3f * microseconds(f.problem_age_ns);
  m.wake_us = microseconds(f.wake_ns);
  m.solve_us = microseconds(f.solve_ns);
  m.residual = static_cast<float>(f.residual);
  m.penetration_um = static_cast<float>(1e6 * f.penetration);
  m.contacts = small(f.contacts);
  m.active = small(f.active);
  m.dropped = small(f.dropped);
  m.solver_caps = small(f.solver_caps);
  return m;
}

DdsDevicePort::DdsDevicePort(const Participant& participant, std::uint32_t device_id, bool events,
                             std::optional<int> core, DdsDevicePort* leader)
    : device_id_(device_id),
      reader_(participant, state_filter(
                               [](const void* sample, const dds_sample_info_t* info, void* self) {
                                 return static_cast<DdsDevicePort*>(self)->wanted(
                                     *static_cast<const hapticd_msg_DeviceState*>(sample),
                                     info->publication_handle);
                               },
                               this)),
      writer_(participant),
      others_(participant, device_id, ForceReader::Side::daemon),
      leader_(leader) {
  if (!events) return;
  heard_of_arrivals_ = true;
  if (leader_) leader_->followers_.push_back(this);
  const std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener(dds_create_listener(this),
                                                                                 &dds_delete_listener);
  dds_lset_data_available(listener.get(),
                          [](dds_entity_t, void* self) { static_cast<DdsDevicePort*>(self)->arrived(); });
  require(dds_set_listener(reader_.handle(), listener.get()), "the listener for device states");
  if (leader_) return;
  wakeup_timer_.emplace(
      wakeup_period_ns, [this] { wake(); },
      [core] {
        name_thread("haptic_alarm");
        if (core) use_core(*core);
        use_fifo(haptic_priority);
      });
}

DdsDevicePort::~DdsDevicePort() {
  dds_set_listener(reader_.handle(), nullptr);  // waits for a callback that is under way
  if (leader_) std::erase(leader_->followers_, this);
}

// Cyclone's receive thread.
bool DdsDevicePort::wanted(const hapticd_msg_DeviceState& state, dds_instance_handle_t writer) noexcept {
  thread_local const bool ready =
      (prefault_heap(sample_heap), true);  // the first time that this thread is here
  static_cast<void>(ready);
  if (state.device_id != device_id_) return false;
  const dds_instance_handle_t client = client_.load(std::memory_order_relaxed);
  if (client == 0 || writer == client) return true;
  // Silent: `admit` is to decide.
  if (monotonic_ns() - client_heard_ns_.load(std::memory_order_relaxed) >= silence_ns) return true;
  stranger_.store(true, std::memory_order_relaxed);
  return false;
}

// Cyclone's receive thread.
void DdsDevicePort::arrived() noexcept {
  const std::uint32_t before = arrivals_.load(std::memory_order_relaxed);
  if (before == taken_.load(std::memory_order_relaxed))
    arrived_ns_.store(monotonic_ns(), std::memory_order_relaxed);
  arrivals_.store(before + 1, std::memory_order_release);
  wake();
}

void DdsDevicePort::wake() noexcept {
  std::atomic<std::uint32_t>& bell = leader_ ? leader_->bell_ : bell_;
  bell.fetch_add(1, std::memory_order_release);
  wake_one(bell);
}

// When what is there for the next take may be looked at.
std::int64_t DdsDevicePort::due_ns(std::int64_t earliest_ns) const noexcept {
  if (arrivals_.load(std::memory_order_acquire) == seen_) return nothing;
  return std::max(arrived_ns_.load(std::memory_order_relaxed), earliest_ns);
}

std::int64_t DdsDevicePort::await(std::int64_t until_ns,
                                  const EachInstrument<std::int64_t>& earliest_ns) noexcept {
  if (!wakeup_timer_) {
    sleep_until(until_ns);
    return 0;
  }
  wakeup_timer_->set(until_ns);
  for (;;) {
    const std::uint32_t rung = bell_.load(std::memory_order_acquire);
    std::int64_t first = due_ns(earliest_ns[0]), last = first;
    for (std::size_t i = 0; i < followers_.size(); ++i) {
      const std::int64_t due = followers_[i]->due_ns(earliest_ns[static_cast<int>(i) + 1]);
      first = std::min(first, due);
      last = std::max(last, due);
    }
    const std::int64_t now = monotonic_ns();
    if (first <= now) return first;
    if (now >= until_ns) return 0;
    if (last != nothing)
      sleep_until(std::min(first, until_ns));  // all are there: nobody is to be heard meanwhile
    else
      wait_while(bell_, rung, first - now);
  }
}

bool DdsDevicePort::matching_changed() const noexcept {
  std::uint32_t changed = 0;
  dds_get_status_changes(reader_.handle(), &changed);
  return (changed & DDS_SUBSCRIPTION_MATCHED_STATUS) != 0;
}

// The pinned writer's handle if it is no longer matched, else 0. A writer that is deleted among others
// changes no instance state, so the list is asked for, but only when the matching changed.
dds_instance_handle_t DdsDevicePort::departed() noexcept {
  alone_ = writers_ == 1;
  if (!matching_changed()) return 0;
  alone_ = false;
  reader_.matched();  // reading the status resets the change
  std::array<dds_instance_handle_t, 64> writer;
  writers_ = dds_get_matched_publications(reader_.handle(), writer.data(), writer.size());
  // With more writers than fit the pin is only released by its own dispose or silence.
  if (writers_ < 0 || writers_ > static_cast<int>(writer.size())) return 0;
  const auto end = writer.begin() + writers_;
  return std::find(writer.begin(), end, pinned_) == end ? pinned_ : 0;
}

// Whether the writer is the client, which it becomes when there is none.
bool DdsDevicePort::admit(dds_instance_handle_t writer, std::int64_t now_ns) noexcept {
  if (pinned_ == 0 || (writer != pinned_ && now_ns - heard_ns_ >= silence_ns)) {
    presence_.new_client |= writer != last_pinned_;
    pinned_ = last_pinned_ = writer;
  }
  if (writer != pinned_) {
    presence_.conflict = true;
    return false;
  }
  heard_ns_ = now_ns;
  return true;
}

bool DdsDevicePort::take(std::int64_t now_ns, DeviceSample& sample) noexcept {
  // Before the samples are taken: one that comes in between wakes for nothing, and is not slept over.
  const std::uint32_t arrivals = arrivals_.load(std::memory_order_acquire);
  const bool none_came = heard_of_arrivals_ && arrivals == seen_ && now_ns - last_take_ns_ < looks_again_ns;
  seen_ = arrivals;
  taken_.store(seen_, std::memory_order_relaxed);
  presence_.new_client = false;
  presence_.conflict = stranger_.exchange(false, std::memory_order_relaxed);
  presence_.rival = others_.stranger(now_ns);
  if (none_came) return false;
  const dds_instance_handle_t gone = departed();
  const std::int64_t unix_now = dds_time();
  const int n = std::max(reader_.take_into(samples_, infos_), 0);
  bool taken = false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
    const dds_sample_info_t& info = infos_[i];
    if (samples_[i].device_id != device_id_) continue;
    if (!info.valid_data) {
      const bool nobody = info.instance_state == DDS_NOT_ALIVE_NO_WRITERS_INSTANCE_STATE;
      if (nobody || info.publication_handle == pinned_) pinned_ = 0;
      continue;
    }
    if (!admit(info.publication_handle, now_ns)) continue;
    sample = sample_from(samples_[i]);
    const std::int64_t sent_ns = now_ns - (unix_now - info.source_timestamp);
    sample.received_ns = std::clamp(sent_ns, std::min(last_take_ns_, now_ns), now_ns);
    taken = true;
    // Disposed right behind its last state; or by another that was there since the last take, though it may
    // have left meanwhile.
    if (info.instance_state != DDS_ALIVE_INSTANCE_STATE && alone_ && !matching_changed()) pinned_ = 0;
  }
  if (pinned_ == gone) pinned_ = 0;
  client_.store(pinned_, std::memory_order_relaxed);
  client_heard_ns_.store(heard_ns_, std::memory_order_relaxed);
  last_take_ns_ = now_ns;
  presence_.connected = pinned_ != 0;
  if (first_take_ns_ == 0) first_take_ns_ = now_ns;
  presence_.settled = now_ns - first_take_ns_ >= listens_first_ns;
  return taken && presence_.connected;
}

void DdsDevicePort::write(const ForceSample& force) noexcept {
  writer_.write(message_from(device_id_, force));
}

}  // namespace hapticd
