// Joint problems taken from steps are the steps' own, and our solver ends on all of them.
#include "tools/chart/pieces/piece_solvers.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "server/scene/scene_reader.h"

namespace hapticd {
namespace {

TEST(PieceSolvers, TakenProblemsAreSolvedByWhatTheStepApplied) {
  const Scene scene = read_scene(std::filesystem::path(SOURCE_DIR) / "config/scenes/fragment/fragment.yaml");
  PieceSolverSettings settings;
  settings.steps = 120;
  settings.problems = 12;
  settings.touches = {10, 30};
  settings.budget_us = 2e3;
  const std::vector<JointProblem> problems = capture_joint_problems(scene, settings, {});
  ASSERT_GE(problems.size(), 8u);
  int instrument = 0;
  for (const JointProblem& p : problems) {
    EXPECT_LT((p.W - p.W.transpose()).cwiseAbs().maxCoeff(), 1e-12 * p.W.cwiseAbs().maxCoeff());
    EXPECT_LT(residual_of(p, p.lambda), 1e-6);
    instrument += p.width() == 3;
    // What bears no force and stays open may go: the others' answer is the same.
    int bear = 0;
    for (int i = 0; i < p.touches(); ++i) bear += p.lambda[p.width() * i] > 0;
    const JointProblem part = nearest_touches(p, bear + 3);
    EXPECT_EQ(part.touches(), std::min(bear + 3, p.touches()));
    EXPECT_LT(residual_of(part, part.lambda), 1e-6);
  }
  EXPECT_GT(instrument, 0);
  int ours = 0;
  for (const PieceSolverPoint& p : compare_solvers(scene.name, problems, settings, {})) {
    if (p.name != "ours") continue;
    ++ours;
    EXPECT_EQ(p.failures, 0);
    EXPECT_EQ(p.unfinished, 0);
    EXPECT_LT(p.residual.max, 1e-6);
  }
  EXPECT_GT(ours, 0);
}

}  // namespace
}  // namespace hapticd
