// What a Touch feels of the cube while its daemon's halves come and go: when it is felt, and within which
// limits.
#pragma once

#include <chrono>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/tools/scripted_client.h"

namespace hapticd {

using Force = ScriptedClient::Force;

constexpr double touching_z = 0.0215;                        // 1.5 mm into the cube [m]
constexpr double touch_most = 3.3, touch_step = 200 * 1e-3;  // config/devices/touch.yaml: N, N/s in a tick
constexpr int patience_ms = 20'000;

inline void pause(int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); }
inline double magnitude(const Force& f) { return ScriptedClient::magnitude(f); }
inline bool has(const Force& f, std::uint32_t bits) { return (f.status & bits) != 0; }
inline bool felt(const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }

inline void expect_bounded(const std::vector<Force>& forces) {
  for (std::size_t i = 0; i < forces.size(); ++i) {
    ASSERT_LE(magnitude(forces[i]), touch_most * (1 + 1e-9));
    if (i == 0 || forces[i].number != forces[i - 1].number + 1 || magnitude(forces[i]) == 0) continue;
    Vec3 change;
    for (int k = 0; k < 3; ++k) change[k] = forces[i].force[k] - forces[i - 1].force[k];
    ASSERT_LE(change.norm(), touch_step * (1 + 1e-6)) << "at tick " << forces[i].number;
  }
}

}  // namespace hapticd
