#include "physics/compliance/factor/multifrontal_factor.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "physics/compliance/factor/cholmod_factor.h"
#include "tests/physics/compliance/oracle.h"
#include "tests/support/front_kernel_sets.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

using oracle::box;
using oracle::deformed;
using oracle::h;
using oracle::relative;

// A body with its matrix, and the order with a zone last.
struct Body {
  Body(TissueModel model_, TissueState state_, std::vector<int> zone_)
      : model(std::move(model_)),
        state(std::move(state_)),
        zone(std::move(zone_)),
        graph(node_graph(model)),
        matrix(model, graph, h) {
    matrix.assemble(state);
    live = matrix.live_edges(state);
    order = zone_last_order(matrix.graph_of(live), fill_reducing_order(graph), zone);
  }

  TissueModel model;
  TissueState state;
  std::vector<int> zone;
  NodeGraph graph;
  SystemMatrix matrix;
  std::vector<std::uint8_t> live;
  std::vector<int> order;
};

template <class Factor>
VecX solved(Factor& factor, const VecX& b) {
  VecX y(b.size());
  const auto nodes = static_cast<int>(b.size() / 3);
  Eigen::Map<VecX> x = factor.vector();
  for (int n = 0; n < nodes; ++n)
    for (int r = 0; r < 3; ++r) x[3 * factor.place(n) + r] = b[3 * n + r];
  factor.solve();
  for (int n = 0; n < nodes; ++n)
    for (int r = 0; r < 3; ++r) y[3 * n + r] = x[3 * factor.place(n) + r];
  return y;
}

void expect_equals_cholmod(const Body& body, const FrontKernels& kernels) {
  SCOPED_TRACE(kernels.name);
  const int zone = static_cast<int>(body.zone.size());
  MultifrontalFactor own(kernels);
  own.set_order(body.matrix, body.order, body.live, zone);
  own.factor(body.matrix);
  CholmodFactor cholmod;
  cholmod.set_order(body.matrix, body.order, body.live);
  cholmod.factor(body.matrix);

  const VecX b = oracle::load(3 * body.model.node_count());
  const VecX y = solved(own, b);
  const VecX expected = solved(cholmod, b);
  EXPECT_LT(relative(y, expected), 1e-12);
  const double residual = (body.matrix.multiply(y) - b).norm();
  EXPECT_LT(residual, 10 * (body.matrix.multiply(expected) - b).norm());
  for (const int n : body.zone) EXPECT_EQ(own.place(n), cholmod.place(n));
  MatX corner;
  MatX expected_corner;
  own.trailing_corner(zone, corner);
  cholmod.trailing_corner(zone, expected_corner);
  EXPECT_LT(relative(corner, expected_corner), 1e-12);
  EXPECT_EQ(MatX(corner.triangularView<Eigen::Lower>()), corner);
}

TEST(MultifrontalFactor, OneElementByHand) {
  // One dense front: L is A's own dense factor, and its first entry √A₁₁.
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}, {0, 0, 1e-3}};
  mesh.tets = {{0, 1, 2, 3}};
  TissueModel model = make_tissue_model(std::move(mesh), {3000, 0.45, 1000, 2.0, 3e-3}, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  const Body body(std::move(model), std::move(state), {});
  MultifrontalFactor factor;
  factor.set_order(body.matrix, std::vector<int>{0, 1, 2, 3}, {}, 4);
  factor.factor(body.matrix);
  MatX corner;
  factor.trailing_corner(4, corner);
  const MatX A = MatX(assemble_system_matrix(body.model, body.state, h));
  EXPECT_LT(relative(corner * corner.transpose(), A), 1e-15);
  EXPECT_NEAR(corner(0, 0), std::sqrt(A(0, 0)), 1e-15 * std::sqrt(A(0, 0)));
}

TEST(MultifrontalFactor, SmallBodiesEqualTheDenseFactor) {
  for (const FrontKernels* kernels : front_kernel_sets())
    for (int cells = 1; cells <= 4; ++cells)
      for (int zone = 0; zone <= 40; zone += 8) {
        TissueModel model = box(cells);
        TissueState state = deformed(model, 7 * cells + zone);
        std::vector<int> nodes = oracle::nearest(model, oracle::size, zone);
        const Body body(std::move(model), std::move(state), std::move(nodes));
        MultifrontalFactor factor(*kernels);
        factor.set_order(body.matrix, body.order, {}, static_cast<int>(body.zone.size()));
        factor.factor(body.matrix);
        const MatX A = MatX(assemble_system_matrix(body.model, body.state, h));
        const VecX b = oracle::load(A.rows());
        EXPECT_LT(relative(solved(factor, b), A.llt().solve(b)), 1e-11) << kernels->name << " " << cells;
      }
}

