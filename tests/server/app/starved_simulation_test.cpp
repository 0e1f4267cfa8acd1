// A simulation that others leave a fraction of its steps, and whose reference factors come late: the cataract
// scene's stroke with its removals, in real time, one step of 20 ms each 40 to 500 ms.
#include <gtest/gtest.h>

#include <deque>
#include <filesystem>
#include <random>

#include "haptic/device.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"

namespace hapticd {
namespace {

struct Starved {
  double farthest = 0;  // of a node of the lens from where it was at rest [m]
  int steps = 0, removed = 0, synchronous_references = 0;
};

// reference_delay: steps until a reference factor that was asked for is there. Throws what World::step
// throws.
Starved stroke(const Scene& scene, double least, double most, int reference_delay, unsigned seed) {
  const Trajectory motion = read_trajectory(*scene.first().trajectory, LengthUnit::metre);
  const auto world = make_world(scene);
  const auto problem = std::make_unique<CondensedProblem>(), second = std::make_unique<CondensedProblem>();
  std::deque<std::pair<int, ReferenceJob>> references;
  std::mt19937 random(seed);
  Starved run;
  double period = 0;
  for (double t = motion.begin() + 6; t < motion.begin() + 13; t += period, ++run.steps) {
    period = least + (most - least) * (static_cast<double>(random()) / 0x1p32);
    double now = t;
    const auto latest = [&] {
      const std::uint32_t pedals = buttons_at(motion, now);
      InstrumentSample sample;
      sample.pose = to_scene(scene.first().device, sample_at(motion, now));
      sample.present = true;
      sample.phaco = (pedals & pedal_phaco) != 0;
      sample.aspiration = (pedals & pedal_aspiration) != 0;
      sample.time = 1 + now;
      now += 1e-3;  // until the latch
      return sample;
    };
    run.synchronous_references +=
        world->step(latest, *problem, [&]() -> CondensedProblem& { return *second; }).synchronous_references;
    for (ReferenceJob& job : world->wanted_references()) {
      job.reference->make();
      references.emplace_back(run.steps + reference_delay, std::move(job));
    }
    for (; !references.empty() && references.front().first <= run.steps; references.pop_front())
      world->adopt(std::move(references.front().second));
    const Body& lens = world->bodies().front();
    for (std::size_t n = 0; n < lens.state.x.size(); ++n)
      if (lens.state.live_tets_of_node[n] > 0)
        run.farthest = std::max(run.farthest, (lens.state.x[n] - lens.rest()[n]).norm());
  }
  run.removed = world->removed();
  return run;
}

// Nodes had flown by metres in five strokes of six, by 10⁸ m in the end.
TEST(StarvedSimulation, TissueHoldsWhereStepsAndReferencesComeLate) {
  const Scene scene = read_scene(std::filesystem::path(SOURCE_DIR) / "config/scenes/cataract/cataract.yaml");
  struct Case {
    double least, most;
    int reference_delay;
  };
  int made = 0;
  for (const Case& c : {Case{0.1, 0.5, 8}, Case{0.04, 0.15, 20}, Case{0.02, 0.02, 90}})
    for (const unsigned seed : {2u, 3u, 7u}) {
      if (c.least == c.most && seed > 2) continue;
      const Starved run = stroke(scene, c.least, c.most, c.reference_delay, seed);
      EXPECT_GT(run.removed, 2);
      EXPECT_LT(run.farthest, 2.5e-3) << c.least << " to " << c.most << " s, seed " << seed;
      made += run.synchronous_references;
    }
  // What moves far joins the zone, and motion is bounded: a step that made one would be late itself.
  EXPECT_LT(made, 3);
  // In time, none is needed.
  EXPECT_EQ(stroke(scene, 0.02, 0.02, 1, 1).synchronous_references, 0);
}

}  // namespace
}  // namespace hapticd
