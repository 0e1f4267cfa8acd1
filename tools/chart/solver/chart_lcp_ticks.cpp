#include "tools/chart/solver/chart_lcp_ticks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "haptic/clock.h"
#include "haptic/haptic_step.h"
#include "tests/support/contact_problems.h"
#include "tools/chart/solver/drawn_contacts.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr int ticks = 600, ticks_before = 120;  // in the air, until armed
constexpr double friction = 0.5, apart = 1e12, before = 1e-3, micrometre = 1e-6;

struct Scene {
  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument;
};

Primitive flat_tip(Random& random) {
  Primitive tip;
  tip.name = "tip";
  tip.shape = Shape::cylinder;
  tip.radius = between(random, 1.9e-3, 2.6e-3);
  tip.half_length = 5e-3;
  tip.placement.p = Vec3(0, 0, 5e-3);
  return tip;
}

// A stiff node between soft ones: C ← S C S.
void scale_badly(Random& random, CondensedProblem& problem) {
  auto C = problem.C();
  for (int n = 0; n < problem.nodes; ++n) {
    const double s = std::sqrt(1 / std::pow(apart, between(random, 0, 1)));
    C.middleRows<3>(3 * n) *= s;
    C.middleCols<3>(3 * n) *= s;
  }
}

// Two copies of a sheet, turned to face one another across x = 0 and meeting in the line x = z = 0.
std::unique_ptr<CondensedProblem> groove(const CondensedProblem& sheet, double side, double angle) {
  auto both = std::make_unique<CondensedProblem>();
  both->step = sheet.step;
  both->alarm_distance = sheet.alarm_distance;
  both->nodes = 2 * sheet.nodes;
  both->samples = 2 * sheet.samples;
  both->C().setZero();
  const int rows = 3 * sheet.nodes;
  for (int wall = 0; wall < 2; ++wall) {
    const double sign = wall == 0 ? 1 : -1;
    Mat3 R;  // the sheet's axes
    R.col(2) = Vec3(sign * std::cos(angle / 2), 0, std::sin(angle / 2));
    R.col(1) = Vec3::UnitY();
    R.col(0) = R.col(1).cross(R.col(2));
    const Vec3 middle = -sign * side / 2 * R.col(0);
    for (int n = 0; n < sheet.nodes; ++n) both->x_free[wall * sheet.nodes + n] = middle + R * sheet.x_free[n];
    for (int i = 0; i < sheet.samples; ++i) {
      PatchSample s = sheet.sample[i];
      s.id += static_cast<std::uint64_t>(wall * sheet.samples);
      for (auto& n : s.node) n += wall * sheet.nodes;
      s.outward = R.col(2);
      both->sample[wall * sheet.samples + i] = s;
    }
    for (int a = 0; a < sheet.nodes; ++a)
      for (int b = 0; b < sheet.nodes; ++b)
        both->C().block<3, 3>(wall * rows + 3 * a, wall * rows + 3 * b) =
            R * sheet.C().block<3, 3>(3 * a, 3 * b) * R.transpose();
  }
  both->x_now = both->x_free;
  return both;
}

Scene make_scene(const std::string& kind, std::uint64_t seed) {
  Random random(seed);
  SheetSettings sheet;
  sheet.per_triangle = 4;
  sheet.friction = friction;
  Scene scene;
  if (kind == "wedge") {
    sheet.nodes = 6;
    const double angle = between(random, 0.3, 1), up = 5e-3, along = 2e-3, out = up * std::tan(angle / 2);
    scene.problem = groove(*sheet_problem(random, sheet), sheet.side, angle);
    std::vector<Vec3> hull;
    for (const double y : {-along, along})
      for (const double x : {-out, 0.0, out}) hull.emplace_back(x, y, x == 0 ? 0 : up);
    scene.instrument.primitives = {make_convex("prism", hull, {})};
  } else {
    sheet.nodes = 7;
    scene.problem = sheet_problem(random, sheet);
    if (kind == "badly_scaled") scale_badly(random, *scene.problem);
    scene.instrument.primitives = {flat_tip(random)};
  }
  scene.problem->instrument[0].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
  return scene;
}

// Pressed, drawn to and fro, let go; a little tilted.
class Stroke {
 public:
  Stroke(const std::string& kind, std::uint64_t seed)
      : along_(kind == "wedge" ? 1 : 0), above_(kind == "wedge" ? before : 0.05e-3) {
    Random random(seed);
    for (double& x : at_) x = between(random, -0.5e-3, 0.5e-3);
    if (kind == "wedge") at_[0] *= 0.2;
    depth_ = between(random, 0.2e-3, 0.6e-3);
    for (double& t : tilt_) t = between(random, -0.03, 0.03);
    cycles_ = between(random, 1, 4);
  }
  Pose at(int tick) const {
    Pose X;
    X.p.z() = before;
    if (tick < 0) return X;
    const double s = static_cast<double>(tick) / ticks;
    const double press = std::min(1.0, 4 * std::pow(std::sin(std::numbers::pi * s), 2));
    X.p = Vec3(at_[0], at_[1], above_ - (depth_ + above_) * press);
    X.p[along_] += 0.5e-3 * std::sin(2 * std::numbers::pi * cycles_ * s);
    X.q = Quat(Eigen::AngleAxisd(tilt_[0], Vec3::UnitX()) * Eigen::AngleAxisd(tilt_[1], Vec3::UnitY()));
    return X;
  }

