#include "tools/offline/operation_history.h"

#include <algorithm>
#include <numeric>

#include "haptic/haptic_step.h"
#include "tools/offline/offline_parts.h"

namespace hapticd {

std::vector<BodyStarts> bodies_along_trajectories(const Scene& scene, const std::vector<double>& instants,
                                                  const OfflineProgress& progress) {
  constexpr double arming = 0.25;  // [s]
  if (instants.empty()) return {};
  std::vector<std::size_t> order(instants.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return instants[a] < instants[b]; });
  std::vector<BodyStarts> starts(instants.size(), BodyStarts(scene.bodies.size()));
  OfflineInput input = along_trajectories(scene, "a history is along it");
  input.settle = arming;
  input.leads_in = true;
  input.pedals = Pedals::all;
  std::size_t taken = 0;
  while (taken < order.size() && instants[order[taken]] <= input.from + offline::instant) ++taken;
  if (taken == order.size()) return starts;
  OfflineOptions options;
  options.limits = true;
  options.blend_time = HapticOptions().blend_time;
  options.before_step = [&](double t, const World& world) {
    for (; taken < order.size() && instants[order[taken]] <= t + offline::instant; ++taken)
      for (std::size_t b = 0; b < world.bodies().size(); ++b)
        if (world.bodies()[b].deformable) starts[order[taken]][b] = start_of(world.bodies()[b]);
  };
  input.to = std::min(input.to, instants[order.back()] + 2 / scene.rate);
  run_offline(scene, input, options,
              [&](double fraction) { return taken < order.size() && (!progress || progress(fraction)); });
  if (taken < order.size()) starts.clear();
  return starts;
}

Scene begun_from(const Scene& scene, const BodyStarts& starts) {
  Scene begun = scene;
  for (std::size_t b = 0; b < starts.size(); ++b) {
    begun.bodies[b].start = starts[b];
    begun.bodies[b].toughness = 0;
    begun.bodies[b].tearing = {};
  }
  return begun;
}

}  // namespace hapticd
