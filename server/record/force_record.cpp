#include "server/record/force_record.h"

#include <cstdio>
#include <stdexcept>

namespace hapticd {

ForceRecordWriter::ForceRecordWriter(const std::filesystem::path& file) : out_(file) {
  if (!out_) throw std::runtime_error("cannot write the recording " + file.string());
  out_ << "t,tick,echo,px,py,pz,qx,qy,qz,qw,buttons,ix,iy,iz,fx,fy,fz,tx,ty,tz,status,step,state_age_us,"
          "problem_age_ms,wake_us,solve_us,contacts,active,penetration_um,energy_j\n";
}

void ForceRecordWriter::write(const ForceRecord& r) {
  if (first_ns_ == 0) first_ns_ = r.time_ns;
  const ForceSample& f = r.force;
  const auto in = [](std::int64_t ns, double unit) { return unit * static_cast<double>(ns); };
  char line[640];
  const int n = std::snprintf(
      line, sizeof line,
      "%.6f,%llu,%llu,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%u,%.8g,%.8g,%.8g,"
      "%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%u,%llu,%.2f,%.4f,%.2f,%.2f,%u,%u,%.3f,%.6g\n",
      in(r.time_ns - first_ns_, 1e-9), static_cast<unsigned long long>(f.sequence),
      static_cast<unsigned long long>(f.echo_sequence), r.device.p.x(), r.device.p.y(), r.device.p.z(),
      r.device.q.x(), r.device.q.y(), r.device.q.z(), r.device.q.w(), r.instrument.buttons,
      r.instrument.X.p.x(), r.instrument.X.p.y(), r.instrument.X.p.z(), f.force.x(), f.force.y(), f.force.z(),
      f.torque.x(), f.torque.y(), f.torque.z(), f.status, static_cast<unsigned long long>(f.step),
      in(f.state_age_ns, 1e-3), in(f.problem_age_ns, 1e-6), in(f.wake_ns, 1e-3), in(f.solve_ns, 1e-3),
      f.contacts, f.active, 1e6 * f.penetration, f.energy);
  if (n > 0) out_.write(line, std::min<std::streamsize>(n, sizeof line - 1));
}

}  // namespace hapticd