TEST(MultifrontalFactor, EqualsCholmodAtThePapersSizeWhileTissueIsRemoved) {
  TissueModel model = box(9);
  TissueState state = deformed(model, 3, 5e-5);
  for (const int zone : {0, 60, 160}) {
    std::vector<int> nodes = oracle::nearest(model, oracle::size, zone);
    const Body body(model, state, nodes);
    for (const FrontKernels* kernels : front_kernel_sets()) expect_equals_cholmod(body, *kernels);
    // A hole that grows from the corner: orphans, in the zone too.
    std::vector<int> gone;
    for (int t = 0; t < model.tet_count(); ++t)
      if (std::ranges::any_of(model.mesh.tets[t], [&](int n) {
            return (model.mesh.nodes[n] - oracle::size).norm() < 1e-3 + 1e-5 * zone;
          }))
        gone.push_back(t);
    remove_tets(model, state, gone);
    ASSERT_EQ(state.live_tets_of_node[oracle::nearest(model, oracle::size, 1)[0]], 0);
    expect_equals_cholmod(Body(model, state, nodes), front_kernels());
  }
}

// The pattern of all edges, with tissue gone since: what lies outside the live pattern is exact zeros.
TEST(MultifrontalFactor, AnOrderOutlivesRemovals) {
  TissueModel model = box(4);
  TissueState state = deformed(model, 9);
  Body body(model, state, oracle::nearest(model, oracle::size, 12));
  MultifrontalFactor factor;
  factor.set_order(body.matrix, body.order, body.live, 12);
  remove_tets(model, state, std::vector<int>{10, 50, 90, 91, 92, 200, 300, 301});
  body.matrix.assemble(state);
  for (int again = 0; again < 2; ++again) {
    factor.factor(body.matrix);
    const VecX b = oracle::load(3 * model.node_count());
    EXPECT_LT((body.matrix.multiply(solved(factor, b)) - b).norm(), 1e-11 * b.norm());
  }
}

TEST(MultifrontalFactor, RefusesASingularMatrixAndRecovers) {
  TissueModel weightless = box(3, 0, false);
  const Body singular(weightless, rest_state(weightless), {});
  TissueModel model = box(3, 1, false);
  const Body regular(model, rest_state(model), {});
  MultifrontalFactor factor;
  factor.set_order(singular.matrix, singular.order, {}, 0);
  EXPECT_THROW(factor.factor(singular.matrix), std::runtime_error);
  factor.factor(regular.matrix);
  const VecX b = oracle::load(3 * model.node_count());
  EXPECT_LT((regular.matrix.multiply(solved(factor, b)) - b).norm(), 1e-10 * b.norm());
}

TEST(MultifrontalFactor, FactorAndSolveAllocateNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to a sanitizer";
  TissueModel model = box(5);
  TissueState state = deformed(model, 4);
  const Body body(model, state, oracle::nearest(model, oracle::size, 30));
  MultifrontalFactor factor;
  factor.set_order(body.matrix, body.order, body.live, 30);
  const MallocGuard guard;
  factor.factor(body.matrix);
  factor.vector().setOnes();
  factor.solve();
  EXPECT_EQ(guard.allocations(), 0);
  EXPECT_EQ(guard.frees(), 0);
}

TEST(MultifrontalFactor, CholmodIsTheFallback) {
  TissueModel model = box(3);
  TissueState state = deformed(model, 6);
  const std::vector<int> zone = oracle::nearest(model, oracle::size, 10);
  MatX blocks[2];
  VecX answers[2];
  const Factorisation both[] = {Factorisation::multifrontal, Factorisation::cholmod};
  for (int k = 0; k < 2; ++k) {
    ComplianceOptions options;
    options.factorisation = both[k];
    const auto compliance = make_exact_compliance(model, h, options);
    compliance->move_zone(zone);
    compliance->update(state);
    blocks[k].resize(30, 30);
    compliance->patch(zone, blocks[k]);
    answers[k].resize(3 * model.node_count());
    compliance->apply(oracle::load(answers[k].size()), answers[k]);
  }
  EXPECT_LT(relative(blocks[0], blocks[1]), 1e-12);
  EXPECT_LT(relative(answers[0], answers[1]), 1e-12);
}

}  // namespace
}  // namespace hapticd
