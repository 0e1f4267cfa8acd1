#include "tools/chart/shard.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <sstream>

#include "server/files/input_error.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

using Json = nlohmann::ordered_json;

[[noreturn]] void refuse(const ShardFile& part, const std::string& why) {
  throw InputError(part.file, 0, "shard", why);
}

const Json& shard_of(const ShardFile& part) {
  const auto found = part.json.find("shard");
  if (found == part.json.end() || !found->is_object() || !found->contains("arrays") ||
      !found->value("part", Json()).is_number_integer() || !found->value("parts", Json()).is_number_integer())
    refuse(part, "these are no figures of a part: --shard writes them");
  return *found;
}

// What parts of one run have in common.
Json rest_of(const ShardFile& part) {
  Json rest = part.json;
  for (const auto& [name, units] : shard_of(part)["arrays"].items()) rest[name] = Json::array();
  rest.erase("shard");
  return rest;
}

void check(const std::vector<ShardFile>& parts) {
  const int count = shard_of(parts.front())["parts"];
  std::vector<const ShardFile*> seen(static_cast<std::size_t>(std::max(1, count)), nullptr);
  const Json rest = rest_of(parts.front());
  for (const ShardFile& part : parts) {
    const int i = shard_of(part)["part"], n = shard_of(part)["parts"];
    if (n != count || rest_of(part) != rest)
      refuse(part, "is of another run than " + parts.front().file.string() +
                       ": another version, other options or parts");
    if (i < 1 || i > n) refuse(part, "part " + std::to_string(i) + " of " + std::to_string(n));
    const ShardFile*& slot = seen[static_cast<std::size_t>(i - 1)];
    if (slot) refuse(part, "is the same part as " + slot->file.string());
    slot = &part;
  }
  for (std::size_t i = 0; i < seen.size(); ++i)
    if (!seen[i])
      refuse(parts.front(),
             "part " + std::to_string(i + 1) + " of " + std::to_string(seen.size()) + " is missing");
}

// Of one array: what each unit has, in the units' order.
template <typename T, typename Elements>
std::vector<T> in_order(const std::vector<ShardFile>& parts, const std::string& array, Elements&& elements) {
  std::vector<std::pair<std::size_t, T>> all;
  for (const ShardFile& part : parts) {
    const std::vector<std::size_t> units = shard_of(part)["arrays"].value(array, Json::array());
    const std::vector<T> of = elements(part);
    if (of.size() != units.size()) refuse(part, array + ": not as many elements as units are noted for");
    for (std::size_t k = 0; k < of.size(); ++k) all.emplace_back(units[k], of[k]);
  }
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<T> out;
  for (auto& [unit, element] : all) out.push_back(std::move(element));
  return out;
}

}  // namespace

std::string Shard::stem(const std::string& of) const {
  return is_whole() ? of : of + "_" + std::to_string(part) + "of" + std::to_string(parts);
}

void add_shard_option(CLI::App& command, Shard& shard) {
  command
      .add_option_function<std::string>(
          "--shard",
          [&shard](const std::string& text) {
            const char *end = text.data() + text.size(), *slash = std::find(text.data(), end, '/');
            const auto first = std::from_chars(text.data(), slash, shard.part);
            const auto second = slash == end ? std::from_chars_result{slash, std::errc::invalid_argument}
                                             : std::from_chars(slash + 1, end, shard.parts);
            if (first.ec != std::errc() || first.ptr != slash || second.ec != std::errc() ||
                second.ptr != end || shard.part < 1 || shard.part > shard.parts || shard.parts > 10000)
              throw CLI::ValidationError("--shard", "'" + text + "': expected i/n, part i of n, as 2/8");
          },
          "only part i of n of the work, for many processes; haptic chart merge joins them")
      ->type_name("i/n");
}

void ShardLedger::prepare(Json& json, const std::vector<std::string>& arrays,
                          const std::vector<std::string>& optional) {
  if (shard_.is_whole()) return;
  for (const std::string& name : arrays) {
    json[name] = Json::array();
    units_.try_emplace(name);
  }
  optional_ = optional;
}

void ShardLedger::note(Json& json) const {
  if (shard_.is_whole()) return;
  Json arrays = Json::object();
  for (const auto& [name, units] : units_) arrays[name] = units;
  json["shard"] = {
      {"part", shard_.part}, {"parts", shard_.parts}, {"arrays", std::move(arrays)}, {"optional", optional_}};
}

Json merge_shards(const std::vector<ShardFile>& parts) {
  check(parts);
  Json merged = parts.front().json;
  merged.erase("shard");
  for (const auto& [name, units] : shard_of(parts.front())["arrays"].items()) {
    const std::string array = name;
    const auto elements = [&](const ShardFile& p) {
      return std::vector<Json>(p.json[array].begin(), p.json[array].end());
    };
    Json all = Json::array();
    for (Json& element : in_order<Json>(parts, array, elements)) all.push_back(std::move(element));
    merged[array] = std::move(all);
  }
  for (const std::string optional : shard_of(parts.front())["optional"])
    if (merged.contains(optional) && merged[optional].empty()) merged.erase(optional);
  return merged;
}

std::string merge_tables(const std::vector<ShardFile>& parts, const std::string& array) {
  std::string header;
  for (const ShardFile& part : parts) {
    std::filesystem::path file = part.file;
    if (!std::filesystem::exists(file.replace_extension(".csv"))) return {};
    const std::string text = read_bytes(file), head = text.substr(0, text.find('\n') + 1);
    if (!header.empty() && head != header)
      throw InputError(file, 1, "", "has other columns than the other parts");
    header = head;
  }
  std::string out = header;
  for (const std::string& line : in_order<std::string>(parts, array, [](const ShardFile& part) {
         std::filesystem::path file = part.file;
         std::istringstream text(read_bytes(file.replace_extension(".csv")));
         std::vector<std::string> lines;
         std::string one;
         std::getline(text, one);
         while (std::getline(text, one)) lines.push_back(one);
         return lines;
       }))
    out += line + "\n";
  return out;
}

}  // namespace hapticd
