#include "tools/stability/bench/trial_tally.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace hapticd {
namespace {

constexpr double tick_s = 1e-3;
constexpr double of_largest = 1e-6;     // of energy
constexpr double small_energy = 1e-15;  // round-off of a piece at rest [J]
constexpr double round_off = 1 + 1e-9;

}  // namespace

std::string said(const char* what, double value, double allowed, const char* unit) {
  char text[160];
  std::snprintf(text, sizeof text, "%s %.4g %s, allowed %.4g", what, value, unit, allowed);
  return text;
}

double energy_allowed(double largest) { return of_largest * largest + small_energy; }

std::optional<std::string> judge(const DeviceSettings& device, const ForceSample& answer,
                                 const ForceSample& last, TrialTally& tally) {
  tally.latched += (answer.status & status_latched) != 0;
  tally.saturated += (answer.status & status_saturated) != 0;
  tally.solver_caps += (answer.status & status_solver_cap) != 0;
  tally.status |= answer.status;
  tally.device_max = std::max(tally.device_max, device.max_force);
  if (!answer.force.allFinite() || !answer.torque.allFinite() || !std::isfinite(answer.energy))
    return "the force is not finite";
  const double force = answer.force.norm(), torque = answer.torque.norm();
  tally.force_max = std::max(tally.force_max, force);
  if (force > device.max_force * round_off) return said("force", force, device.max_force, "N");
  if (torque > device.max_torque * round_off) return said("torque", torque, device.max_torque, "N·m");
  // What is put to zero at once is a safe state (haptic/README.md).
  constexpr std::uint32_t at_once = status_latched | status_disarmed;
  const double step = (answer.force - last.force).norm(), most = device.max_force_rate * tick_s;
  if (((answer.status | last.status) & at_once) == 0 && step > most * round_off)
    return said("force changed by", step, most, "N in a tick");
  return std::nullopt;
}

std::optional<std::string> judge(const TissueExtremes& seen, const TissueBounds& bounds, TrialTally& tally) {
  ++tally.steps;
  tally.farthest_allowed = bounds.farthest;
  tally.fastest_allowed = bounds.fastest;
  if (!seen.finite) return "a node is not a number";
  tally.farthest = std::max(tally.farthest, seen.farthest);
  tally.fastest = std::max(tally.fastest, seen.fastest);
  tally.gained = std::max(tally.gained, seen.gained);
  tally.energy = std::max(tally.energy, seen.energy);
  tally.split = std::max(tally.split, seen.split);
  if (seen.farthest > bounds.farthest) return said("a node is away by", seen.farthest, bounds.farthest, "m");
  if (seen.fastest > bounds.fastest) return said("a node is as fast as", seen.fastest, bounds.fastest, "m/s");
  if (const double most = energy_allowed(tally.energy); seen.gained > most)
    return said("a piece gained, beyond the work done on it,", seen.gained, most, "J");
  if (const double most = energy_allowed(tally.energy); seen.split > most)
    return said("a cut of the mesh gained", seen.split, most, "J");
  return std::nullopt;
}

void add(const TrialTally& part, TrialTally& sum) {
  sum.ticks += part.ticks;
  sum.steps += part.steps;
  sum.in_contact += part.in_contact;
  sum.latched += part.latched;
  sum.saturated += part.saturated;
  sum.solver_caps += part.solver_caps;
  sum.status |= part.status;
  sum.removed += part.removed;
  const auto largest = [](double part_s, double& sum_s) { sum_s = std::max(sum_s, part_s); };
  largest(part.force_max, sum.force_max);
  largest(part.device_max, sum.device_max);
  largest(part.farthest, sum.farthest);
  largest(part.farthest_allowed, sum.farthest_allowed);
  largest(part.fastest, sum.fastest);
  largest(part.fastest_allowed, sum.fastest_allowed);
  largest(part.gained, sum.gained);
  largest(part.split, sum.split);
  largest(part.energy, sum.energy);
}

}  // namespace hapticd
