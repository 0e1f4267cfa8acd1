// SceneOperation (topic haptic/scene/operation) of an operation's measures.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "idl/scene.h"  // generated from idl/scene.idl
#include "server/observe/operation.h"

namespace hapticd {

// events: how many there were, of which `measures` has the newest. Strings and sequences borrow from
// `measures`, the vectors and the scene's name.
hapticd_msg_SceneOperation operation_message(std::uint32_t device_id, const std::string& scene,
                                             const OperationMeasures& measures, std::uint64_t events,
                                             std::vector<hapticd_msg_HandOperation>& hands,
                                             std::vector<hapticd_msg_BodyOperation>& bodies);

}  // namespace hapticd
