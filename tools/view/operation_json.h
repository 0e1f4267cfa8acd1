// What a daemon says of an operation (topic haptic/scene/operation), as JSON with the keys of the daemon's
// own figures (server/observe/operation.h): device_id, scene, time_s, hands[], bodies[], events (how many
// there were) and, of the last one, newest_event {t, what, who, value}. Numbers that are not finite are null.
#pragma once

#include <nlohmann/json.hpp>

#include "idl/scene.h"  // generated from idl/scene.idl

namespace hapticd {

nlohmann::ordered_json operation_json(const hapticd_msg_SceneOperation& m);

}  // namespace hapticd
