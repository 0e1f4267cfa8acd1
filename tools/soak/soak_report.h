// What a soak found, as JSON and as a table. Whose fault what is: soak_verdict.h; drift and growth:
// soak_drift.h.
#pragma once

#include <nlohmann/json.hpp>

#include "tools/soak/soak_verdict.h"

namespace hapticd {

// Post: `verdict` is of this record, and in the report.
nlohmann::ordered_json soak_report(const SoakRecord& record, SoakVerdict& verdict);
nlohmann::ordered_json to_json(const std::vector<SoakCheck>& checks);
void print_soak(const nlohmann::ordered_json& report, const SoakVerdict& verdict,
                const std::vector<Neighbour>& neighbours);

}  // namespace hapticd
