#include "server/files/yaml_keys.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <sstream>

#include "server/files/paths.h"

namespace hapticd {
namespace {

constexpr double unit_tolerance = 1e-2;

int line_of(const YAML::Node& node) { return node.Mark().is_null() ? 0 : node.Mark().line + 1; }

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = diagonal + (a[i - 1] != b[j - 1]);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, change});
    }
  }
  return row.back();
}

std::string shown(double x) {
  std::ostringstream out;
  out << x;
  return out.str();
}

std::string range_text(const NumberRange& r) {
  std::string text;
  if (r.low > -unbounded) text += (r.open_low ? "above " : "at least ") + shown(r.low);
  if (r.high < unbounded)
    text += (text.empty() ? "" : " and ") + std::string(r.open_high ? "below " : "at most ") + shown(r.high);
  return text;
}

}  // namespace

std::string listed(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::string did_you_mean(const std::string& word, const std::vector<std::string>& candidates) {
  std::size_t least = std::max<std::size_t>(2, word.size() / 3) + 1;
  std::string best;
  for (const std::string& candidate : candidates)
    if (const std::size_t d = edit_distance(word, candidate); d < least) {
      least = d;
      best = candidate;
    }
  return best.empty() ? "" : "did you mean '" + best + "'?";
}

YamlMap::YamlMap(YAML::Node node, std::filesystem::path file, std::string path, int line)
    : node_(std::move(node)), file_(std::move(file)), path_(std::move(path)), line_(line) {
  if (!node_.IsMap()) throw InputError(file_, line_, path_, "expected keys with values here");
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar()) throw InputError(file_, line_of(entry.first), path_, "a key must be a word");
    if (!seen.insert(entry.first.Scalar()).second)
      throw InputError(file_, line_of(entry.first), this->path(entry.first.Scalar()), "given twice");
  }
}

YamlMap YamlMap::open(const std::filesystem::path& file) {
  const std::string bytes = read_bytes(file);
  try {
    return YamlMap(YAML::Load(bytes), file, "", 1);
  } catch (const YAML::Exception& e) {
    throw InputError(file, e.mark.is_null() ? 0 : e.mark.line + 1, "YAML", e.msg);
  }
}

void YamlMap::only(std::initializer_list<const char*> keys) const {
  const std::vector<std::string> known(keys.begin(), keys.end());
  for (const auto& entry : node_) {
    const std::string& key = entry.first.Scalar();
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string hint = did_you_mean(key, known);
    throw InputError(file_, line_of(entry.first), path(key),
                     "unknown key (" + (hint.empty() ? "known here: " + listed(known) : hint) + ")");
  }
}

InputError YamlMap::error(const std::string& key, const std::string& what) const {
  int line = line_;
  for (const auto& entry : node_)
    if (entry.first.Scalar() == key) line = line_of(entry.first);
  return {file_, line, path(key), what};
}

bool YamlMap::has(const std::string& key) const {
  for (const auto& entry : node_)
    if (entry.first.Scalar() == key) return true;
  return false;
}

bool YamlMap::is_map(const std::string& key) const { return value(key).IsMap(); }

YAML::Node YamlMap::value(const std::string& key) const {
  for (const auto& entry : node_)
    if (entry.first.Scalar() == key) {
      if (entry.second.IsNull()) throw error(key, "has no value");
      return entry.second;
    }
  throw error(key, "is missing");
}

YamlMap YamlMap::map(const std::string& key) const {
  const YAML::Node node = value(key);
  if (!node.IsMap()) throw error(key, "expected keys with values under it");
  return {node, file_, path(key), line_of(node)};
}

std::vector<YamlMap> YamlMap::maps(const std::string& key) const {
  const YAML::Node node = value(key);
  if (!node.IsSequence() || node.size() == 0)
    throw error(key, "expected a list (- …) with at least one entry");
  std::vector<YamlMap> result;
  for (std::size_t i = 0; i < node.size(); ++i)
    result.push_back({node[i], file_, path(key) + "[" + std::to_string(i) + "]", line_of(node[i])});
  return result;
}

