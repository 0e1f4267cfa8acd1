#include "physics/tissue/tissue_parts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "physics/simulation/world.h"
#include "tests/physics/compliance/oracle.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

using oracle::apply_error;
using oracle::inverse;
using oracle::patch_error;

// Every second tetrahedron stiffer, denser and stretched; springs on top.
TissueModel patchwork(bool springs = true) {
  TissueModel model = oracle::box(3, 1, false);
  TissueRegion region{{}, {9000, 0.3, 1200}, Vec3(1.1, 0.95, 1.02)};
  for (int t = 0; t < model.tet_count(); t += 2) region.tets.push_back(t);
  set_region(model, region);
  std::vector<NodeSpring> on(model.mesh.nodes.size());
  for (int n = 0; n < model.node_count(); ++n) {
    const Vec3& x = model.mesh.nodes[n];
    if (x.z() > 0.99 * oracle::size.z()) on[n] = {20.0 + n, x + Vec3(1e-4, -2e-4, 3e-4)};
  }
  if (springs) set_springs(model, on);
  return model;
}

TEST(TissueParts, ForceIsTheNegativeGradientOfTheEnergy) {
  const TissueModel model = patchwork();
  const TissueState state = oracle::deformed(model, 3);
  VecX f(3 * model.node_count());
  internal_forces(model, state, f);
  double worst = 0;
  for (int k = 0; k < f.size(); ++k) {
    constexpr double step = 1e-8;
    double energy[2];
    for (const int side : {0, 1}) {
      TissueState moved = state;
      moved.x[k / 3][k % 3] += side ? step : -step;
      update_rotations(model, moved);
      energy[side] = elastic_energy(model, moved);
    }
    worst = std::max(worst, std::abs((energy[1] - energy[0]) / (2 * step) + f[k]));
  }
  EXPECT_LT(worst, 1e-6 * f.norm());
}

TEST(TissueParts, MassIsThatOfMeshAndDensity) {
  const TissueModel model = patchwork();
  const TissueState state = rest_state(model);
  double mass = 0, expected = 0;
  for (const double m : state.mass) mass += m;
  for (int t = 0; t < model.tet_count(); ++t) {
    const Tet& c = model.mesh.tets[t];
    const auto& x = model.mesh.nodes;
    expected += (t % 2 == 0 ? 1200 : 1000) * signed_volume(x[c[0]], x[c[1]], x[c[2]], x[c[3]]);
  }
  EXPECT_NEAR(mass, expected, 1e-12 * expected);
}

TEST(TissueParts, EveryWayToTheSystemMatrixIsTheSame) {
  const TissueModel model = patchwork();
  const TissueState state = oracle::deformed(model, 4);
  const VecX x = oracle::load(3 * model.node_count());
  const VecX expected = assemble_system_matrix(model, state, oracle::h) * x;
  SystemMatrix blocks(model, node_graph(model), oracle::h);
  blocks.assemble(state);
  EXPECT_LT((blocks.multiply(x) - expected).norm(), 1e-12 * expected.norm());
  EXPECT_LT((multiply_system_matrix(model, state, oracle::h, x) - expected).norm(), 1e-12 * expected.norm());
}

class PartsWithEveryMethod : public testing::TestWithParam<ComplianceMethod> {};

// Springs alone hold the body; elements go, under springs too, until some of those nodes are orphans.
TEST_P(PartsWithEveryMethod, AgreesWithAFreshInverseAfterRemovals) {
  const TissueModel model = patchwork();
  TissueState state = rest_state(model);
  const auto compliance = make_compliance(GetParam(), model, oracle::h);
  const std::vector<int> zone = oracle::nearest(model, oracle::size, 24);
  compliance->move_zone(zone);
  compliance->update(state);
  EXPECT_LT(apply_error(*compliance, inverse<double>(model, state)), 1e-8);
  for (int first = model.tet_count() - 1; first > model.tet_count() - 25; first -= 4) {
    const std::array<int, 4> gone = {first, first - 1, first - 2, first - 3};
    remove_tets(model, state, gone);
    compliance->remove(state, gone);
    compliance->update(state);
    const MatX C = inverse<double>(model, state);
    EXPECT_LT(patch_error(*compliance, C, zone), 1e-8) << first;
    EXPECT_LT(apply_error(*compliance, C), 1e-8) << first;
  }
}

std::string method_name(const testing::TestParamInfo<ComplianceMethod>& method) {
  static constexpr const char* names[] = {"exact", "zone", "lazy", "updown", "dense"};
  return names[static_cast<int>(method.param)];
}
INSTANTIATE_TEST_SUITE_P(, PartsWithEveryMethod,
                         testing::Values(ComplianceMethod::exact, ComplianceMethod::zone,
                                         ComplianceMethod::lazy, ComplianceMethod::updown,
                                         ComplianceMethod::dense),
                         method_name);

constexpr double length = 0.03, side = 0.006, area = side * side;

TissueModel bar(std::span<const int> fixed) {
  TissueModel model =
      make_tissue_model(box_mesh({length, side, side}, 9, 2, 2), {3000, 0, 1000}, fixed, Vec3::Zero());
  model.dynamic = false;
  return model;
}

