// The chart of forces: errors with hand answers, the front, the table's faults, a fitted recording, and one
// run.
#include "tools/chart/force/chart_force.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <stdexcept>

#include <unistd.h>

#include "server/files/input_error.h"
#include "server/scene/scene_reader.h"
#include "tools/offline/reference_cache.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

std::vector<OfflineTick> ticks(int n, const std::function<double(double)>& fz) {
  std::vector<OfflineTick> out(n);
  for (int i = 0; i < n; ++i) {
    out[i].t = 1e-3 * i;
    out[i].wrench[2] = fz(out[i].t);
    out[i].swapped = i % 20 == 0;
  }
  return out;
}

TEST(ForceErrors, OfAConstantOffsetAreTheOffset) {
  const auto reference = ticks(400, [](double t) { return t < 0.1 ? 0 : 2.0; });
  const auto run = ticks(400, [](double t) { return t < 0.11 ? 0.101 : 2.101; });
  const ForceError e = force_error(run, reference);
  EXPECT_DOUBLE_EQ(e.peak, 2);
  // 10 of 400 ticks are 1.899 off, the others 0.101.
  EXPECT_NEAR(e.rms_rel, std::sqrt((10 * 1.899 * 1.899 + 390 * 0.101 * 0.101) / 400) / 2, 1e-12);
  EXPECT_NEAR(e.max_rel, 1.899 / 2, 1e-12);
  EXPECT_NEAR(e.onset_ms, -100, 1e-6) << "its 0.1 N are 5 % of the peak, and there from the beginning";
  EXPECT_NEAR(e.swap_jump_p95_rel, 1.0, 0.01) << "of 19 swaps the one at 0.1 s jumps by 2 N";
}

// Tissue goes under load: a step that the reference has too is neither jump nor excess.
TEST(ForceErrors, AtASwapTheStepIsToldFromTheReferencesOwn) {
  const auto reference = ticks(400, [](double t) { return t < 0.0999 ? 2.0 : 0; });
  const auto run = ticks(400, [](double t) { return t < 0.0999 ? 2.1 : 0.3; });
  const ForceError e = force_error(run, reference);
  EXPECT_NEAR(e.reference_step_p95_rel, 1, 1e-12);
  EXPECT_NEAR(e.swap_step_p95_rel, 0.9, 1e-12);
  EXPECT_NEAR(e.swap_jump_p95_rel, 0.1, 1e-12);
  EXPECT_EQ(e.swap_excess_p95_rel, 0);
  EXPECT_NEAR(force_error(reference, run).swap_excess_p95_rel, 0.2 / 2.1, 1e-12);
}

TEST(ForceErrors, ATonePutsItsPowerWhereItIs) {
  const double amplitude = 3e-3;
  for (const double hertz : {10.0, 80.0}) {
    const auto reference = ticks(500, [](double) { return 1.0; });
    const auto run =
        ticks(500, [&](double t) { return 1 + amplitude * std::sin(2 * std::numbers::pi * hertz * t); });
    const double buzz = force_error(run, reference).buzz_rms_n;
    EXPECT_NEAR(buzz, hertz > 30 ? amplitude / std::numbers::sqrt2 : 0, 1e-3 * amplitude) << hertz;
    double sum = 0;
    for (const double p : error_spectrum(run, reference).power) sum += p;
    EXPECT_NEAR(std::sqrt(sum), amplitude / std::numbers::sqrt2, 1e-3 * amplitude);
  }
}

// A hand whose force is small is not hidden by the other's.
TEST(ForceErrors, OfSeveralHandsEachIsItsOwnPeaksShare) {
  HandTicks reference, run;
  reference[0] = ticks(100, [](double) { return 2.0; });
  reference[1] = ticks(100, [](double) { return 0.1; });
  run[0] = ticks(100, [](double) { return 2.02; });
  run[1] = ticks(100, [](double) { return 0.12; });
  const std::vector<ForceError> hands = force_errors(run, reference);
  ASSERT_EQ(hands.size(), 2u);
  EXPECT_NEAR(hands[0].rms_rel, 0.01, 1e-12);
  EXPECT_NEAR(hands[1].rms_rel, 0.2, 1e-12);
  EXPECT_EQ(worst(hands).rms_rel, hands[1].rms_rel);
  EXPECT_EQ(worst({}).rms_rel, 0);
}

