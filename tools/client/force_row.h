// forces.csv: one line per answered slot, the same from a run over DDS and from an offline one.
//
// Columns: t (s since slot 0, intended), number (slot), px py pz and buttons (as sent, device frame, m), fx
// fy fz (N) tx ty tz (N·m), status, rtt_us (sending to arrival), state_age_us, problem_age_ms, wake_us,
// solve_us, contacts, active, penetration_um, removed. Offline, times that only a clock knows are 0.
#pragma once

#include <cstdint>
#include <string>

#include "physics/types.h"
#include "tools/client/client.h"

namespace hapticd {

struct ForceRow {
  std::int64_t slot = 0;
  DeviceCommand sent;
  Vec3 force = Vec3::Zero(), torque = Vec3::Zero();
  std::uint32_t status = 0;
  double rtt_us = 0, state_age_us = 0, problem_age_ms = 0, wake_us = 0, solve_us = 0;
  std::uint32_t contacts = 0, active = 0;
  double penetration_um = 0;
  std::uint32_t removed = 0;
};

extern const char* const force_row_header;  // with its line's end
void append(std::string& csv, const ForceRow& row);

}  // namespace hapticd
