#include "tools/fleet/fleet.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "server/observe/diagnostics.h"
#include "server/observe/health.h"
#include "tools/client/client.h"
#include "tools/view/operation_json.h"

namespace hapticd {
namespace {

constexpr std::uint64_t blocks_per_bin = 10;
constexpr std::int64_t window_ns = 5'000'000'000;  // of wake-ups
constexpr std::int64_t rate_window_ns = 2'000'000'000;
constexpr double least_haptic_hz = 990, least_rate_share = 0.95;

// A bit of a status by its name, for reading; "": it has none.
std::string words_of(std::uint32_t mask) {
  std::string name = status_text(mask);
  std::replace(name.begin(), name.end(), '_', ' ');
  return name == "none" ? "" : name;
}

std::string text_of(const char* text) { return text ? text : ""; }

template <typename Sequence>
std::vector<std::uint32_t> counts_of(const Sequence& s) {
  return {s._buffer, s._buffer + s._length};
}

std::vector<std::uint32_t> difference(const std::vector<std::uint32_t>& a,
                                      const std::vector<std::uint32_t>& b) {
  std::vector<std::uint32_t> out = a;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) out[i] -= std::min(b[i], out[i]);
  return out;
}

// Wake-ups of the last five to ten seconds: two marks, of which the older one is subtracted.
void follow_wake(FleetDevice& d, std::vector<std::uint32_t> counts, std::int64_t now_ns) {
  d.wake = std::move(counts);
  if (d.wake_ns == 0) d.wake_base = d.wake_next = d.wake;
  if (d.wake_ns == 0 || now_ns - d.wake_ns >= window_ns) {
    d.wake_base = std::exchange(d.wake_next, d.wake);
    d.wake_ns = now_ns;
  }
  d.wake_p999_us = 1e-3 * health_quantile_ns(difference(d.wake, d.wake_base), 0.999);
}

// The daemon's own rate is since its start; this one is of the last seconds.
// An edge has no steps of its own.
void follow_steps(FleetDevice& d, const hapticd_msg_ServerStatus& m, std::int64_t now_ns) {
  if (m.step == 0) {
    d.sim_hz = d.step_ms = std::nan("");
    d.sim_rate_known = false;
    return;
  }
  if (d.step_mark_ns == 0 || m.step < d.step) {
    d.step_mark = m.step;
    d.step_mark_ns = now_ns;
    d.sim_rate_known = false;
  }
  d.step = m.step;
  if (!d.sim_rate_known) d.sim_hz = m.sim_rate_hz;
  if (now_ns - d.step_mark_ns < rate_window_ns) return;
  d.sim_hz = 1e9 * static_cast<double>(d.step - d.step_mark) / static_cast<double>(now_ns - d.step_mark_ns);
  d.sim_rate_known = true;
  d.step_mark = d.step;
  d.step_mark_ns = now_ns;
}

std::string of_device(const Station& s, const FleetDevice& d) {
  const bool several = s.devices.begin()->first.first != s.devices.rbegin()->first.first;
  return several ? " (device " + std::to_string(d.id) + ")" : "";
}

std::string hertz(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f Hz", x);
  return text;
}

void add_faults(const Station& s, const FleetDevice& d, std::vector<StationFault>& out) {
  const std::string whose = of_device(s, d);
  if (!d.live()) {
    out.push_back({(d.lost ? "lost" : "ended") + whose, "", d.lost});
    return;
  }
  for (int bit = 0; bit < 32; ++bit) {
    const std::uint32_t mask = d.status & 1u << bit & ~status_ordinary;
    if (const std::string name = mask != 0 ? words_of(mask) : ""; !name.empty())
      out.push_back({name + whose, "", (mask & status_errors) != 0});
  }
  if (d.haptic_hz > 0 && d.haptic_hz < least_haptic_hz)
    out.push_back({"haptic loop slow" + whose, hertz(d.haptic_hz)});
  if (d.period_ms > 0 && d.sim_rate_known && d.sim_hz < least_rate_share * 1e3 / d.period_ms)
    out.push_back({"simulation slow" + whose, hertz(d.sim_hz)});
  if (d.degraded) out.push_back({"compliance degraded" + whose, ""});
}

// Severe ones first, each once: two programs for a device say the same of it.
std::vector<StationFault> faults_of(const Station& s) {
  std::vector<StationFault> all, out;
  std::map<std::uint32_t, int> programs;
  for (const auto& [key, d] : s.devices)
    if (d.live() && ++programs[d.id] == 2)
      all.push_back({"two programs answer for device " + std::to_string(d.id), "", true});
  for (const auto& [key, d] : s.devices) add_faults(s, d, all);
  for (StationFault& f : all)
    if (std::none_of(out.begin(), out.end(), [&](const StationFault& o) { return o.what == f.what; }))
      out.push_back(std::move(f));
  std::stable_sort(out.begin(), out.end(),
                   [](const StationFault& a, const StationFault& b) { return a.severe && !b.severe; });
  return out;
}

// A simulation without its edge has an operation alone.
StationState state_of(const Station& s, std::int64_t now_ns) {
  if (s.devices.empty())
    return now_ns - s.heard_ns > 3 * silence_ns ? StationState::lost : StationState::idle;
  int live = 0, lost = 0, armed = 0;
  for (const auto& [key, d] : s.devices) {
    live += d.live();
    lost += d.lost;
    armed += d.armed();
  }
  if (live == 0) return lost > 0 ? StationState::lost : StationState::ended;
  if (!s.faults.empty() && s.faults.front().severe) return StationState::fault;
  return armed > 0 ? StationState::in_use : StationState::idle;
}

// Lines of the faults that are there: begun, gone on, over.
bool follow_lines(Station& s, std::int64_t now_ns) {
  bool changed = false;
  for (FaultLine& line : s.lines) {
    if (line.until_ns != 0) continue;
    if (std::any_of(s.faults.begin(), s.faults.end(), [&](const auto& f) { return f.what == line.what; }))
      continue;
    line.until_ns = now_ns;
    changed = true;
  }
  for (const StationFault& f : s.faults) {
    if (std::any_of(s.lines.begin(), s.lines.end(),
                    [&](const FaultLine& l) { return l.until_ns == 0 && l.what == f.what; }))
      continue;
    s.lines.push_back({f.what, now_ns, 0});
    if (s.lines.size() > most_lines) s.lines.pop_front();
    changed = true;
  }
  return changed;
}

// A program that took the place of one that is gone: the newer one's entry stays.
void drop_replaced(Station& s, const FleetDevice& by) {
  std::erase_if(s.devices,
                [&](const auto& entry) { return entry.second.id == by.id && !entry.second.live(); });
}

}  // namespace