TEST(ForceChart, TheFrontIsWhatNothingBeats) {
  const auto point = [](double cost, double error, bool converged) {
    ForcePoint p;
    p.trajectory = "a";
    p.cpu_ms_per_s = cost;
    p.error.rms_rel = error;
    p.reference_converged = converged;
    return p;
  };
  std::vector<ForcePoint> points = {point(1, 0.3, true), point(10, 0.02, true), point(20, 0.04, true),
                                    point(11, 0.021, true), point(5, 0.001, false)};
  mark_front(points);
  EXPECT_TRUE(points[0].pareto);
  EXPECT_TRUE(points[1].pareto);
  EXPECT_FALSE(points[2].pareto);
  EXPECT_NEAR(points[2].front_factor, 2, 1e-12);
  EXPECT_FALSE(points[3].pareto);
  EXPECT_NEAR(points[3].front_factor, 1.05, 1e-12);
  EXPECT_FALSE(points[4].pareto) << "what has not converged is on no front";
}

class ForceTableFile : public testing::Test {
 protected:
  const fs::path file = fs::temp_directory_path() / ("force_table_" + std::to_string(getpid()) + ".yaml");
  ~ForceTableFile() override { fs::remove(file); }
  ForceTable read(const std::string& text) {
    std::ofstream(file) << text;
    return read_force_table(file);
  }
};

TEST_F(ForceTableFile, IsReadKeyByKey) {
  const ForceTable table = read(
      "default: a\nconfigurations:\n  - {label: a, quick: true}\n"
      "  - {label: b, rate: 25, compliance: zone, warping: node, contact: frozen, friction: false,\n"
      "     rendering: held, newest_pose: false, tolerance: 1.0e-4, sweeps: 7}\n");
  ASSERT_EQ(table.configurations.size(), 2u);
  const ForceConfiguration& b = table.configurations[1];
  EXPECT_EQ(*b.rate, 25);
  EXPECT_EQ(*b.compliance, ComplianceMethod::zone);
  EXPECT_EQ(*b.options.warping, Warping::node);
  EXPECT_EQ(*b.contact, Renewal::frozen);
  EXPECT_FALSE(b.friction);
  EXPECT_EQ(b.options.rendering, Rendering::held);
  EXPECT_FALSE(b.options.newest_pose);
  EXPECT_EQ(b.options.tolerance, 1e-4);
  EXPECT_EQ(b.options.sweeps_only, 7);
  EXPECT_EQ(b.words["tolerance"], 1e-4);
  EXPECT_EQ(b.words["compliance"], "zone");
}

TEST_F(ForceTableFile, NamesItsFaults) {
  EXPECT_THROW(read("default: a\nconfigurations:\n  - {label: b}\n"), InputError);
  EXPECT_THROW(read("default: a\nconfigurations:\n  - {label: a}\n  - {label: a}\n"), InputError);
  EXPECT_THROW(read("default: a\nconfigurations:\n  - {label: a, complience: zone}\n"), InputError);
  EXPECT_THROW(read("default: a\nconfigurations:\n  - {label: a, rate: 0}\n"), InputError);
  const std::string configurations = "\ndefault: a\nconfigurations: [{label: a}]\n";
  EXPECT_EQ(read("windows: [{name: w, from: 1, to: 2, removals: true}]" + configurations).windows.size(), 1u);
  EXPECT_TRUE(
      read("windows: [{name: w, from: 1, to: 2, history: true}]" + configurations).windows[0].history);
  EXPECT_THROW(read("windows: [{name: w, from: 2, to: 1}]" + configurations), InputError);
  EXPECT_THROW(read("windows: [{name: w, from: 1}]" + configurations), InputError);
}

TEST(ForceTable, TheShippedOneIsRight) {
  const ForceTable table = read_force_table(SOURCE_DIR "/config/charts/force.yaml");
  EXPECT_GT(table.configurations.size(), 30u);
  const Scene scene = read_scene(SOURCE_DIR "/config/scenes/stroke/stroke.yaml");
  for (const ForceConfiguration& c : table.configurations)
    EXPECT_FALSE(configured(scene, c).bodies[0].fixed_nodes.empty()) << c.label;
}