std::string YamlMap::text(const std::string& key) const {
  const YAML::Node node = value(key);
  if (!node.IsScalar() || node.Scalar().empty()) throw error(key, "expected a word");
  return node.Scalar();
}

std::vector<std::string> YamlMap::texts(const std::string& key) const {
  const YAML::Node node = value(key);
  if (node.IsScalar()) return {text(key)};
  if (!node.IsSequence() || node.size() == 0) throw error(key, "expected a word or a list of words");
  std::vector<std::string> result;
  for (const auto& item : node) {
    if (!item.IsScalar()) throw error(key, "expected a list of words");
    result.push_back(item.Scalar());
  }
  return result;
}

bool YamlMap::flag(const std::string& key, bool otherwise) const {
  if (!has(key)) return otherwise;
  const std::string word = text(key);
  if (word != "true" && word != "false") throw error(key, "'" + word + "' is neither true nor false");
  return word == "true";
}

double YamlMap::number_of(const YAML::Node& node, const std::string& key) const {
  double x = 0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, x))
    throw error(key, (node.IsScalar() ? "'" + node.Scalar() + "' is not a number" : "expected a number") +
                         std::string(" (SI units, without the unit: 3000, 1.5e-3)"));
  if (!std::isfinite(x)) throw error(key, "must be finite");
  return x;
}

double YamlMap::number(const std::string& key, const NumberRange& range) const {
  const double x = number_of(value(key), key);
  const bool right = (range.open_low ? x > range.low : x >= range.low) &&
                     (range.open_high ? x < range.high : x <= range.high);
  if (right) return x;
  const std::string meaning = range.meaning;
  throw error(key, shown(x) + " is out of range: must be " + range_text(range) +
                       (meaning.empty() ? "" : " (" + meaning + ")"));
}

double YamlMap::number(const std::string& key, const NumberRange& range, double otherwise) const {
  return has(key) ? number(key, range) : otherwise;
}

int YamlMap::whole(const std::string& key, int low, int high) const {
  const double x = number(key, {double(low), double(high)});
  if (x != std::floor(x)) throw error(key, shown(x) + " is not a whole number");
  return static_cast<int>(x);
}

Vec3 YamlMap::vec3_of(const YAML::Node& node, const std::string& key) const {
  if (!node.IsSequence() || node.size() != 3) throw error(key, "expected three numbers: [x, y, z]");
  return {number_of(node[0], key), number_of(node[1], key), number_of(node[2], key)};
}

Vec3 YamlMap::vec3(const std::string& key) const { return vec3_of(value(key), key); }

Vec3 YamlMap::vec3(const std::string& key, const Vec3& otherwise) const {
  return has(key) ? vec3(key) : otherwise;
}

std::vector<Vec3> YamlMap::points(const std::string& key) const {
  const YAML::Node node = value(key);
  if (!node.IsSequence()) throw error(key, "expected a list of points: [[x, y, z], …]");
  std::vector<Vec3> result;
  for (const auto& item : node) result.push_back(vec3_of(item, key));
  return result;
}

Quat YamlMap::quaternion(const std::string& key) const {
  if (!has(key)) return Quat::Identity();
  const YAML::Node node = value(key);
  if (!node.IsSequence() || node.size() != 4) throw error(key, "expected four numbers: [x, y, z, w]");
  const Quat q(number_of(node[3], key), number_of(node[0], key), number_of(node[1], key),
               number_of(node[2], key));
  if (std::abs(q.norm() - 1) > unit_tolerance)
    throw error(key, "is not a unit quaternion: its norm is " + shown(q.norm()));
  return q.normalized();
}

int YamlMap::choice(const std::string& key, std::initializer_list<const char*> choices) const {
  const std::string word = text(key);
  const std::vector<std::string> known(choices.begin(), choices.end());
  for (std::size_t i = 0; i < known.size(); ++i)
    if (known[i] == word) return static_cast<int>(i);
  const std::string hint = did_you_mean(word, known);
  throw error(key,
              "'" + word + "' is not one of: " + listed(known) + (hint.empty() ? "" : " (" + hint + ")"));
}

}  // namespace hapticd
