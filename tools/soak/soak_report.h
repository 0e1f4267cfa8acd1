// What a soak found, as JSON, as a table, and judged.
//
// Every bound is a check with its value; the verdict is `pass` if all were kept, `fail` if one was not, else
// `incomplete` where a public tool gave nothing to compare with. Drift and growth: soak_drift.h.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tools/soak/bootstrap.h"
#include "tools/soak/public_tools.h"
#include "tools/soak/soak_slice.h"

namespace hapticd {

// Everything of some part of the run.
struct SoakFigures {
  ServerFigures tick, event;
  Tally cyclictest_us;  // with the wake-ups that late ones hid
  PingFigures ddsperf;
  double rss_mb = 0;  // of all daemons, at the end of the part
  void merge(const SoakFigures& other);
};

// A whole run.
struct SoakRecord {
  std::string scene, mode;        // mode: tick, event, both or attached
  double duration = 0, load = 0;  // [s], [%]
  bool own = true;                // the daemons are: what only they know is known
  SoakFigures all;
  std::vector<Tally> wake_slices_us, cyclictest_slices_us;  // mode `tick`'s; one each
  std::vector<SoakFigures> minutes;
  double first_rss_mb = 0;                // after the first cycle
  double busy = 0, steal = 0;             // shares of all cores
  std::vector<nlohmann::json> summaries;  // the daemons' last
};

// A bound and whether it was kept.
struct SoakCheck {
  std::string what;
  double value = 0, limit = 0;
  bool at_most = true;
  bool known = true;
  std::optional<Interval> strays = {};  // bootstrap.h
  bool kept() const { return known && (at_most ? value <= limit : value >= limit); }
};

// Appends to `checks`.
nlohmann::ordered_json soak_report(const SoakRecord& record, std::vector<SoakCheck>& checks);
std::string verdict_of(const std::vector<SoakCheck>& checks);
void print_soak(const nlohmann::ordered_json& report, const std::vector<SoakCheck>& checks);

}  // namespace hapticd
