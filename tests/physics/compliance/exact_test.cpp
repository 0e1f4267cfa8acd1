#include <gtest/gtest.h>

#include <Eigen/LU>
#include <filesystem>
#include <iterator>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "physics/compliance/compliance.h"
#include "physics/compliance/system_matrix.h"
#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

const Vec3 size(9e-3, 8e-3, 6e-3);
const Material soft{3000, 0.45, 1000, 2.0, 3e-3};
constexpr double h = 0.02;

TissueModel held_box(int cells) {
  TetMesh mesh = box_mesh(size, cells, cells, cells);
  jitter_interior(mesh, size, 0.2 * size.z() / cells, 11);
  const std::vector<int> bottom = mesh.group("bottom")->nodes;
  return make_tissue_model(std::move(mesh), soft, bottom, Vec3::Zero());
}

TissueState deformed(const TissueModel& model, unsigned seed) {
  std::mt19937 random(seed);
  TissueState state = rest_state(model);
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) state.x[n] += random_vector(random, 4e-4);
  update_rotations(model, state);
  return state;
}

// C with zero rows and columns where a node is not in the system.
MatX dense_compliance(const TissueModel& model, const TissueState& state) {
  MatX C = MatX(assemble_system_matrix(model, state, h)).inverse();
  for (int n = 0; n < model.node_count(); ++n) {
    if (!model.fixed[n] && state.live_tets_of_node[n] > 0) continue;
    C.middleRows(3 * n, 3).setZero();
    C.middleCols(3 * n, 3).setZero();
  }
  return C;
}

MatX block_of(const MatX& C, const std::vector<int>& nodes) {
  std::vector<int> index;
  for (const int n : nodes)
    for (int r = 0; r < 3; ++r) index.push_back(3 * n + r);
  return C(index, index);
}

// apply() on a random vector and patch() on `nodes`, both against the dense inverse.
void expect_matches_dense(const TissueModel& model, const TissueState& state, Compliance& compliance,
                          const std::vector<int>& nodes) {
  const MatX C = dense_compliance(model, state);
  std::mt19937 random(21);
  VecX b(C.rows());
  for (int n = 0; n < model.node_count(); ++n) b.segment<3>(3 * n) = random_vector(random, 1.0);
  VecX y(b.size());
  compliance.apply(b, y);
  EXPECT_LT((y - C * b).norm(), 1e-10 * (C * b).norm());
  VecX aliased = b;
  compliance.apply(aliased, aliased);
  EXPECT_EQ(aliased, y);

  const auto dofs = static_cast<Eigen::Index>(3 * nodes.size());
  MatX block(dofs, dofs);
  compliance.patch(nodes, block);
  EXPECT_LE((block - block_of(C, nodes)).norm(), 1e-10 * block_of(C, nodes).norm());
  EXPECT_EQ(block, MatX(block.transpose()));
  EXPECT_LT(compliance.report().residual, 1e-11);
  EXPECT_EQ(compliance.report().health, ComplianceHealth::good);
}

TEST(SystemMatrix, BlocksEqualTheTripletOracle) {
  const TissueModel model = held_box(3);
  TissueState state = deformed(model, 1);
  remove_tets(model, state, std::vector<int>{3, 30, 77, 78, 79, 120});
  SystemMatrix matrix(model, node_graph(model), h);
  matrix.assemble(state);
  const Eigen::SparseMatrix<double> A = assemble_system_matrix(model, state, h);
  std::mt19937 random(2);
  for (int i = 0; i < 5; ++i) {
    VecX x(A.rows());
    for (int n = 0; n < model.node_count(); ++n) x.segment<3>(3 * n) = random_vector(random, 1.0);
    EXPECT_LT((matrix.multiply(x) - A * x).norm(), 1e-14 * (A * x).norm());
  }
}

