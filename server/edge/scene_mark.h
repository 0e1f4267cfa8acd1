// A number for what both halves of a daemon must agree on about their scene.
//
// Of the instruments: shapes, blades, ports, which devices hold them, and which are answered beside the
// simulation (link_settings.h); of the haptic solve: margin, the step and the relaxation of viscous tissue.
// Not of devices' limits and maps, which only the edge uses, nor of meshes, which only the simulation does.
// Two scenes with the same mark may share problems; two marks are equal by chance once in 2⁶⁴.
#pragma once

#include <cstdint>

#include "physics/contact/instruments.h"
#include "server/scene/scene.h"

namespace hapticd {

std::uint64_t scene_mark(const Scene& scene, const EachInstrument<bool>& at_simulation = {});

}  // namespace hapticd