std::vector<int> nodes_at(const TetMesh& mesh, double x) {
  std::vector<int> nodes;
  for (std::size_t n = 0; n < mesh.nodes.size(); ++n)
    if (std::abs(mesh.nodes[n].x() - x) < 1e-9) nodes.push_back(static_cast<int>(n));
  return nodes;
}

// Two springs in series: a bar of two moduli under an end load F is longer by F/A (L₁/E₁ + L₂/E₂).
TEST(TissueParts, ABarOfTwoModuliIsTwoSpringsInSeries) {
  const TetMesh mesh = box_mesh({length, side, side}, 9, 2, 2);
  TissueModel model = bar(nodes_at(mesh, 0));
  TissueRegion stiff{{}, {12000, 0, 1000}, Vec3::Ones()};
  for (int t = 0; t < model.tet_count(); ++t) {
    double x = 0;
    for (const int n : mesh.tets[t]) x += mesh.nodes[n].x() / 4;
    if (x > length / 3) stiff.tets.push_back(t);
  }
  set_region(model, stiff);
  constexpr double F = 1e-3;
  VecX f = VecX::Zero(3 * model.node_count()), u = f;
  const BoundarySurface surface(mesh);
  for (const SurfaceFace& face : surface.faces()) {
    const Triangle& t = face.nodes;
    const auto& x = mesh.nodes;
    if (std::min({x[t[0]].x(), x[t[1]].x(), x[t[2]].x()}) < length - 1e-9) continue;
    const double share = (x[t[1]] - x[t[0]]).cross(x[t[2]] - x[t[0]]).norm() / 2 / area;
    for (const int n : t) f[3 * n] += F * share / 3;
  }
  const auto compliance = make_compliance(ComplianceMethod::exact, model, 1);
  compliance->update(rest_state(model));
  compliance->apply(f, u);
  const double expected = F / area * (length / 3 / 3000 + 2 * length / 3 / 12000);
  for (const int n : nodes_at(mesh, length)) EXPECT_NEAR(u[3 * n], expected, 1e-9 * expected);
}

// A bar that is held at both ends and stretched by 1 + ε pulls with E A ε.
TEST(TissueParts, AStretchedBarPulls) {
  const TetMesh mesh = box_mesh({length, side, side}, 9, 2, 2);
  TissueModel model = bar({});
  constexpr double strain = 0.05;
  TissueRegion all{{}, model.material, Vec3(1 + strain, 1, 1)};
  for (int t = 0; t < model.tet_count(); ++t) all.tets.push_back(t);
  set_region(model, all);
  VecX f(3 * model.node_count());
  TissueState state = rest_state(model);
  update_rotations(model, state);
  internal_forces(model, state, f);
  double pull = 0, beside = 0;
  for (const int n : nodes_at(mesh, 0)) pull += f[3 * n];
  for (std::size_t n = 0; n < mesh.nodes.size(); ++n) {
    const auto i = static_cast<Eigen::Index>(3 * n);
    if (mesh.nodes[n].x() > 1e-9 && mesh.nodes[n].x() < length - 1e-9) beside += f.segment<3>(i).norm();
  }
  EXPECT_NEAR(pull, 3000 * area * strain, 1e-12);
  EXPECT_LT(beside, 1e-12);  // ν = 0: it is at rest but for its ends
}

// A block on springs sinks by m g / k and rests there, whatever its compliance.
TEST(TissueParts, ABlockOnSpringsSinks) {
  for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone}) {
    BodySettings settings = block("block", {0.01, 0.01, 0.01}, {2, 2, 2}, {2e4, 0.3, 1000, 20, 5e-3});
    const auto& nodes = settings.mesh.nodes;
    settings.springs.resize(nodes.size());
    int count = 0;
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      if (nodes[n].z() > 1e-9) continue;
      settings.springs[n] = {2.0, nodes[n]};
      ++count;
    }
    const double mass = 1000 * 1e-6, expected = mass * 9.81 / (2.0 * count);
    WorldSettings world_settings = contact_world({});
    world_settings.gravity = Vec3(0, 0, -9.81);
    world_settings.compliance = method;
    const std::vector<Vec3> before = nodes;
    World world({settings}, ball(1e-3), world_settings);
    const auto problem = std::make_unique<CondensedProblem>();
    for (int step = 0; step < 150; ++step) world.step([] { return InstrumentSamples(nobody()); }, *problem);
    double sunk = 0;
    for (std::size_t n = 0; n < before.size(); ++n)
      if (before[n].z() < 1e-9) sunk += (before[n].z() - world.bodies()[0].state.x[n].z()) / count;
    EXPECT_NEAR(sunk, expected, 1e-3 * expected);
    EXPECT_LT(fastest_node(world.bodies()[0]), 1e-4);
  }
}

TEST(TissueParts, WhatDoesNotExistIsRefused) {
  TissueModel model = oracle::box(2);
  EXPECT_THROW(set_region(model, {{model.tet_count()}, model.material, Vec3::Ones()}), std::invalid_argument);
  EXPECT_THROW(set_region(model, {{0}, model.material, Vec3(1, 0, 1)}), std::invalid_argument);
  EXPECT_THROW(set_springs(model, std::vector<NodeSpring>(model.mesh.nodes.size() + 1)),
               std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
