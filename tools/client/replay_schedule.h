// haptic replay --offline --schedule FILE: a live run's forces made again
// (server/schedule/schedule_replay.h), and how far they are from what the run answered.
//
// Errors: InputError for a file that is no schedule, or of another scene; as replay_schedule.
#pragma once

#include <string>

#include "tools/cli/report.h"

namespace hapticd {

// Largest difference of a force that counts as the same [N].
inline constexpr double same_force = 1e-9;

// scene: a file; empty: the one that the run read. forces: a CSV (force_row.h), slots counted from the first
// tick; empty: none. False: interrupted, a force is off by more than `same_force`, or the record lacks some.
bool run_schedule_replay(const std::string& schedule, const std::string& scene, const std::string& forces,
                         nlohmann::ordered_json& json, Table& table);

}  // namespace hapticd