// The cube's own press, laid as if it were a stranger's: as deep as asked, upright, begun at contact.
TEST(ForceMotion, AStrangersRecordingIsFittedIntoTheTissue) {
  Scene scene = read_scene(SOURCE_DIR "/config/scenes/stroke/stroke.yaml");
  WindowSettings settings;
  settings.depth = 0.2e-3;
  const OfflineInput input = motion_in_scene(scene, SOURCE_DIR "/config/scenes/cube/press.csv", settings);
  double deepest = -1;
  for (const TrajectorySample& s : input.motion[0].samples)
    deepest = std::max(deepest, rest_overlap(scene, s.pose));
  EXPECT_NEAR(deepest, 0.2e-3, 1e-6);
  EXPECT_LE(rest_overlap(scene, sample_at(input.motion[0], input.from)), 0);
  EXPECT_GT(rest_overlap(scene, sample_at(input.motion[0], input.from + 2 * settings.lead)), 0);
}

// One that never leaves the tissue is come down to: put there at once, what friction holds would be chance.
TEST(ForceMotion, ARecordingThatBeginsInTheTissueIsApproached) {
  const Scene scene = read_scene(SOURCE_DIR "/config/scenes/stroke/stroke.yaml");
  const fs::path file = fs::temp_directory_path() / ("held_" + std::to_string(getpid()) + ".csv");
  std::ofstream(file) << "t,px,py,pz,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n0.5,0.001,0,0,0,0,0,1\n1,0,0,0,0,0,0,1\n";
  const OfflineInput input = motion_in_scene(scene, file, {});
  fs::remove(file);
  EXPECT_EQ(input.from, 0);
  Pose X = sample_at(input.motion[0], input.from);
  EXPECT_GT(rest_overlap(scene, X), 0.2e-3);
  X.p.z() += input.approach[0];
  EXPECT_LT(rest_overlap(scene, X), 0);
}

// A blade's strokes are windows of the scene's own trajectory, before the blade is in the tissue.
TEST(ForceMotion, ABladesWindowsBeginOutsideOfTheTissue) {
  const Scene scene = read_scene(SOURCE_DIR "/config/scenes/incision/incision.yaml");
  const ForceTable table = read_force_table(SOURCE_DIR "/config/charts/force_cut.yaml");
  ASSERT_FALSE(table.windows.empty());
  double first = 0;
  for (const Vec3& x : scene.bodies[0].mesh.nodes) first = std::min(first, x.x());
  for (const ForceWindow& w : table.windows) {
    const OfflineInput input = motions_in_window(scene, w);
    EXPECT_EQ(input.approach[0], 0) << w.name;
    EXPECT_LT(sample_at(input.motion[0], w.from).p.x(), first) << w.name;
    EXPECT_GT(sample_at(input.motion[0], w.to).p.x(), first + 5e-3) << w.name;
  }
}

// What it is cut by is part of what a reference depends on.
TEST(ReferenceCache, KnowsTheBladeAndTheTissuesToughness) {
  const Scene scene = read_scene(SOURCE_DIR "/config/scenes/incision/incision.yaml");
  const OfflineInput input =
      motions_in_window(scene, read_force_table(SOURCE_DIR "/config/charts/force_cut.yaml").windows[0]);
  Scene other = scene;
  other.bodies[0].toughness *= 2;
  EXPECT_NE(reference_key(scene, input, 1e-3), reference_key(other, input, 1e-3));
  other = scene;
  Blade& blade = other.first().shape.blade;
  blade = make_blade(blade.edge, blade.direction, 8);
  EXPECT_NE(reference_key(scene, input, 1e-3), reference_key(other, input, 1e-3));
}

// Every stage of the operation, each on the hands' one time axis; a pump's draw and a body's state are part
// of what a reference depends on.
TEST(ForceTable, ThePhacosWindowsAreOfEachStage) {
  const Scene scene = read_scene(SOURCE_DIR "/config/scenes/phaco/phaco.yaml");
  const ForceTable table = read_force_table(SOURCE_DIR "/config/charts/force_phaco.yaml");
  double before = -1;
  for (const ForceWindow& w : table.windows) {
    EXPECT_GT(w.from, before) << w.name;
    before = w.from;
    const OfflineInput input = motions_in_window(scene, w);
    EXPECT_EQ(input.leads_in, w.history) << w.name;
    EXPECT_EQ(input.pedals == Pedals::suction, w.removals) << w.name;
    if (!w.history) continue;
    EXPECT_EQ(input.approach[0], 0) << w.name;
    OfflineInput other = input;
    other.pedals = Pedals::all;
    EXPECT_NE(reference_key(scene, input, 1e-3), reference_key(scene, other, 1e-3));
    other = input;
    other.leads_in = false;
    EXPECT_NE(reference_key(scene, input, 1e-3), reference_key(scene, other, 1e-3));
  }
}

