// References on disk: they cost minutes, and a chart is drawn more than once.
//
// A reference is kept as CSV under a hash of this program, the scene's bodies and instrument, the motion in
// its window, the removals and the step. A file that cannot be read is made again. Units: SI. Errors:
// std::runtime_error when the file cannot be written.
#pragma once

#include <filesystem>

#include "tools/offline/offline_run.h"

namespace hapticd {

// FNV-1a over everything that the reference of this input depends on.
std::uint64_t reference_key(const Scene& scene, const OfflineInput& input, double h);

// From the directory if it is there, else run and kept; an empty path keeps nothing.
OfflineResult cached_reference(const std::filesystem::path& directory, const Scene& scene,
                               const OfflineInput& input, double h, const OfflineProgress& progress);

}  // namespace hapticd
