// Fig. 4 redone: the hole, the oracle, what is read off the points, and the command as a person runs it.
#include "tools/chart/removal/chart_removal.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "physics/compliance/system_matrix.h"
#include "tests/support/mesh_shapes.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

TissueModel box(const MeshRoom& room = {}) {
  const Vec3 size(8e-3, 8e-3, 6e-3);
  TetMesh mesh = box_mesh(size, 4, 4, 3);
  jitter_interior(mesh, size, 3e-4, 5);
  const std::vector<int> bottom = mesh.group("bottom")->nodes;
  return make_tissue_model(std::move(mesh), {3000, 0.45, 1000, 2, 2e-3}, bottom, Vec3::Zero(), room);
}

TEST(ChartRemoval, TheHoleIsCompactAndTakesEachElementOnce) {
  const TissueModel model = box();
  const std::vector<DamageStep> all = growing_hole(model, 100000);
  ASSERT_EQ(static_cast<int>(all.size()), model.tet_count());
  std::set<int> taken;
  for (const DamageStep& step : all) taken.insert(step.tet);
  EXPECT_EQ(static_cast<int>(taken.size()), model.tet_count());
  // The tip stands for many removals, and takes only what it reaches.
  int moves = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    Vec3 centre = Vec3::Zero();
    for (const int n : model.mesh.tets[all[k].tet]) centre += 0.25 * model.mesh.nodes[n];
    EXPECT_LT((centre - all[k].tip).norm(), 6e-3);
    if (k > 0 && all[k].tip != all[k - 1].tip) ++moves;
  }
  EXPECT_LT(moves, model.tet_count() / 5);
  EXPECT_GT(moves, 3);
  EXPECT_EQ(growing_hole(model, 7).size(), 7u);
  EXPECT_EQ(growing_hole(model, 7).back().tet, all[6].tet);
}

TEST(ChartRemoval, TheOracleIsTheDenseInverse) {
  const TissueModel model = box();
  TissueState state = rest_state(model);
  std::vector<int> gone;
  for (const DamageStep& step : growing_hole(model, 90)) gone.push_back(step.tet);
  remove_tets(model, state, gone);
  const std::vector<int> nodes = nearest_live_nodes(model, state, Vec3(4e-3, 4e-3, 4e-3), 12);
  ASSERT_EQ(nodes.size(), 12u);
  const MatX C = MatX(assemble_system_matrix(model, state, 0.02)).llt().solve(MatX::Identity(300, 300));
  const MatX columns = oracle_columns(model, state, 0.02, nodes, 10);
  for (int c = 0; c < 10; ++c)
    for (int i = 0; i < 12; ++i)
      EXPECT_LT(
          (columns.block<3, 1>(3 * i, c) - C.block<3, 1>(3 * nodes[i], 3 * nodes[c / 3] + c % 3)).norm(),
          1e-12 * C.norm());
}

TEST(ChartRemoval, EveryMethodIsRightAtEveryPoint) {
  const TissueModel model = box();
  ChartSettings settings;
  settings.points = 4;
  settings.zone_nodes = 30;
  settings.patch_nodes = 12;
  const std::vector<ChartMethod> methods = chart_methods();
  const std::vector<DamageStep> hole = growing_hole(model, 120);
  double last = 0;
  const RemovalChart chart =
      chart_removals(model, hole, methods, settings, [&](double fraction, const std::string&) {
        EXPECT_GE(fraction, last);
        EXPECT_LE(fraction, 1);
        last = fraction;
        return true;
      });
  ASSERT_EQ(chart.points.size(), 4 * methods.size());
  for (const RemovalPoint& p : chart.points) {
    EXPECT_LT(p.w_rel_error, 1e-10) << p.method << " " << p.order << " " << p.removed;
    EXPECT_GT(p.update_us_median, 0);
    EXPECT_GE(p.update_us_p99, p.update_us_median);
    EXPECT_GT(p.condense_us_median, 0);
    EXPECT_GE(p.step_us_median, p.condense_us_median);
    EXPECT_GT(p.memory_mb, 0);
    EXPECT_EQ(p.removed % 30, 0);
    EXPECT_EQ(p.patch_nodes, 12);
  }
  const RemovalChart stopped =
      chart_removals(model, hole, methods, settings, [](double, const std::string&) { return false; });
  EXPECT_TRUE(stopped.points.empty());
}