class HandsScene : public testing::Test {
 protected:
  Scene scene = read_scene(SOURCE_DIR "/config/scenes/two_hands/two_hands.yaml");
  const ForceTable table = read_force_table(SOURCE_DIR "/config/charts/force_hands.yaml");

  ForceWindow window(const std::string& name) const {
    for (const ForceWindow& w : table.windows)
      if (w.name == name) return w;
    throw std::out_of_range(name);
  }
};

// Both hands are in contact where the window begins, so both come down to there.
TEST_F(HandsScene, ItsWindowsAreRunAlongBothTrajectories) {
  for (const ForceWindow& w : table.windows) {
    const OfflineInput input = motions_in_window(scene, w);
    EXPECT_EQ(input.from, w.from);
    EXPECT_EQ(input.to, w.to);
    EXPECT_EQ(w.removals, w.name == "sculpt");
  }
  const OfflineInput press = motions_in_window(scene, window("press"));
  for (const int i : {0, 1}) {
    EXPECT_FALSE(press.motion[i].samples.empty()) << i;
    EXPECT_GT(press.approach[i], 0.2e-3) << i;
    EXPECT_LT(press.approach[i], 1e-3) << i;
  }
  EXPECT_TRUE(press.motion[2].samples.empty());
}

TEST_F(HandsScene, AHandWithoutATrajectoryOrATooShortOneIsRefused) {
  ForceWindow late = window("press");
  late.to = 1000;
  EXPECT_THROW(motions_in_window(scene, late), InputError);
  scene.instruments[1].trajectory.reset();
  EXPECT_THROW(motions_in_window(scene, window("press")), InputError);
}

TEST_F(HandsScene, AReferenceIsKeptWithBothHandsUnderTheInputsOfBoth) {
  const fs::path directory = fs::temp_directory_path() / ("hands_" + std::to_string(getpid()));
  OfflineInput input = motions_in_window(scene, window("press"));
  input.to = input.from + 0.01;
  input.settle = 0.01;
  const OfflineResult fresh = cached_reference(directory, scene, input, 1e-3, {});
  const OfflineResult kept = cached_reference(directory, scene, input, 1e-3, {});
  for (const int hand : {0, 1}) {
    ASSERT_EQ(kept.hands[hand].size(), 10u);
    for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(kept.hands[hand][i].wrench, fresh.hands[hand][i].wrench);
  }
  EXPECT_TRUE(kept.hands[2].empty());
  OfflineInput other = input;
  std::swap(other.motion[0], other.motion[1]);
  EXPECT_NE(reference_key(scene, other, 1e-3), reference_key(scene, input, 1e-3));
  Scene softer = scene;
  softer.instruments[1].coupling.stiffness *= 0.5;
  EXPECT_NE(reference_key(softer, input, 1e-3), reference_key(scene, input, 1e-3));
  fs::remove_all(directory);
}

TEST(ReferenceCache, KeepsWhatWasRun) {
  const fs::path directory = fs::temp_directory_path() / ("references_" + std::to_string(getpid()));
  const Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");
  WindowSettings settings;
  settings.length = 0.05;
  const OfflineInput input = motion_in_scene(scene, *scene.first().trajectory, settings);
  const OfflineResult fresh = cached_reference(directory, scene, input, 1e-3, {});
  const OfflineResult kept = cached_reference(directory, scene, input, 1e-3, [](double) {
    ADD_FAILURE() << "it is there already";
    return true;
  });
  ASSERT_EQ(kept.ticks().size(), fresh.ticks().size());
  for (std::size_t i = 0; i < kept.ticks().size(); ++i)
    EXPECT_EQ(kept.ticks()[i].wrench, fresh.ticks()[i].wrench);
  EXPECT_NE(reference_key(scene, input, 1e-3), reference_key(scene, input, 5e-4));
  Scene other = scene;
  other.bodies[0].material.young *= 2;
  EXPECT_NE(reference_key(scene, input, 1e-3), reference_key(other, input, 1e-3));
  fs::remove_all(directory);
}

}  // namespace
}  // namespace hapticd
