#include "tools/soak/tally.h"

#include "tools/cli/report.h"

namespace hapticd {

nlohmann::ordered_json to_json(const Tally& t) {
  nlohmann::ordered_json j;
  const auto put = [&](const char* key, double value) {
    j[key] = t.count() ? nlohmann::ordered_json(rounded(value, 2)) : nlohmann::ordered_json(nullptr);
  };
  put("p50", t.percentile(50));
  put("p99", t.percentile(99));
  put("p99_9", t.percentile(99.9));
  put("max", t.max());
  j["count"] = t.count();
  return j;
}

Tally tally_from(const nlohmann::json& bins) {
  Tally t;
  for (const auto& bin : bins) t.add(bin[0].get<double>(), bin[1].get<std::uint64_t>());
  return t;
}

nlohmann::json to_bins(const Tally& tally) {
  nlohmann::json out = nlohmann::json::array();
  for (const auto& [value, n] : tally.bins()) out.push_back({value, n});
  return out;
}

}  // namespace hapticd
