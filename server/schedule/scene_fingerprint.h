// A number for what a scene's forces depend on, as it is run: equal for equal scenes, and else, most likely,
// not.
#pragma once

#include "server/scene/scene.h"

namespace hapticd {

std::uint64_t fingerprint(const Scene& scene);

}  // namespace hapticd
