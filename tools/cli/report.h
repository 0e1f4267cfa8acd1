// What a command found: quantiles, a table for people, JSON for machines.
//
// Quantiles are by nearest rank on all values, exact. Units are in the names.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "server/files/output_file.h"

namespace hapticd {

struct Quantiles {
  std::size_t count = 0;
  double p50 = 0, p99 = 0, p99_9 = 0, max = 0;
};
Quantiles quantiles(std::vector<double> values);

// {"p50": …, "p99": …, "p99_9": …, "max": …}, rounded to `decimals`; all null when there is no value.
nlohmann::ordered_json to_json(const Quantiles& q, int decimals = 1);
std::string to_text(const Quantiles& q, const std::string& unit);

double rounded(double value, int decimals);
std::string fixed(double value, int decimals);

// Two aligned columns on stdout.
using Table = std::vector<std::pair<std::string, std::string>>;
void print(const Table& table);

// Whole or not at all (output_file.h).
void write_json(const std::string& path, const nlohmann::ordered_json& json);

}  // namespace hapticd
