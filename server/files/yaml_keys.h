// Checked access to a YAML map: every fault is an InputError with file, line and the full key.
//
// Unknown keys are refused by `only` with the nearest known one named; keys given twice are refused when
// the map is opened. Numbers are finite, always.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <initializer_list>
#include <limits>
#include <string>
#include <vector>

#include "physics/types.h"
#include "server/files/input_error.h"

namespace hapticd {

inline constexpr double unbounded = std::numeric_limits<double>::infinity();

// Which numbers are right, and the words that say so.
struct NumberRange {
  double low = -unbounded, high = unbounded;
  bool open_low = false, open_high = false;  // the bound itself is wrong
  const char* meaning = "";                  // "Poisson's ratio lies above −1 and below 0.5"
};

class YamlMap {
 public:
  // The file's root. Throws InputError for a missing file, for what is no YAML, and for what is no map.
  static YamlMap open(const std::filesystem::path& file);

  // Refuses every key but these.
  void only(std::initializer_list<const char*> keys) const;

  bool has(const std::string& key) const;
  bool is_map(const std::string& key) const;
  YamlMap map(const std::string& key) const;
  std::vector<YamlMap> maps(const std::string& key) const;  // a list of maps, not empty

  std::string text(const std::string& key) const;
  std::vector<std::string> texts(const std::string& key) const;  // one, or a list
  bool flag(const std::string& key, bool otherwise) const;
  double number(const std::string& key, const NumberRange& range) const;
  double number(const std::string& key, const NumberRange& range, double otherwise) const;
  int whole(const std::string& key, int low, int high) const;
  Vec3 vec3(const std::string& key) const;
  Vec3 vec3(const std::string& key, const Vec3& otherwise) const;
  std::vector<Vec3> points(const std::string& key) const;
  Quat quaternion(const std::string& key) const;  // x, y, z, w; unit to 1e-2, then normalised
  // Index into `choices`.
  int choice(const std::string& key, std::initializer_list<const char*> choices) const;

  const std::filesystem::path& file() const { return file_; }
  std::filesystem::path folder() const { return file_.parent_path(); }
  // At a key of this map (at the map itself when the key is absent).
  InputError error(const std::string& key, const std::string& what) const;
  std::string path(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }

 private:
  YamlMap(YAML::Node node, std::filesystem::path file, std::string path, int line);

  YAML::Node value(const std::string& key) const;  // throws when absent
  double number_of(const YAML::Node& node, const std::string& key) const;
  Vec3 vec3_of(const YAML::Node& node, const std::string& key) const;

  YAML::Node node_;
  std::filesystem::path file_;
  std::string path_;
  int line_;
};

// The candidate nearest to `word`, in quotes after "did you mean", or nothing when none is near.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& candidates);

// "a, b, c"
std::string listed(const std::vector<std::string>& words);

}  // namespace hapticd