 private:
  int along_;
  double above_;  // where it comes down from: clear of the groove's walls, though off its middle
  std::array<double, 2> at_, tilt_;
  double depth_, cycles_;
};

struct Felt {
  std::vector<Vec3> force;
  std::vector<double> us;
  int capped = 0, unusable = 0, longest = 0;
};

// sideways: of where the stroke is [m].
Felt feel(const std::string& kind, std::uint64_t seed, bool budget, double sideways = 0) {
  const Scene scene = make_scene(kind, seed);
  const Stroke stroke(kind, seed + 100);
  const HapticOptions options;
  DeviceSettings device;
  device.max_force = 10;
  device.max_force_rate = 1e6;
  device.max_speed = 10;
  const auto state = std::make_unique<HapticState>();
  HapticInput input;
  input.device[0].presence.connected = true;
  input.device[0].presence.new_client = true;
  Felt felt;
  int run = 0;
  for (int t = -ticks_before; t < ticks; ++t) {
    input.now_ns = (1000 + ticks_before + t) * ms;
    input.device[0].taken = true;
    ++input.device[0].sample.sequence;
    input.device[0].sample.received_ns = input.now_ns;
    input.device[0].sample.enable = true;
    input.device[0].sample.pose = stroke.at(t);
    input.device[0].sample.pose.p.x() += sideways;
    scene.problem->published_ns = input.now_ns;
    const std::int64_t begun = monotonic_ns(), until = begun + options.solve_budget_ns;
    input.deadline = {};
    if (budget) {
      input.deadline.clock = &until;
      input.deadline.left_ns = [](const void* end) noexcept {
        return *static_cast<const std::int64_t*>(end) - monotonic_ns();
      };
    }
    const ForceSample f =
        haptic_step(scene.problem.get(), scene.instrument, std::span(&device, 1), options, input, *state)[0];
    const std::int64_t ended = monotonic_ns();
    input.device[0].presence.new_client = false;
    if (t < 0) continue;
    felt.force.push_back(f.force);
    felt.us.push_back(1e-3 * static_cast<double>(ended - begun));
    const bool capped = f.status & status_solver_cap,
               unusable = capped && f.residual > options.usable_residual;
    felt.capped += capped;
    felt.unusable += unusable;
    run = unusable ? run + 1 : 0;
    felt.longest = std::max(felt.longest, run);
  }
  return felt;
}

struct Difference {
  double rms = 0, of_largest = 0;  // relative to the full force's
  double largest = 0;              // full force [N]
};

Difference difference_of(const Felt& felt, const Felt& full) {
  double error = 0, force = 0, most = 0, peak = 0;
  for (std::size_t t = 0; t < full.force.size(); ++t) {
    const double off = (felt.force[t] - full.force[t]).squaredNorm(), f = full.force[t].squaredNorm();
    error += off;
    force += f;
    most = std::max(most, off);
    peak = std::max(peak, f);
  }
  if (force <= 0) return {};
  return {std::sqrt(error / force), std::sqrt(most / peak), std::sqrt(peak)};
}

}  // namespace

std::vector<std::string> lcp_tick_case_names() { return {"flat_stale", "wedge", "badly_scaled"}; }

LcpTickPoint chart_lcp_ticks(const std::string& kind, const LcpTickSettings& settings,
                             const std::function<bool(double)>& progress) {
  LcpTickPoint point;
  point.kind = kind;
  std::vector<double> full_us;
  for (int k = 0; k < settings.strokes; ++k) {
    const std::uint64_t seed = 1000 * settings.seed + static_cast<std::uint64_t>(k);
    const Felt full = feel(kind, seed, false), felt = feel(kind, seed, true);
    const Difference off = difference_of(felt, full);
    point.force_error_rms = std::max(point.force_error_rms, off.rms);
    point.force_error_of_largest = std::max(point.force_error_of_largest, off.of_largest);
    point.moved_rms = std::max(point.moved_rms, difference_of(feel(kind, seed, false, micrometre), full).rms);
    point.full_force_max = std::max(point.full_force_max, off.largest);
    ++point.strokes;
    point.ticks += static_cast<int>(felt.force.size());
    point.capped += felt.capped;
    point.unusable += felt.unusable;
    point.longest_unusable = std::max(point.longest_unusable, felt.longest);
    point.unusable_in_full += full.unusable;
    full_us.insert(full_us.end(), full.us.begin(), full.us.end());
    if (!progress(static_cast<double>(k + 1) / settings.strokes)) break;
  }
  const Quantiles us = quantiles(full_us);
  point.full_us_median = us.p50;
  point.full_us_p99 = us.p99;
  return point;
}

}  // namespace hapticd