const char* word(StationState state) {
  constexpr std::array<const char*, 5> words = {"idle", "in use", "fault", "lost", "ended"};
  return words[static_cast<std::size_t>(state)];
}

void ForceTrace::take(std::uint64_t blocks, const float* force, std::size_t count) {
  if (blocks < blocks_) blocks_ = 0;  // begun anew
  const std::uint64_t first = blocks - std::min<std::uint64_t>(blocks, count);
  if (blocks_ == 0) bin_.fill(std::nanf(""));
  for (std::uint64_t b = blocks_ / blocks_per_bin + 1; b <= blocks / blocks_per_bin; ++b) {
    bin_[b % trace_bins] = std::nanf("");
    if (b > blocks_ / blocks_per_bin + trace_bins) break;
  }
  for (std::uint64_t k = std::max(first, blocks_); k < blocks; ++k) {
    float& bin = bin_[k / blocks_per_bin % trace_bins];
    bin = std::fmax(bin, force[4 * (k - first) + 3]);  // a NaN gives way
  }
  blocks_ = blocks;
}

std::vector<float> ForceTrace::newest() const {
  std::vector<float> out;
  const std::uint64_t bins = blocks_ / blocks_per_bin;  // whole ones
  for (std::uint64_t b = bins > trace_bins - 1 ? bins - (trace_bins - 1) : 0; b < bins; ++b)
    out.push_back(bin_[b % trace_bins]);
  return out;
}

float ForceTrace::last_second() const {
  const std::vector<float> all = newest();
  float largest = 0;
  for (std::size_t i = all.size() > 10 ? all.size() - 10 : 0; i < all.size(); ++i)
    largest = std::fmax(largest, all[i]);
  return largest;
}