// A linear body's factor serves until something of it is gone.
TEST(ExactCompliance, FollowsTissueThatBecomesThin) {
  for (const bool corotational : {true, false}) {
    TissueModel model = held_box(3);
    model.corotational = corotational;
    TissueState state = deformed(model, 3);
    const auto compliance = make_exact_compliance(model, h);
    for (const double left : {1.0, 0.5, 0.1}) {
      thin_tets(model, state, std::vector<Thinned>{{3, left}, {40, left}, {41, left / 2}});
      compliance->update(state);
      expect_matches_dense(model, state, *compliance, {});
    }
  }
}

TEST(ExactCompliance, MatchesTheDenseInverseWhileTheZoneMoves) {
  const TissueModel model = held_box(3);
  const TissueState state = deformed(model, 3);
  const auto compliance = make_exact_compliance(model, h);
  compliance->update(state);
  expect_matches_dense(model, state, *compliance, {});
  std::mt19937 random(4);
  for (int move = 0; move < 8; ++move) {
    std::vector<int> nodes(model.node_count());
    std::iota(nodes.begin(), nodes.end(), 0);
    std::shuffle(nodes.begin(), nodes.end(), random);
    // From a few nodes to all of them; fixed ones are among them.
    nodes.resize(move == 7 ? nodes.size() : 4 + 6 * move);
    compliance->move_zone(nodes);
    compliance->update(state);
    EXPECT_TRUE(compliance->zone_covers(nodes));
    std::vector<int> patch(nodes.begin() + static_cast<int>(nodes.size()) / 4, nodes.end());
    expect_matches_dense(model, state, *compliance, patch);
    expect_matches_dense(model, state, *compliance, nodes);
  }
}

TEST(ExactCompliance, KnowsItsZone) {
  const TissueModel model = held_box(2);
  const auto compliance = make_exact_compliance(model, h);
  const int fixed = 0;
  const std::vector<int> zone = {20, 22, fixed};
  compliance->move_zone(zone);
  EXPECT_TRUE(compliance->zone_covers(zone));
  EXPECT_TRUE(compliance->zone_covers(std::vector<int>{1, 2, 22}));  // fixed nodes need no cover
  EXPECT_FALSE(compliance->zone_covers(std::vector<int>{20, 21}));
  MatX block(3, 3);
  EXPECT_THROW(compliance->patch(std::vector<int>{20}, block), std::runtime_error);  // no update yet
  compliance->update(rest_state(model));
  compliance->patch(std::vector<int>{fixed}, block);
  EXPECT_EQ(block, MatX(MatX::Zero(3, 3)));
  EXPECT_THROW(compliance->move_zone(std::vector<int>{27}), std::invalid_argument);
  compliance->move_zone(std::vector<int>{21});  // of the next factor
  EXPECT_FALSE(compliance->zone_covers(std::vector<int>{21}));
  compliance->update(rest_state(model));
  EXPECT_TRUE(compliance->zone_covers(std::vector<int>{21}));
}

// Patches that lie within the zone, partly, and not at all; the zone wanted next is nobody's business.
TEST(ExactCompliance, NodesOutsideTheZoneAreRightToo) {
  TissueModel model = held_box(3);
  TissueState state = deformed(model, 3);
  remove_tets(model, state, std::vector<int>{3, 30, 77, 78, 79, 120});
  for (const Factorisation by : {Factorisation::multifrontal, Factorisation::cholmod}) {
    ComplianceOptions options;
    options.factorisation = by;
    const auto compliance = make_exact_compliance(model, h, options);
    std::mt19937 random(6);
    std::vector<int> nodes(model.node_count());
    std::iota(nodes.begin(), nodes.end(), 0);
    for (const int zone : {0, 1, 12, 40}) {
      std::shuffle(nodes.begin(), nodes.end(), random);
      compliance->move_zone(std::span(nodes).first(zone));
      compliance->update(state);
      compliance->move_zone(std::span(nodes).last(20));
      for (const int first : {0, zone / 2, zone, 44})
        expect_matches_dense(model, state, *compliance, {nodes.begin() + first, nodes.begin() + first + 20});
      expect_matches_dense(model, state, *compliance, nodes);
    }
  }
}

