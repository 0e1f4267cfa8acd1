#include "tools/cli/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace hapticd {

Quantiles quantiles(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto at = [&](double p) {
    const auto rank = static_cast<std::size_t>(std::ceil(p * static_cast<double>(values.size()) - 1e-9));
    return values[std::clamp<std::size_t>(rank, 1, values.size()) - 1];
  };
  return {values.size(), at(0.5), at(0.99), at(0.999), values.back()};
}

double rounded(double value, int decimals) {
  const double unit = std::pow(10.0, decimals);
  return std::round(value * unit) / unit;
}

std::string fixed(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

nlohmann::ordered_json to_json(const Quantiles& q, int decimals) {
  nlohmann::ordered_json json;
  const auto put = [&](const char* key, double value) {
    json[key] = q.count ? nlohmann::ordered_json(rounded(value, decimals)) : nlohmann::ordered_json(nullptr);
  };
  put("p50", q.p50);
  put("p99", q.p99);
  put("p99_9", q.p99_9);
  put("max", q.max);
  return json;
}

std::string to_text(const Quantiles& q, const std::string& unit) {
  if (q.count == 0) return "none";
  return "p50 " + fixed(q.p50, 1) + ", p99 " + fixed(q.p99, 1) + ", p99.9 " + fixed(q.p99_9, 1) + ", max " +
         fixed(q.max, 1) + " " + unit;
}

void print(const Table& table) {
  std::size_t width = 0;
  for (const auto& row : table) width = std::max(width, row.first.size());
  for (const auto& [name, value] : table)
    std::printf("  %-*s  %s\n", static_cast<int>(width), name.c_str(), value.c_str());
  std::fflush(stdout);
}

void write_json(const std::string& path, const nlohmann::ordered_json& json) {
  write_file(path, json.dump(2) + "\n");
}

}  // namespace hapticd
