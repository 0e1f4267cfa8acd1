// A scene in words, for `hapticd --check`: what is simulated, of what size, and what a hand will feel.
//
// The stiffness felt through the scales is K · position_scale · force_scale; every statement on stability
// uses that product.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "server/scene/scene.h"

namespace hapticd {

std::string describe(const Scene& scene);

// A list: name, device, id, felt_stiffness [N/m], device_stiffness [N/m], removes.
nlohmann::ordered_json instruments_to_json(const Scene& scene);

// "zone", as a scene says it.
const char* compliance_name(ComplianceMethod method);

// K · position_scale · force_scale of the virtual coupling: the stiffest the device is asked to display
// [N/m].
double felt_stiffness(const SceneInstrument& held);

}  // namespace hapticd
