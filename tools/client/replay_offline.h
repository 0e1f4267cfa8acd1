// haptic replay --offline: a scene run along motions (offline_replay.h), and what it leaves.
//
// forces.csv (force_row.h), a recording (device_bag.h; stamps count from 1970, the arming is left out), a
// series for ParaView (vtk_series.h); all of them the same bit for bit from run to run. Each further
// instrument has a file and a recording of its own: F.NAME.csv beside F.csv, DIR.NAME beside DIR. Errors: as
// replay_offline, std::runtime_error for a file that cannot be written.
#pragma once

#include <string>

#include "server/scene/scene.h"
#include "server/schedule/late_steps.h"
#include "tools/cli/report.h"
#include "tools/client/client.h"

namespace hapticd {

struct OfflineOutputs {
  std::string forces, record, vtk;  // empty: none
  bool allow_refused = false;
};

// "F.NAME.csv" of "F.csv" (one_file_each); the first instrument's is the file itself.
std::string file_of_instrument(const std::string& file, const Scene& scene, std::size_t instrument);

// sources: one an instrument, in their order. False: interrupted, a force was not finite, or a state was
// refused and that is not allowed.
bool run_offline_replay(const Scene& scene, const std::vector<SlotSource*>& sources, std::int64_t slots,
                        const OfflineOutputs& outputs, const std::optional<LateSteps>& late,
                        nlohmann::ordered_json& json, Table& table);

}  // namespace hapticd
