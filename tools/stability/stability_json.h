// The atlas as figures: what `haptic stability --json` writes (tools/STABILITY.md).
//
// Units are in the keys. What was not measured, or is no number, is null.
#pragma once

#include <nlohmann/json.hpp>

#include "tools/stability/stability.h"
#include "tools/stability/stability_dds.h"

namespace hapticd {

nlohmann::ordered_json to_json(const DdsPress& p);
// Notes the chart's shard, too.
nlohmann::ordered_json to_json(StabilityChart& chart, bool quick);

}  // namespace hapticd
