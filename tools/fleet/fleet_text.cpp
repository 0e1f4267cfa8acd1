#include "tools/fleet/fleet_text.h"

#include <algorithm>
#include <cmath>

#include "tools/cli/report.h"

namespace hapticd {
namespace {

using Json = nlohmann::ordered_json;

Json real(double x, int decimals) { return std::isfinite(x) ? Json(rounded(x, decimals)) : Json(nullptr); }
double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

Json device_json(const FleetDevice& d) {
  Json j = {{"id", d.id},
            {"device", d.device},
            {"host", d.host},
            {"scene", d.scene},
            {"live", d.live()},
            {"armed", d.armed()},
            {"status", d.status},
            {"haptic_hz", real(d.haptic_hz, 1)},
            {"sim_hz", real(d.sim_hz, 2)},
            {"step_ms", real(d.step_ms, 2)},
            {"removed", d.removed},
            {"aspirated", d.aspirated},
            {"misses", d.deadline_misses},
            {"rejected", d.rejected},
            {"conflicts", d.conflicts},
            {"refused", d.refused}};
  if (d.health_ns == 0) return j;
  j["compliance"] = d.compliance;
  j["period_ms"] = real(d.period_ms, 2);
  j["wake_p999_us"] = real(d.wake_p999_us, 0);
  j["max_force_n"] = real(d.max_force, 2);
  j["force_n"] = real(d.trace.last_second(), 3);
  for (float f : d.trace.newest()) j["force_trace_n"].push_back(real(f, 3));
  return j;
}

// Of the devices, or of what a simulation without any says.
std::string scene_of(const Station& s) {
  if (!s.devices.empty()) return s.devices.begin()->second.scene;
  return s.operations.empty() ? "" : s.operations.begin()->second.scene;
}

std::string hosts_of(const Station& s) {
  std::string hosts;
  for (const auto& [key, d] : s.devices)
    if (!d.host.empty() && hosts.find(d.host) == std::string::npos)
      hosts += (hosts.empty() ? "" : ", ") + d.host;
  return hosts;
}

std::string shown_name(const Station& s) { return s.name.empty() ? "(no name)" : s.name; }

double gone_of(const Station& s) {
  double most = 0;
  for (const auto& [id, o] : s.operations) most = std::max(most, o.gone_most);
  return most;
}

constexpr std::array<const char*, 11> titles = {"station", "state",   "scene", "device", "haptic", "sim",
                                                "step",    "late by", "force", "gone",   "faults"};
constexpr std::array<const char*, 11> units = {"",   "",         "",       "",  "Hz", "Hz",
                                               "ms", "p99.9 µs", "N, 1 s", "%", ""};
constexpr std::size_t numbers_from = 4, numbers_to = 10;
using Row = std::array<std::string, titles.size()>;

std::size_t columns_of(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; }));
}

std::string number(double x, int decimals) { return std::isfinite(x) ? fixed(x, decimals) : "–"; }

std::string faults_in_words(const Station& s) {
  std::string text;
  for (const StationFault& f : s.faults)
    if (f.what != word(s.state))
      text += (text.empty() ? "" : ", ") + f.what + (f.detail.empty() ? "" : " " + f.detail);
  return text;
}

std::vector<Row> rows_of(const Station& s, std::int64_t now_ns) {
  std::vector<Row> rows;
  for (const auto& [key, d] : s.devices) {
    Row row;
    row[3] = d.device + (s.devices.size() > 1 || d.device.empty() ? " #" + std::to_string(d.id) : "");
    if (d.live()) {
      row[4] = number(d.haptic_hz, 0);
      row[5] = number(d.sim_hz, 1);
      row[6] = number(d.step_ms, 1);
      if (d.health_ns > 0) {
        row[7] = number(d.wake_p999_us, 0);
        row[8] = number(d.trace.last_second(), 2);
      }
    } else {
      row[4] = "for " + fixed(seconds(now_ns - d.heard_ns), 0) + " s";
    }
    rows.push_back(row);
  }
  if (rows.empty()) rows.emplace_back();
  rows[0][0] = shown_name(s);
  rows[0][1] = word(s.state);
  rows[0][2] = scene_of(s);
  if (!s.operations.empty()) rows[0][9] = number(100 * gone_of(s), 1);
  rows[0][10] = faults_in_words(s);
  return rows;
}

