// No step makes energy, whatever it was linearised at: hand answers, and bodies that used to fly off.
#include "physics/simulation/step/energy_bound.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "physics/simulation/world.h"
#include "physics/tissue/stored_energy.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;

VecX none(const TissueModel& model) { return VecX::Zero(3 * static_cast<Eigen::Index>(model.node_count())); }

// E of each piece at the state.
VecX energies(const TissueModel& model, const TissueState& state, const Pieces& pieces) {
  VecX energy(pieces.count());
  stored_energies(model, state, pieces, none(model), energy);
  return energy;
}

VecX random_motion(const TissueModel& model, double size, std::mt19937& random) {
  std::uniform_real_distribution<double> part(-size, size);
  VecX dx = none(model);
  for (int n = 0; n < model.node_count(); ++n)
    for (int i = 0; i < 3; ++i)
      if (!model.fixed[n]) dx[3 * n + i] = part(random);
  return dx;
}

Material soft(Law law) {
  Material m{5000, 0.45, 1000, 0, 0.002};
  m.law = law;
  return m;
}

class EnergyOf : public testing::TestWithParam<Law> {};

// At x + Δx without moving there, and by moving there and asking the present energy.
TEST_P(EnergyOf, AMotionIsThatOfTheStateItLeadsTo) {
  std::mt19937 random(7);
  for (const bool corotational : {true, false}) {
    TissueModel model =
        make_tissue_model(box_mesh(Vec3(0.02, 0.02, 0.02), 3, 3, 3), soft(GetParam()), {}, Vec3::Zero());
    model.corotational = corotational;
    TissueState state = rest_state(model);
    remove_tets(model, state, std::vector<int>{3, 40});
    for (int k = 0; k < 20; ++k) {
      const VecX dx = random_motion(model, 4e-3, random);
      TissueState moved = state;
      for (int n = 0; n < model.node_count(); ++n) moved.x[n] += dx.segment<3>(3 * n);
      update_rotations(model, moved);
      const double expected = elastic_energy(model, moved);
      EXPECT_NEAR(stored_energy(model, state, dx), expected, 1e-12 * expected);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Laws, EnergyOf, testing::Values(Law::corotational, Law::guarded));

// Of a free piece that moves rigidly, H is ½ m v²: of a motion of 3 v h a third is kept, and of one of v h
// all. From rest, a push of f = M v/h pays for a motion of up to 2 v h; implicit Euler's is v h, so of 3 v h
// a third is kept. A contact that pushes so has all that is paid for: what is not kept would be penetration.
TEST(EnergyBound, OfARigidMotionFollowsFromItsKineticEnergy) {
  const TissueModel model =
      make_tissue_model(box_mesh(Vec3(0.02, 0.02, 0.02), 2, 2, 2), soft(Law::corotational), {}, Vec3::Zero());
  TissueState state = rest_state(model);
  const Vec3 v(0.1, -0.2, 0.05);
  for (Vec3& of : state.v) of = v;
  VecX dx = none(model), f = none(model);
  for (int n = 0; n < model.node_count(); ++n) {
    dx.segment<3>(3 * n) = 3 * h * v;
    f.segment<3>(3 * n) = state.mass[n] / h * v;
  }
  const Pieces pieces = find_pieces(model, state);
  const auto kept_of = [&](VecX motion, const VecX& external, const VecX& contact) {
    return bound_energy(model, state, pieces, VecX::Zero(1), motion, {external, contact}, h).share;
  };
  const auto kept = [&](const VecX& motion, const VecX& external) {
    return kept_of(motion, external, none(model));
  };
  EXPECT_EQ(kept(dx / 3, none(model)), 1);
  EXPECT_NEAR(kept(dx, none(model)), 1.0 / 3, 0.01);
  EXPECT_LE(kept(dx, none(model)), 1.0 / 3 + 1e-8);
  // What is over by 1e-6 loses 1e-6, not half.
  EXPECT_NEAR(kept(dx / 3 * (1 + 1e-6), none(model)), 1 - 1e-6, 1e-8);
  for (Vec3& of : state.v) of.setZero();
  EXPECT_EQ(kept(dx / 3, f), 1);
  EXPECT_NEAR(kept(dx, f), 1.0 / 3, 0.01);
  EXPECT_NEAR(kept_of(dx, none(model), f), 2.0 / 3, 0.01);
}

TEST(EnergyBound, HoldsForAnyMotion) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> decade(-6, 0);
  for (const Law law : {Law::corotational, Law::guarded}) {
    const TissueModel model =
        make_tissue_model(box_mesh(Vec3(0.02, 0.02, 0.02), 2, 2, 2), soft(law), {}, Vec3::Zero());
    for (int k = 0; k < 300; ++k) {
      TissueState state = rest_state(model);
      const VecX bent = random_motion(model, 2e-3, random), v = random_motion(model, 0.05, random);
      for (int n = 0; n < model.node_count(); ++n) {
        state.x[n] += bent.segment<3>(3 * n);
        state.v[n] = v.segment<3>(3 * n);
      }
      const Pieces pieces = find_pieces(model, state);
      const VecX elastic = energies(model, state, pieces);
      const double before = elastic.sum() + kinetic_energy(model, state);
      VecX dx = random_motion(model, std::pow(10, decade(random)), random);
      const VecX f = random_motion(model, 1e-3, random);
      const VecX nothing = none(model);
      const BodyForces forces = k % 2 == 0 ? BodyForces{f, nothing} : BodyForces{nothing, f};
      const EnergyBound bound = bound_energy(model, state, pieces, elastic, dx, forces, h);
      TissueState after = state;
      for (int n = 0; n < model.node_count(); ++n) after.v[n] = dx.segment<3>(3 * n) / h;
      const double left = stored_energy(model, state, dx), now = kinetic_energy(model, after) + left;
      EXPECT_NEAR(bound.elastic.sum(), left, 1e-9 * before);
      EXPECT_LE(now, before + f.dot(dx) + 1e-8 * before);
    }
  }
}

// A block that is stretched by s, and a motion of three times what undoes that: E is a parabola, so all of
// 2/3 would make no energy, and none would be lost. With next to no mass, what is kept is 1/3: E is lost
// whole.
TEST(EnergyBound, AMotionThatGoesTooFarEndsWhereEnergyIsLeast) {
  Material light = soft(Law::corotational);
  light.density = 1e-9;
  const TissueModel model =
      make_tissue_model(box_mesh(Vec3(0.02, 0.02, 0.02), 2, 2, 2), light, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  const Vec3 middle = Vec3::Constant(0.01);
  VecX dx = none(model);
  for (int n = 0; n < model.node_count(); ++n) {
    const Vec3 stretch = 0.05 * (state.x[n] - middle);
    state.x[n] += stretch;
    dx.segment<3>(3 * n) = -3 * stretch;
  }
  const Pieces pieces = find_pieces(model, state);
  const VecX elastic = energies(model, state, pieces);
  const EnergyBound bound = bound_energy(model, state, pieces, elastic, dx, {none(model), none(model)}, h);
  EXPECT_NEAR(bound.share, 1.0 / 3, 1e-3);
  EXPECT_LT(bound.elastic.sum(), 1e-4 * elastic.sum());
}

TEST(EnergyBound, KeepsOutWhatIsNotANumber) {
  const TissueModel model =
      make_tissue_model(box_mesh(Vec3(0.02, 0.02, 0.02), 2, 2, 2), soft(Law::corotational), {}, Vec3::Zero());
  const TissueState state = rest_state(model);
  VecX dx = none(model);
  dx[4] = std::nan("");
  const Pieces pieces = find_pieces(model, state);
  EXPECT_EQ(bound_energy(model, state, pieces, VecX::Zero(1), dx, {none(model), none(model)}, h).share, 0);
  EXPECT_TRUE(dx.isZero(0));
}

// Two pieces of one body: a motion that makes energy in one of them, and loses more in the other, is kept in
// the other alone.
TEST(EnergyBound, WhatOnePieceLosesNoOtherGains) {
  const TissueModel model =
      make_tissue_model(box_mesh(Vec3(0.06, 0.02, 0.02), 3, 1, 1), soft(Law::corotational), {}, Vec3::Zero());
  TissueState state = rest_state(model);
  std::vector<int> middle;
  for (int t = 0; t < model.tet_count(); ++t) {
    double x = 0;
    for (const int n : model.mesh.tets[t]) x += 0.25 * model.mesh.nodes[n].x();
    if (x > 0.02 && x < 0.04) middle.push_back(t);
  }
  remove_tets(model, state, middle);
  const Pieces pieces = find_pieces(model, state);
  ASSERT_EQ(pieces.count(), 2);
  const Vec3 fast(0.3, 0, 0), slow(0.1, 0, 0);
  VecX dx = none(model);
  for (int n = 0; n < model.node_count(); ++n) {
    const bool left = pieces.of_node[n] == pieces.of_node[0];
    state.v[n] = left ? fast : slow;
    dx.segment<3>(3 * n) = h * (left ? slow : Vec3(2 * slow));
  }
  const VecX whole = dx;
  const EnergyBound bound =
      bound_energy(model, state, pieces, VecX::Zero(2), dx, {none(model), none(model)}, h);
  EXPECT_NEAR(bound.share, 0.5, 0.01);
  EXPECT_NEAR(bound.made, 3, 0.01);
  for (int n = 0; n < model.node_count(); ++n) {
    const double share = pieces.of_node[n] == pieces.of_node[0] ? 1 : bound.share;
    EXPECT_LT((dx.segment<3>(3 * n) - share * whole.segment<3>(3 * n)).norm(), 1e-15);
  }
}

Instrument ball() {
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = 4e-3;
  Instrument instrument;
  instrument.primitives = {tip};
  return instrument;
}

WorldSettings ahead(ComplianceMethod method) {
  WorldSettings s;
  s.h = h;
  s.alarm_distance = 5e-3;
  s.sample_spacing = 1.5e-3;
  s.coupling[0] = {400, 0.04, 2e-3};
  s.compliance = method;
  s.lead = 0.9 * h;
  return s;
}

double energy_of(const Body& body) {
  double height = 0;
  for (int n = 0; n < body.model.node_count(); ++n)
    height -= body.state.mass[n] * body.model.gravity.dot(body.state.x[n] - body.rest()[n]);
  return kinetic_energy(body.model, body.state) + stored_energy(body.model, body.state, none(body.model)) +
         height;
}

BodySettings beam(double young) {
  BodySettings b{"beam", true, box_mesh(Vec3(0.06, 0.01, 0.01), 12, 2, 2), {young, 0.45, 1000, 2, 0.002}, {},
                 0,      true};
  for (int n = 0; n < static_cast<int>(b.mesh.nodes.size()); ++n)
    if (b.mesh.nodes[n].x() == 0) b.fixed_nodes.push_back(n);
  return b;
}

class FreeBody : public testing::TestWithParam<ComplianceMethod> {};

// Pressed for 0.4 s and let go: from then on its energy never rises, and where it ends is where it began.
TEST_P(FreeBody, RestsWhenItIsLetGo) {
  World world({beam(1e6)}, ball(), ahead(GetParam()));
  const Body& body = world.bodies().front();
  const auto problem = std::make_unique<CondensedProblem>();
  double before = 0, most = 0, rise = 0;
  for (int k = 0; k < 200; ++k) {
    for (ReferenceJob& job : world.wanted_references()) {
      job.reference->make();
      world.adopt(std::move(job));
    }
    InstrumentSample sample;
    sample.present = k < 20;
    sample.pose = {Vec3(0.055, 0.005, 0.014 - 6e-3 * std::min(1.0, k / 10.0)), Quat::Identity()};
    world.step([&] { return sample; }, *problem);
    const double now = energy_of(body);
    most = std::max(most, now);
    if (!sample.present) rise = std::max(rise, now - before);
    before = now;
  }
  EXPECT_GT(most, 1e-4);
  EXPECT_LT(rise, 1e-9 * most);
  EXPECT_LT(before, 1e-6 * most);
}

INSTANTIATE_TEST_SUITE_P(Methods, FreeBody,
                         testing::Values(ComplianceMethod::exact, ComplianceMethod::zone,
                                         ComplianceMethod::lazy));

// Under its own weight a beam ends where static equilibrium is, whatever it was linearised at on the way.
TEST(EnergyBound, ABeamUnderItsWeightEndsInEquilibrium) {
  WorldSettings s = ahead(ComplianceMethod::exact), plain = s;
  s.gravity = plain.gravity = Vec3(0, 0, -9.81);
  plain.lead = 0;
  World foreseen({beam(5e4)}, ball(), s), own({beam(5e4)}, ball(), plain);
  const auto problem = std::make_unique<CondensedProblem>();
  double before = 0, rise = 0, deepest = 0;
  for (int k = 0; k < 300; ++k) {
    foreseen.step([] { return InstrumentSample{}; }, *problem);
    own.step([] { return InstrumentSample{}; }, *problem);
    const double now = energy_of(foreseen.bodies().front());
    rise = std::max(rise, now - before);
    before = now;
    deepest = std::min(deepest, now);
  }
  EXPECT_LE(rise, -1e-9 * deepest);
  double largest = 0, apart = 0;
  const Body &a = foreseen.bodies().front(), &b = own.bodies().front();
  for (int n = 0; n < a.model.node_count(); ++n) {
    largest = std::max(largest, (b.state.x[n] - b.rest()[n]).norm());
    apart = std::max(apart, (a.state.x[n] - b.state.x[n]).norm());
  }
  EXPECT_GT(largest, 0.01);
  EXPECT_LT(apart, 2e-3 * largest);
}

// A beam so soft that steps go too far: it comes to rest, and rests where it hangs.
struct SoftBeam {
  double poisson;
  double h;
  ComplianceMethod method;
  Law law;
};
class SoftBeams : public testing::TestWithParam<SoftBeam> {};

TEST_P(SoftBeams, ComeToRestWhereTheyHang) {
  const SoftBeam p = GetParam();
  WorldSettings s = ahead(p.method), fine = s;
  s.h = p.h;
  s.lead = 0.9 * p.h;
  s.gravity = fine.gravity = Vec3(0, 0, -9.81);
  fine.compliance = ComplianceMethod::exact;
  fine.lead = 0;
  fine.h = 0.01;
  const auto soft_beam = [&] {
    BodySettings b = beam(1000);
    b.mesh = box_mesh(Vec3(0.08, 0.005, 0.005), 16, 2, 2);
    b.fixed_nodes.clear();
    for (int n = 0; n < static_cast<int>(b.mesh.nodes.size()); ++n)
      if (b.mesh.nodes[n].x() == 0) b.fixed_nodes.push_back(n);
    b.material.poisson = p.poisson;
    b.material.law = p.law;
    return b;
  };
  World world({soft_beam()}, ball(), s), own({soft_beam()}, ball(), fine);
  const auto problem = std::make_unique<CondensedProblem>();
  const auto run = [&](World& of, double step) {
    for (int k = 0; k * step < 8; ++k) {
      for (ReferenceJob& job : of.wanted_references()) {
        job.reference->make();
        of.adopt(std::move(job));
      }
      of.step([] { return InstrumentSample{}; }, *problem);
    }
    return energy_of(of.bodies().front());
  };
  const double end = run(world, s.h), hanging = run(own, fine.h);
  EXPECT_LT(hanging, -8e-4);
  EXPECT_NEAR(end, hanging, -1e-5 * hanging);
  EXPECT_LT(kinetic_energy(world.bodies().front().model, world.bodies().front().state), -1e-6 * end);
}

INSTANTIATE_TEST_SUITE_P(EnergyBound, SoftBeams,
                         testing::Values(SoftBeam{0.49, 0.04, ComplianceMethod::zone, Law::guarded},
                                         SoftBeam{0.3, 0.04, ComplianceMethod::exact, Law::corotational},
                                         SoftBeam{0.45, 0.02, ComplianceMethod::exact, Law::corotational}));

}  // namespace
}  // namespace hapticd
