#include "server/record/trajectory_reader.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string_view>

#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "server/files/yaml_keys.h"

namespace hapticd {
namespace {

constexpr double unit_tolerance = 1e-2;
constexpr double farthest = 3;  // [m]
const std::vector<std::string> column_names = {"t", "px", "py", "pz", "qx", "qy", "qz", "qw", "buttons"};
// What our own recordings (`hapticd --record`, `haptic replay --forces`) carry beside the motion.
const std::vector<std::string> passed_over = {"tick",
                                              "echo",
                                              "number",
                                              "ix",
                                              "iy",
                                              "iz",
                                              "fx",
                                              "fy",
                                              "fz",
                                              "tx",
                                              "ty",
                                              "tz",
                                              "status",
                                              "step",
                                              "state_age_us",
                                              "rtt_us",
                                              "wake_us",
                                              "solve_us",
                                              "problem_age_ms",
                                              "contacts",
                                              "active",
                                              "removed",
                                              "penetration_um",
                                              "energy_j"};
constexpr int ignored = -1;
enum Column { time, px, py, pz, qx, qy, qz, qw, buttons, column_count };

std::string_view trimmed(std::string_view s) {
  while (!s.empty() && (s.front() == ' ' || s.front() == '\t')) s.remove_prefix(1);
  while (!s.empty() && (s.back() == ' ' || s.back() == '\t' || s.back() == '\r')) s.remove_suffix(1);
  return s;
}

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  for (std::size_t begin = 0;;) {
    const std::size_t comma = line.find(',', begin);
    fields.push_back(trimmed(line.substr(begin, comma - begin)));
    if (comma == std::string_view::npos) return fields;
    begin = comma + 1;
  }
}

class Parser {
 public:
  Parser(const std::filesystem::path& file, LengthUnit unit) : file_(file), scale_(metres(unit)) {}

  void add_line(std::string_view line) {
    ++line_;
    line = trimmed(line);
    if (line.empty() || line.front() == '#') return;
    if (columns_.empty())
      read_header(line);
    else
      read_row(line);
  }

  Trajectory finish() {
    if (columns_.empty())
      throw InputError(file_, 0, "", "is empty (the first line names the columns: t,px,py,pz,…)");
    if (samples_.size() < 2)
      throw InputError(file_, line_, "",
                       "only " + std::to_string(samples_.size()) + " rows: a motion needs two at least");
    return make_trajectory(std::move(samples_));
  }

 private:
  InputError error(int column, const std::string& what) const {
    return {file_, line_, "column " + column_names[column], what};
  }

  void read_header(std::string_view line) {
    std::array<int, column_count> seen{};
    for (std::string_view name : split(line)) {
      const auto found = std::find(column_names.begin(), column_names.end(), name);
      if (std::find(passed_over.begin(), passed_over.end(), name) != passed_over.end()) {
        columns_.push_back(ignored);
        continue;
      }
      if (found == column_names.end()) {
        const std::string hint = did_you_mean(std::string(name), column_names);
        throw InputError(file_, line_, "column " + std::string(name.substr(0, 40)),
                         "unknown column (" + (hint.empty() ? "known: " + listed(column_names) : hint) + ")");
      }
      columns_.push_back(static_cast<int>(found - column_names.begin()));
      if (seen[columns_.back()]++) throw error(columns_.back(), "is there twice");
    }
    for (int needed : {time, px, py, pz})
      if (!seen[needed]) throw error(needed, "is missing");
    has_orientation_ = seen[qx] || seen[qy] || seen[qz] || seen[qw];
    for (int part : {qx, qy, qz, qw})
      if (has_orientation_ && !seen[part]) throw error(part, "is missing (all of qx,qy,qz,qw, or none)");
  }

  double number(std::string_view field, int column) const {
    double value = 0;
    const auto [end, problem] = std::from_chars(field.data(), field.data() + field.size(), value);
    if (problem != std::errc() || end != field.data() + field.size())
      throw error(column, "'" + std::string(field.substr(0, 40)) + "' is not a number");
    if (!std::isfinite(value)) throw error(column, "must be finite");
    return value;
  }

  void read_row(std::string_view line) {
    const std::vector<std::string_view> fields = split(line);
    if (fields.size() < columns_.size()) {
      const auto missing = std::find_if(columns_.begin() + static_cast<std::ptrdiff_t>(fields.size()),
                                        columns_.end(), [](int c) { return c != ignored; });
      throw error(missing == columns_.end() ? time : *missing, "has no value in this row");
    }
    if (fields.size() > columns_.size())
      throw InputError(file_, line_, "column " + std::to_string(columns_.size() + 1),
                       "a value too many: there are " + std::to_string(columns_.size()) + " columns");
    std::array<double, column_count> v{};
    v[qw] = 1;
    for (std::size_t i = 0; i < fields.size(); ++i)
      if (columns_[i] != ignored) v[columns_[i]] = number(fields[i], columns_[i]);

    TrajectorySample sample;
    sample.t = v[time];
    if (!samples_.empty() && !(sample.t > samples_.back().t))
      throw error(time, "the time does not rise (it was " + std::to_string(samples_.back().t) + " before)");
    sample.pose.p = scale_ * Vec3(v[px], v[py], v[pz]);
    for (int i = 0; i < 3; ++i)
      if (std::abs(sample.pose.p[i]) > farthest)
        throw error(px + i, std::to_string(sample.pose.p[i]) + " m is beyond any device's reach" +
                                (scale_ == 1 ? " (in millimetres? Say --units mm, or write metres)" : ""));
    sample.pose.q = Quat(v[qw], v[qx], v[qy], v[qz]);
    const double norm = sample.pose.q.norm();
    if (std::abs(norm - 1) > unit_tolerance)
      throw error(qx, "not a unit quaternion: its norm is " + std::to_string(norm));
    sample.pose.q.normalize();
    if (v[buttons] < 0 || v[buttons] > 4294967295.0 || v[buttons] != std::floor(v[buttons]))
      throw error(buttons, "must be a whole number of at least 0 (bit 0: phaco, bit 1: aspiration)");
    sample.buttons = static_cast<std::uint32_t>(v[buttons]);
    samples_.push_back(sample);
  }

  std::filesystem::path file_;
  double scale_;
  int line_ = 0;
  std::vector<int> columns_;
  bool has_orientation_ = false;
  std::vector<TrajectorySample> samples_;
};

}  // namespace

Trajectory parse_trajectory(const std::string& bytes, const std::filesystem::path& file, LengthUnit unit) {
  Parser parser(file, unit);
  std::string_view rest = bytes;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
  while (!rest.empty()) {
    const std::size_t end = rest.find('\n');
    parser.add_line(rest.substr(0, end));
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
  }
  return parser.finish();
}

Trajectory read_trajectory(const std::filesystem::path& file, LengthUnit unit) {
  return parse_trajectory(read_bytes(file), file, unit);
}

}  // namespace hapticd