const char* colour_of(const std::string& state) {
  return state == "in use" ? "\x1b[36m" : state == "fault" || state == "lost" ? "\x1b[1;31m" : "\x1b[2m";
}

}  // namespace

Json to_json(const Station& s, std::int64_t now_ns) {
  Json j = {{"station", s.name},
            {"state", word(s.state)},
            {"host", hosts_of(s)},
            {"scene", scene_of(s)},
            {"heard_ms", real(1e3 * seconds(now_ns - s.heard_ns), 0)},
            {"devices", Json::array()},
            {"operation", Json::array()},
            {"faults", Json::array()},
            {"lines", Json::array()}};
  for (const auto& [key, d] : s.devices) j["devices"].push_back(device_json(d));
  for (const auto& [id, o] : s.operations) j["operation"].push_back(o.figures);
  for (const StationFault& f : s.faults)
    j["faults"].push_back({{"what", f.what}, {"detail", f.detail}, {"severe", f.severe}});
  for (const FaultLine& l : s.lines) {
    Json line = {{"what", l.what}, {"ago_s", real(seconds(now_ns - l.from_ns), 1)}};
    if (l.until_ns != 0) line["for_s"] = real(seconds(l.until_ns - l.from_ns), 1);
    j["lines"].push_back(std::move(line));
  }
  return j;
}

Json to_json(const Fleet& fleet, std::uint32_t domain, std::int64_t now_ns) {
  Json j = {
      {"command", "fleet"}, {"domain", domain}, {"counts", Json::object()}, {"stations", Json::array()}};
  for (StationState state : {StationState::in_use, StationState::idle, StationState::fault,
                             StationState::lost, StationState::ended})
    j["counts"][word(state)] = std::count_if(fleet.stations().begin(), fleet.stations().end(),
                                             [&](const auto& s) { return s.second.state == state; });
  j["left_out"] = fleet.left_out();
  for (const auto& [name, s] : fleet.stations()) j["stations"].push_back(to_json(s, now_ns));
  return j;
}

std::string table_of(const Fleet& fleet, std::int64_t now_ns, std::size_t width, bool colour) {
  std::vector<Row> rows;
  for (const auto* head : {&titles, &units})
    std::copy(head->begin(), head->end(), rows.emplace_back().begin());
  for (const auto& [name, s] : fleet.stations())
    for (Row& row : rows_of(s, now_ns)) rows.push_back(std::move(row));
  std::array<std::size_t, titles.size()> widths{};
  for (const Row& row : rows)
    for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], columns_of(row[c]));
  std::string out;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    std::string line;
    for (std::size_t c = 0; c < titles.size(); ++c) {
      const std::string space(widths[c] - columns_of(rows[r][c]), ' ');
      const bool right = c >= numbers_from && c < numbers_to;
      line += (c ? "  " : "") + (right ? space + rows[r][c] : rows[r][c] + space);
    }
    std::size_t at = 0;
    for (std::size_t columns = 0; at < line.size() && columns <= width; ++at)
      if ((line[at] & 0xc0) != 0x80 && ++columns > width) break;
    line.resize(at);
    while (line.ends_with(' ')) line.pop_back();
    if (colour && r < 2) line = "\x1b[1m" + line + "\x1b[0m";
    if (colour && r >= 2 && !rows[r][1].empty()) line = colour_of(rows[r][1]) + line + "\x1b[0m";
    out += line + "\n";
  }
  return out;
}

}  // namespace hapticd
