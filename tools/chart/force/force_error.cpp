#include "tools/chart/force/force_error.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace hapticd {

namespace {

constexpr double tick = 1e-3;      // [s]
constexpr double felt_above = 30;  // [Hz]
constexpr double onset_at = 0.05;  // of the peak

double p95(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(0.95 * static_cast<double>(values.size())));
  return values[std::max<std::size_t>(rank, 1) - 1];
}

double onset(const std::vector<OfflineTick>& ticks, double threshold) {
  for (const OfflineTick& t : ticks)
    if (t.wrench.head<3>().norm() > threshold) return t.t;
  return ticks.empty() ? 0 : ticks.back().t;
}

}  // namespace

Spectrum error_spectrum(const std::vector<OfflineTick>& run, const std::vector<OfflineTick>& reference) {
  const std::size_t n = std::min(run.size(), reference.size());
  Spectrum spectrum;
  if (n < 2) return spectrum;
  const double two_pi = 2 * std::numbers::pi;
  std::vector<Vec3> e(n);
  double window_power = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double hann = 0.5 - 0.5 * std::cos(two_pi * static_cast<double>(i) / static_cast<double>(n));
    e[i] = hann * (run[i].wrench - reference[i].wrench).head<3>();
    window_power += hann * hann;
  }
  spectrum.df = 1 / (tick * static_cast<double>(n));
  for (std::size_t k = 0; k <= n / 2; ++k) {
    const std::complex<double> turn =
        std::polar(1.0, -two_pi * static_cast<double>(k) / static_cast<double>(n));
    std::complex<double> phase = 1;
    Eigen::Vector3cd sum = Eigen::Vector3cd::Zero();
    for (std::size_t i = 0; i < n; ++i, phase *= turn) sum += phase * e[i];
    const double sides = k == 0 || 2 * k == n ? 1 : 2;
    spectrum.power.push_back(sides * sum.squaredNorm() / (static_cast<double>(n) * window_power));
  }
  return spectrum;
}

ForceError force_error(const std::vector<OfflineTick>& run, const std::vector<OfflineTick>& reference) {
  ForceError out;
  const std::size_t n = std::min(run.size(), reference.size());
  if (n == 0) return out;
  double square = 0, reference_square = 0, torque_square = 0, torque_peak = 0, largest = 0;
  std::vector<double> jumps, steps, reference_steps, excesses;
  for (std::size_t i = 0; i < n; ++i) {
    const Vec6 e = run[i].wrench - reference[i].wrench;
    const Vec3 f = reference[i].wrench.head<3>();
    square += e.head<3>().squaredNorm();
    torque_square += e.tail<3>().squaredNorm();
    reference_square += f.squaredNorm();
    out.peak = std::max(out.peak, f.norm());
    torque_peak = std::max(torque_peak, reference[i].wrench.tail<3>().norm());
    largest = std::max(largest, e.head<3>().norm());
    out.penetration_um = std::max(out.penetration_um, 1e6 * run[i].penetration);
    if (i == 0 || !run[i].swapped) continue;
    const Vec3 step = (run[i].wrench - run[i - 1].wrench).head<3>();
    const Vec3 reference_step = (reference[i].wrench - reference[i - 1].wrench).head<3>();
    jumps.push_back((step - reference_step).norm());
    steps.push_back(step.norm());
    reference_steps.push_back(reference_step.norm());
    excesses.push_back(std::max(0.0, step.norm() - reference_step.norm()));
  }
  if (out.peak <= 0) return out;
  const auto count = static_cast<double>(n);
  out.rms_rel = std::sqrt(square / count) / out.peak;
  out.rms_rel_to_rms = std::sqrt(square / reference_square);
  out.max_rel = largest / out.peak;
  out.torque_rms_rel = torque_peak > 0 ? std::sqrt(torque_square / count) / torque_peak : 0;
  out.swap_jump_p95_rel = p95(jumps) / out.peak;
  out.swap_step_p95_rel = p95(steps) / out.peak;
  out.reference_step_p95_rel = p95(reference_steps) / out.peak;
  out.swap_excess_p95_rel = p95(excesses) / out.peak;
  const Spectrum spectrum = error_spectrum(run, reference);
  double above = 0;
  for (std::size_t k = 0; k < spectrum.power.size(); ++k)
    if (static_cast<double>(k) * spectrum.df > felt_above) above += spectrum.power[k];
  out.buzz_rms_n = std::sqrt(above);
  out.onset_ms = 1e3 * (onset(run, onset_at * out.peak) - onset(reference, onset_at * out.peak));
  return out;
}

std::vector<ForceError> force_errors(const HandTicks& run, const HandTicks& reference) {
  std::vector<ForceError> hands;
  for (int i = 0; i < max_instruments; ++i)
    if (!reference[i].empty()) hands.push_back(force_error(run[i], reference[i]));
  return hands;
}

ForceError worst(const std::vector<ForceError>& hands) {
  const auto found =
      std::max_element(hands.begin(), hands.end(),
                       [](const ForceError& a, const ForceError& b) { return a.rms_rel < b.rms_rel; });
  return found == hands.end() ? ForceError{} : *found;
}

}  // namespace hapticd