TEST(ExactCompliance, RemovingElementsEqualsAssemblingWithoutThem) {
  const TissueModel model = held_box(3);
  TissueState state = deformed(model, 5);
  const auto compliance = make_exact_compliance(model, h);
  const int corner = model.node_count() - 1;
  const std::vector<int> zone = {corner, corner - 1, corner - 4, corner - 5, corner - 16, corner - 17};
  compliance->move_zone(zone);
  compliance->update(state);

  // Everything around the corner node, which becomes an orphan, and more inside the zone.
  std::vector<int> gone = {100, 101};
  for (int t = 0; t < model.tet_count(); ++t)
    for (const int n : model.mesh.tets[t])
      if (n == corner) gone.push_back(t);
  remove_tets(model, state, gone);
  ASSERT_EQ(state.live_tets_of_node[corner], 0);
  compliance->update(state);
  expect_matches_dense(model, state, *compliance, zone);

  TetMesh rest;
  rest.nodes = model.mesh.nodes;
  std::vector<Mat3> rotation;
  for (int t = 0; t < model.tet_count(); ++t) {
    if (!state.alive[t]) continue;
    rest.tets.push_back(model.mesh.tets[t]);
    rotation.push_back(state.rotation[t]);
  }
  std::vector<int> fixed;
  for (int n = 0; n < model.node_count(); ++n)
    if (model.fixed[n]) fixed.push_back(n);
  const TissueModel without = make_tissue_model(std::move(rest), soft, fixed, Vec3::Zero());
  TissueState other = rest_state(without);
  other.x = state.x;
  other.rotation = rotation;
  const MatX A = MatX(assemble_system_matrix(model, state, h));
  const MatX B = MatX(assemble_system_matrix(without, other, h));
  EXPECT_LT((A - B).norm(), 1e-14 * A.norm());

  const auto fresh = make_exact_compliance(without, h);
  fresh->move_zone(zone);
  fresh->update(other);
  MatX C(18, 18);
  MatX D(18, 18);
  compliance->patch(zone, C);
  fresh->patch(zone, D);
  EXPECT_LT((C - D).norm(), 1e-12 * D.norm());
  EXPECT_EQ(C.topRows(3), MatX(MatX::Zero(3, 18)));  // the orphan
}

// Zones that mingle nodes of both pieces, in any order.
TEST(ExactCompliance, PiecesAreFactoredEachByItself) {
  const TissueModel model = held_box(3);
  TissueState state = deformed(model, 8);
  std::vector<int> middle(54);
  std::iota(middle.begin(), middle.end(), 54);
  remove_tets(model, state, middle);
  const auto compliance = make_exact_compliance(model, h);
  std::mt19937 random(9);
  std::vector<int> nodes(model.node_count());
  std::iota(nodes.begin(), nodes.end(), 0);
  for (const int zone : {2, 5, 20, 60}) {
    std::shuffle(nodes.begin(), nodes.end(), random);
    compliance->move_zone(std::span(nodes).first(zone));
    compliance->update(state);
    expect_matches_dense(model, state, *compliance, {nodes.begin(), nodes.begin() + zone});
    // Of the same factor, other nodes of its corner, and some outside it.
    expect_matches_dense(model, state, *compliance,
                         {nodes.begin() + zone / 2, nodes.begin() + std::min(zone + 4, 64)});
    MatX C(3 * zone, 3 * zone);
    compliance->patch(std::span(nodes).first(zone), C);
    for (int i = 0; i < zone; ++i)
      for (int j = 0; j < zone; ++j) {
        if (nodes[i] / 32 == nodes[j] / 32) continue;
        EXPECT_TRUE((C.block<3, 3>(3 * i, 3 * j).isZero(0)));
      }
  }
}

