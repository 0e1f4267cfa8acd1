// The modes of the atlas that sweep a value: each function is one and says in its texts what naive is, what
// is asked and why. Plans may measure what they need at once (a displayed stiffness).
#pragma once

#include "tools/stability/bench/stability_bench.h"

namespace hapticd {

// Time: stability_time.cpp.
StabilityPlan plan_delay(StabilityBench&, bool quick);
StabilityPlan plan_stall(StabilityBench&, bool quick);
StabilityPlan plan_slow_simulation(StabilityBench&, bool quick);
// The network: stability_network.cpp.
StabilityPlan plan_packet_loss(StabilityBench&, bool quick);
StabilityPlan plan_random_loss(StabilityBench&, bool quick);
StabilityPlan plan_jitter(StabilityBench&, bool quick);
StabilityPlan plan_reordering(StabilityBench&, bool quick);
// The device, and friction: stability_device.cpp.
StabilityPlan plan_quantum(StabilityBench&, bool quick);
StabilityPlan plan_friction(StabilityBench&, bool quick);
// What a new problem does to the force: stability_swap.cpp.
StabilityPlan plan_swap(StabilityBench&, bool quick);
StabilityPlan plan_removal(StabilityBench&, bool quick);
// Compliance: stability_compliance.cpp.
StabilityPlan plan_near_static(StabilityBench&, bool quick);
StabilityPlan plan_rotation(StabilityBench&, bool quick);
// Contact solvers: stability_solver.cpp.
StabilityPlan plan_conforming(StabilityBench&, bool quick);
StabilityPlan plan_duplicated(StabilityBench&, bool quick);
// Elements: stability_tissue.cpp.
StabilityPlan plan_crushing(StabilityBench&, bool quick);
StabilityPlan plan_incompressible(StabilityBench&, bool quick);
// Energy of tissue on its own: stability_energy.cpp.
StabilityPlan plan_slender(StabilityBench&, bool quick);
StabilityPlan plan_let_go(StabilityBench&, bool quick);
StabilityPlan plan_remnant(StabilityBench&, bool quick);
StabilityPlan plan_bridge(StabilityBench&, bool quick);
// A blade, and the law of cutting: stability_blade.cpp.
StabilityPlan plan_blade_below(StabilityBench&, bool quick);
StabilityPlan plan_blade_at(StabilityBench&, bool quick);
// A port's pump: stability_vacuum.cpp.
StabilityPlan plan_vacuum(StabilityBench&, bool quick);
// Pieces that part, come loose, and are held: stability_pieces.cpp.
StabilityPlan plan_cracking(StabilityBench&, bool quick);
StabilityPlan plan_last_bridge(StabilityBench&, bool quick);
StabilityPlan plan_wedged_piece(StabilityBench&, bool quick);
// The tool: stability_tool.cpp.
StabilityPlan plan_fast_stroke(StabilityBench&, bool quick);
StabilityPlan plan_wedge(StabilityBench&, bool quick);
StabilityPlan plan_stiffness_ratio(StabilityBench&, bool quick);
// One of two hands' forces is late, the other's is not: stability_two_hands.cpp.
StabilityPlan plan_one_late(StabilityBench&, bool quick);

}  // namespace hapticd
