#include "tools/client/force_row.h"

#include <cstdio>

namespace hapticd {

const char* const force_row_header =
    "t,number,px,py,pz,buttons,fx,fy,fz,tx,ty,tz,status,rtt_us,state_age_us,problem_age_ms,wake_us,solve_us,"
    "contacts,active,penetration_um,removed\n";

void append(std::string& csv, const ForceRow& r) {
  char line[512];
  const int n = std::snprintf(
      line, sizeof line,
      "%.3f,%lld,%.9g,%.9g,%.9g,%u,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%u,%.1f,%.1f,%.2f,%.1f,%.1f,%u,%u,%.2f,%u\n",
      1e-3 * static_cast<double>(r.slot), static_cast<long long>(r.slot), r.sent.pose.p.x(),
      r.sent.pose.p.y(), r.sent.pose.p.z(), r.sent.buttons, r.force.x(), r.force.y(), r.force.z(),
      r.torque.x(), r.torque.y(), r.torque.z(), r.status, r.rtt_us, r.state_age_us, r.problem_age_ms,
      r.wake_us, r.solve_us, r.contacts, r.active, r.penetration_um, r.removed);
  csv.append(line, static_cast<std::size_t>(n));
}

}  // namespace hapticd