// Who has been gone for longest makes room.
bool Fleet::has_place() {
  if (stations_.size() < most_stations) return true;
  auto oldest = stations_.end();
  for (auto s = stations_.begin(); s != stations_.end(); ++s) {
    const StationState state = s->second.state;
    if (state != StationState::lost && state != StationState::ended) continue;
    if (oldest == stations_.end() || s->second.heard_ns < oldest->second.heard_ns) oldest = s;
  }
  if (oldest == stations_.end()) return false;
  stations_.erase(oldest);
  return true;
}

Station* Fleet::station(const std::string& name, std::int64_t now_ns) {
  if (!stations_.contains(name) && !has_place()) {
    ++left_out_;
    return nullptr;
  }
  Station& s = stations_[name];
  if (s.first_ns == 0) {
    s.name = name;
    s.first_ns = now_ns;
  }
  s.heard_ns = now_ns;
  return &s;
}

void Fleet::hear(const Origin& of, const hapticd_msg_ServerStatus& m, std::int64_t now_ns) {
  Station* const heard = station(of.station, now_ns);
  if (!heard) return;
  Station& s = *heard;
  const std::pair key{m.device_id, of.program};
  if (!s.devices.contains(key) && s.devices.size() >= most_devices) {
    ++left_out_;
    return;
  }
  FleetDevice& d = s.devices[key];
  const bool is_new = d.heard_ns == 0;
  d.id = m.device_id;
  d.host = of.host;
  d.scene = text_of(m.scene);
  d.refused = text_of(m.refused);
  d.status = m.status;
  d.haptic_hz = m.haptic_rate_hz;
  d.step_ms = m.sim_step_ms;
  follow_steps(d, m, now_ns);
  d.removed = m.elements_removed;
  d.aspirated = m.fragments_aspirated;
  d.rejected = m.rejected_states;
  d.conflicts = m.conflicts;
  d.deadline_misses = m.deadline_misses;
  d.heard_ns = now_ns;
  d.lost = d.ended = false;
  if (is_new) drop_replaced(s, d);
}

void Fleet::hear(const Origin& of, const hapticd_msg_ServerHealth& m, std::int64_t now_ns) {
  const auto found = stations_.find(of.station);
  if (found == stations_.end()) return;
  const auto device = found->second.devices.find({m.device_id, of.program});
  if (device == found->second.devices.end()) return;  // a status comes first, within 100 ms
  FleetDevice& d = device->second;
  d.device = text_of(m.device);
  d.compliance = text_of(m.compliance);
  d.period_ms = m.step_period_ms;
  d.max_force = m.max_force;
  d.degraded = std::any_of(m.bodies._buffer, m.bodies._buffer + m.bodies._length,
                           [](const hapticd_msg_BodyHealth& b) { return b.degraded; });
  d.trace.take(m.blocks, m.force._buffer, m.force._length / 4);
  follow_wake(d, counts_of(m.wake), now_ns);
  d.health_ns = now_ns;
}

void Fleet::hear(const Origin& of, const hapticd_msg_SceneOperation& m, std::int64_t now_ns) {
  Station* const s = station(of.station, now_ns);
  if (!s) return;
  if (!s->operations.contains(m.device_id) && s->operations.size() >= most_devices) {
    ++left_out_;
    return;
  }
  FleetOperation& o = s->operations[m.device_id];
  o = {.scene = text_of(m.scene), .gone_most = 0, .figures = operation_json(m)};
  for (std::uint32_t i = 0; i < m.bodies._length; ++i)
    o.gone_most = std::max(o.gone_most, static_cast<double>(m.bodies._buffer[i].volume_gone));
}

void Fleet::leave(const ProgramKey& program) {
  for (auto& [name, s] : stations_)
    for (auto& [key, d] : s.devices)
      if (key.second == program && !d.lost) d.ended = true;
}

std::vector<std::string> Fleet::look(std::int64_t now_ns) {
  std::vector<std::string> changed;
  for (auto& [name, s] : stations_) {
    for (auto& [key, d] : s.devices) d.lost = !d.ended && now_ns - d.heard_ns > silence_ns;
    s.faults = faults_of(s);
    const bool is_new = !std::exchange(s.looked_at, true);
    const bool lines = follow_lines(s, now_ns);
    const StationState before = std::exchange(s.state, state_of(s, now_ns));
    if (lines || s.state != before || is_new) changed.push_back(name);
  }
  std::erase_if(stations_, [&](const auto& entry) {
    return entry.second.state == StationState::ended && now_ns - entry.second.heard_ns > ended_for_ns;
  });
  return changed;
}

}  // namespace hapticd
