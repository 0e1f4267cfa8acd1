// A fleet in words: a table for a terminal, JSON for machines and for the page.
//
// JSON of a station: station, state, host, scene, heard_ms (since its last word), devices[], operation[]
// (keys as in the daemon's own figures, server/observe/operation.h), faults[] of {what, detail, severe} and
// lines[] of {what, ago_s, for_s}. Units are in the names. Errors: none.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "tools/fleet/fleet.h"

namespace hapticd {

nlohmann::ordered_json to_json(const Station& station, std::int64_t now_ns);
// {"command": "fleet", "domain", "counts": {state: how many}, "stations": […]}
nlohmann::ordered_json to_json(const Fleet& fleet, std::uint32_t domain, std::int64_t now_ns);

// One line a device, cut at `width` columns; colour: with ANSI's.
std::string table_of(const Fleet& fleet, std::int64_t now_ns, std::size_t width, bool colour);

}  // namespace hapticd