// Cuts through a box that lose nothing of it: every method's C_pp is that of the mesh as it is then.
TEST(ChartRemoval, EveryMethodIsRightAfterEveryCut) {
  const BladeWay way = way_of_blade(box({2000, 12000}), 44);
  ASSERT_EQ(way.cuts, 44);
  EXPECT_TRUE(way.strips.back().counts);
  EXPECT_GT(way.used.nodes, 44);
  const TissueModel model = box(way.used);
  Specimen body(model);
  double before = 0, after = 0;
  for (int t = 0; t < model.tets_in_use; ++t) before += model.volume[t];
  for (const DamageStep& step : way.strips) EXPECT_EQ(body.apply(step).empty(), !step.counts);
  for (int t = 0; t < body.model().tets_in_use; ++t) after += body.model().volume[t];
  EXPECT_NEAR(after, before, 1e-12 * before);
  EXPECT_EQ(body.model().nodes_in_use, model.node_count()) << "its room is what it needs";

  ChartSettings settings;
  settings.points = 4;
  settings.zone_nodes = 30;
  settings.patch_nodes = 12;
  const std::vector<ChartMethod> methods = chart_methods();
  const RemovalChart chart =
      chart_removals(model, way.strips, methods, settings, [](double, const std::string&) { return true; });
  ASSERT_EQ(chart.points.size(), 4 * methods.size());
  for (const RemovalPoint& p : chart.points) {
    EXPECT_LT(p.w_rel_error, 1e-10) << p.method << " " << p.order << " " << p.removed;
    EXPECT_GT(p.update_us_median, 0);
    EXPECT_EQ(p.removed % 11, 0);
    EXPECT_EQ(p.nodes, model.nodes_in_use);
  }
}

TEST(ChartRemoval, FlatnessAndCrossingsByHand) {
  std::vector<RemovalPoint> points;
  const auto add = [&](const char* method, int nodes, int removed, double cost) {
    RemovalPoint p;
    p.method = method;
    p.order = "zone_last";
    p.nodes = nodes;
    p.removed = removed;
    p.step_us_median = cost;
    points.push_back(p);
  };
  for (const int removed : {100, 200, 300, 400}) {
    add("exact", 7, removed, 50);
    add("lazy", 7, removed, 0.25 * removed);
    add("lazy", 8, removed, 1.0);
  }
  add("zone", 8, 100, 2);
  EXPECT_DOUBLE_EQ(*flatness(points, "exact", "zone_last", 7), 1);
  EXPECT_DOUBLE_EQ(*flatness(points, "lazy", "zone_last", 7), 4);
  EXPECT_FALSE(flatness(points, "zone", "zone_last", 8));  // one point has no slope
  EXPECT_FALSE(flatness(points, "lazy", "metis", 7));
  EXPECT_DOUBLE_EQ(*crossing(points, "exact", "lazy", 7), 200);
  EXPECT_FALSE(crossing(points, "zone", "lazy", 8));          // never
  EXPECT_DOUBLE_EQ(*crossing(points, "lazy", "zone", 8), 0);  // from the start
}

TEST(ChartRemoval, TheCommandLeavesFiguresPointsAndAPicture) {
  const ScratchDirectory scratch;
  const CommandResult result = run_haptic(
      "chart removal --quick --removals 40 --methods exact,updown,lazy --out " + scratch.file("chart"));
  ASSERT_EQ(result.code, 0) << result.output;
  const nlohmann::json json = nlohmann::json::parse(std::ifstream(scratch.file("chart/removal.json")));
  ASSERT_EQ(json["points"].size(), 30u);
  for (const auto& p : json["points"]) {
    EXPECT_EQ(p["nodes"], 1117);
    EXPECT_EQ(p["tets"], 4878);
    EXPECT_EQ(p["patch_nodes"], 60);
    EXPECT_LT(p["w_rel_error"].get<double>(), 1e-10) << p;
    for (const char* key : {"method", "order", "removed", "update_us_median", "update_us_p99",
                            "condense_us_median", "memory_mb"})
      EXPECT_TRUE(p.contains(key)) << key;
  }
  for (const char* method : {"exact", "updown", "lazy"}) EXPECT_GT(json["flatness"][method].get<double>(), 0);
  std::ifstream csv(scratch.file("chart/removal.csv"));
  int lines = 0;
  for (std::string line; std::getline(csv, line);) ++lines;
  EXPECT_EQ(lines, 31);
  std::ifstream png(scratch.file("chart/removal.png"), std::ios::binary);
  std::string magic(4, ' ');
  png.read(magic.data(), 4);
  EXPECT_EQ(magic, "\x89PNG");
}

TEST(ChartRemoval, WrongUsageIsTwo) {
  for (const char* arguments :
       {"chart", "chart removal --sizes 7k", "chart removal --methods magic", "chart removal --removals 3"})
    EXPECT_EQ(run_haptic(arguments).code, 2) << arguments;
}

}  // namespace
}  // namespace hapticd
