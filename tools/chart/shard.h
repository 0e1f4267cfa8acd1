// A part of a run whose units of work know nothing of one another, for many processes or machines; parts join
// again.
//
//   part i of n has the units k with k mod n = i − 1, in the run's own order
//   a part's figures hold beside its own arrays: shard = {part, parts, arrays: {NAME: the unit of each
//   element}, optional} merged       each array's elements in the order of their units, whatever part they
//   are from; all else must agree
//
// So what the parts give together is what one run gives, byte for byte where time is virtual. A unit is what
// shares nothing dear with others: a mode, a check, a case at one size, a recording with its references.
// Errors: merge_shards throws InputError naming the file: parts of different runs, a part that is missing or
// twice.
#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace hapticd {

struct Shard {
  int part = 1, parts = 1;
  bool is_whole() const noexcept { return parts == 1; }
  bool has(std::size_t unit) const noexcept {
    return unit % static_cast<std::size_t>(parts) == static_cast<std::size_t>(part - 1);
  }
  // "force_2of3"; of the whole "force".
  std::string stem(const std::string& of) const;
};

// --shard i/n
void add_shard_option(CLI::App& command, Shard& shard);

// Counts units, and notes which array elements each has made.
class ShardLedger {
 public:
  explicit ShardLedger(const Shard& shard = {}) : shard_(shard) {}
  // The next unit: whether it is this part's.
  bool begins() { return shard_.has(next_++); }
  // The array now has so many elements; those that are new are of the newest unit.
  void made(const std::string& array, std::size_t count) { made(array, count, next_ - 1); }
  void made(const std::string& array, std::size_t count, std::size_t unit) {
    units_[array].resize(count, unit);
  }
  // A part's figures: before its arrays are filled, all of them in the order of a whole run's, which leaves
  // out those of `optional` that stay empty; then what each element is of. Nothing for a whole run.
  void prepare(nlohmann::ordered_json& json, const std::vector<std::string>& arrays,
               const std::vector<std::string>& optional);
  void note(nlohmann::ordered_json& json) const;

 private:
  Shard shard_;
  std::size_t next_ = 0;
  std::map<std::string, std::vector<std::size_t>> units_;
  std::vector<std::string> optional_;
};

struct ShardFile {
  std::filesystem::path file;
  nlohmann::ordered_json json;
};

nlohmann::ordered_json merge_shards(const std::vector<ShardFile>& parts);
// The tables of the parts, whose lines are the elements of this array; "": there are none.
std::string merge_tables(const std::vector<ShardFile>& parts, const std::string& array);

}  // namespace hapticd