TEST(ExactCompliance, ABodyCutInTwoIsStillSolvable) {
  const TissueModel model = held_box(3);
  TissueState state = deformed(model, 6);
  std::vector<int> middle(54);
  std::iota(middle.begin(), middle.end(), 54);  // the cells of the middle layer
  remove_tets(model, state, middle);
  const auto compliance = make_exact_compliance(model, h);
  const std::vector<int> zone = {48, 49, 52, 53, 32, 16};  // of the loose piece, and of the held one
  compliance->move_zone(zone);
  compliance->update(state);
  expect_matches_dense(model, state, *compliance, zone);

  // The loose piece moves as one: a force F on it moves its centre of mass by F / (m/h² + α m/h).
  VecX b = VecX::Zero(3 * model.node_count());
  b[3 * 63 + 2] = 1e-3;
  VecX y(b.size());
  compliance->apply(b, y);
  double mass = 0;
  double moment = 0;
  for (int n = 32; n < 64; ++n) {
    mass += state.mass[n];
    moment += state.mass[n] * y[3 * n + 2];
  }
  EXPECT_NEAR(moment, 1e-3 / (1 / (h * h) + soft.rayleigh_mass / h), 1e-9 * moment);
  EXPECT_GT(mass, 0);
  EXPECT_LT(y.head(3 * 32).norm(), 1e-15);
}

TEST(ExactCompliance, CutToNothingMovesNothing) {
  const TissueModel model = held_box(2);
  TissueState state = rest_state(model);
  std::vector<int> all(model.tet_count());
  std::iota(all.begin(), all.end(), 0);
  remove_tets(model, state, all);
  const auto compliance = make_exact_compliance(model, h);
  compliance->move_zone(std::vector<int>{25, 26});
  compliance->update(state);
  VecX y(3 * model.node_count());
  compliance->apply(VecX::Ones(y.size()), y);
  EXPECT_EQ(y.norm(), 0);
  MatX block(6, 6);
  compliance->patch(std::vector<int>{25, 26}, block);
  EXPECT_EQ(block.norm(), 0);
  EXPECT_EQ(compliance->report().residual, 0);
}

TEST(ExactCompliance, RefusesABodyWithNeitherMassNorSupport) {
  Material weightless = soft;
  weightless.density = 0;
  const TissueModel model = make_tissue_model(box_mesh(size, 2, 2, 2), weightless, {}, Vec3::Zero());
  const auto compliance = make_exact_compliance(model, h);
  EXPECT_THROW(compliance->update(rest_state(model)), std::runtime_error);
  VecX y(3 * model.node_count());
  EXPECT_THROW(compliance->apply(VecX::Ones(y.size()), y), std::runtime_error);
  EXPECT_THROW(static_cast<void>(make_exact_compliance(model, 0.0)), std::invalid_argument);
}

TEST(ExactCompliance, OneTetrahedronIsEnough) {
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}, {0, 0, 1e-3}};
  mesh.tets = {{0, 1, 2, 3}};
  const TissueModel model = make_tissue_model(std::move(mesh), soft, {}, Vec3::Zero());
  const TissueState state = rest_state(model);
  const auto compliance = make_exact_compliance(model, h);
  compliance->move_zone(std::vector<int>{2});
  compliance->update(state);
  expect_matches_dense(model, state, *compliance, {2});
}

// CHOLMOD's own OpenMP threads would spin beside the haptic loop.
TEST(ExactCompliance, FactorisationStartsNoThreads) {
  const TissueModel model = held_box(5);
  const TissueState state = rest_state(model);
  const auto compliance = make_exact_compliance(model, h);
  const auto threads = [] {
    return std::distance(std::filesystem::directory_iterator("/proc/self/task"), {});
  };
  long started = 0;
  std::thread([&] {
    const auto before = threads();
    compliance->update(state);
    started = threads() - before;
  }).join();
  EXPECT_EQ(started, 0);
}

}  // namespace
}  // namespace hapticd
