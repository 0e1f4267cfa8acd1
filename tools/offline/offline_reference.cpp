// The truth in time, and what goes in it.
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include "server/scene/scene_world.h"
#include "tools/offline/offline_parts.h"

namespace hapticd {

namespace {

// From all of it at `from` to what is left at `to`.
RemovalEvent become_less(int body, int tet, double from, double to, double left) {
  return {from, body, {tet}, std::max(to - from, offline::tick) / (1 - left)};
}

}  // namespace

OfflineResult run_reference(const Scene& scene, const OfflineInput& input, double h,
                            const OfflineProgress& progress) {
  Scene exact = scene;
  exact.rate = 1 / h;
  exact.compliance = ComplianceMethod::exact;
  exact.contact = Renewal::renewed;
  WorldSettings settings = world_settings(exact);
  settings.removal = {};  // what goes is scheduled
  settings.lead = 0;      // its problems are for their own time
  settings.linearisations = 6;
  settings.coulomb.tolerance = 1e-10;
  settings.coulomb.max_sweeps = 1000;
  std::unique_ptr<World> world = make_world(exact, settings);
  const auto problem = std::make_unique<CondensedProblem>();
  world->step([] { return InstrumentSample{}; }, *problem);

  OfflineResult result;
  offline::Removals removals(input.removals);
  offline::Pumps pumps(input);
  const std::vector<Instrument> shapes = shapes_of(scene);
  StepReport report;
  const auto per_tick = static_cast<int>(std::lround(offline::tick / h));
  const auto settle = static_cast<int>(std::lround(input.settle / h));
  const auto steps = settle + static_cast<int>(std::lround((input.to - input.from) / h));
  for (int i = 0; i < steps; ++i) {
    const double t = input.from + h * (i - settle);
    removals.apply(t, 0, h, *world);
    const bool counts = i >= settle;
    pumps.run(t, h, shapes, report.occlusion);
    InstrumentSamples samples = offline::instruments_at(input, t);
    for (int k = 0; k < static_cast<int>(shapes.size()); ++k) samples[k].vacuum = pumps[k];
    {
      const offline::Cost cost(result.simulation, counts);
      report = world->step([&] { return samples; }, *problem);
    }
    result.removed += report.removed;
    result.inverted = std::max(result.inverted, inverted_tets(world->bodies()));
    result.dropped_samples = std::max(result.dropped_samples, problem->dropped_samples);
    result.capped += report.contact.status != SolveStatus::solved;
    result.memory_bytes = std::max(result.memory_bytes, offline::compliance_bytes(report));
    if (counts && (i - settle) % per_tick == 0)
      for (int k = 0; k < static_cast<int>(scene.instruments.size()); ++k)
        result.hands[k].push_back({t, report.contact.wrench[k], report.contact.penetration,
                                   report.contact.residual, report.contact.active, true});
    if (progress && !progress(static_cast<double>(i + 1) / steps)) break;
  }
  result.cut_area = world->cutting().area();
  return result;
}

RemovalSchedule record_removals(const Scene& scene, const OfflineInput& input, std::optional<int> per_step) {
  constexpr double period = 0.02;
  Scene cutting = scene;
  cutting.rate = 1 / period;
  if (per_step) {
    cutting.first().removal.rate = *per_step / period;
    cutting.first().removal.aspiration_max_tets = 0;
  }
  std::unique_ptr<World> world = make_world(cutting);
  const auto problem = std::make_unique<CondensedProblem>();
  RemovalSchedule schedule;
  std::vector<std::vector<std::uint8_t>> alive;
  std::vector<std::map<int, double>> met(world->bodies().size());  // when a tip did, by tetrahedron
  for (const Body& body : world->bodies()) alive.push_back(body.state.alive);
  const auto steps = static_cast<int>(std::floor((input.to - input.from + input.settle) / period));
  offline::Pumps pumps(input);
  const std::vector<Instrument> shapes = shapes_of(scene);
  StepReport report;
  for (int k = 0; k < steps; ++k) {
    const double t = input.from - input.settle + period * k;
    InstrumentSamples samples = offline::instruments_at(input, t);
    const bool in_window = t >= input.from - offline::instant || input.leads_in;
    pumps.run(t, period, shapes, report.occlusion);
    if (per_step) samples[0].phaco = in_window;
    for (int i = 0; !per_step && in_window && i < max_instruments; ++i) {
      if (!samples[i].present) continue;
      const std::uint32_t pedals = buttons_at(input.motion[i], t);
      samples[i].phaco = pedals & pedal_phaco;
      samples[i].aspiration = pedals & pedal_aspiration;
      samples[i].vacuum = pumps[i];
    }
    report = world->step([&] { return samples; }, *problem);
    for (std::size_t b = 0; b < alive.size(); ++b) {
      const auto& now = world->bodies()[b].state.alive;
      std::vector<int> gone;
      for (std::size_t e = 0; e < now.size(); ++e)
        if (alive[b][e] && !now[e]) gone.push_back(static_cast<int>(e));
      // What goes with a step's problem is what the next would begin by removing.
      const bool ahead = report.removed_ahead == report.removed;
      const double went = t + (ahead ? period : 0) + removal_lead;
      const std::vector<double>& left = world->bodies()[b].state.left;
      for (const int e : gone)
        if (ahead && left[e] < 1) met[b].emplace(e, t + period);
      for (const int e : gone)
        if (const auto at = met[b].find(e); at != met[b].end())
          schedule.push_back(become_less(static_cast<int>(b), e, at->second, went, spent_left));
      if (!gone.empty()) schedule.push_back({went, static_cast<int>(b), gone});
      alive[b] = now;
      for (std::size_t e = 0; e < left.size(); ++e)
        if (now[e] && left[e] < 1) met[b].emplace(static_cast<int>(e), t + period);
    }
  }
  const double end = input.from - input.settle + period * steps;
  for (std::size_t b = 0; b < met.size(); ++b)
    for (const auto& [e, at] : met[b])
      if (alive[b][e])
        schedule.push_back(become_less(static_cast<int>(b), e, at, end, world->bodies()[b].state.left[e]));
  std::stable_sort(schedule.begin(), schedule.end(),
                   [](const RemovalEvent& a, const RemovalEvent& b) { return a.t < b.t; });
  return schedule;
}

}  // namespace hapticd
