// What touches another body goes where the contact solve puts it, and makes no energy by its velocity.
#include "physics/simulation/body_contact/velocity_bound.h"

#include <gtest/gtest.h>

#include "physics/tissue/stored_energy.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;

struct Pushed {
  Body body;
  VecX force, dx;

  // A free block, pushed at one corner node by f [N]; dx is its whole motion.
  Pushed(const Vec3& spin, const Vec3& f)
      : body(block("block", Vec3(4e-3, 4e-3, 4e-3), {2, 2, 2}, {5000, 0.4, 1000, 0, 2e-3}), h, Vec3::Zero()) {
    const Vec3 centre = centre_of(body);
    for (int n = 0; n < body.model.node_count(); ++n) body.state.v[n] = spin.cross(body.state.x[n] - centre);
    body.compliance->update(body.state);
    compute_free_motion(body, h);
    force = VecX::Zero(body.free.dx.size());
    force.head<3>() = f;
    dx.resize(force.size());
    body.compliance->apply(force, dx);
    dx += body.free.dx;
  }
  double energy() const {
    return kinetic_energy(body.model, body.state) +
           stored_energy(body.model, body.state, VecX::Zero(force.size()));
  }
};

TEST(VelocityBound, AMotionThatMakesNoneIsThatOfCorrect) {
  Pushed one(Vec3(0, 0, 0.1), Vec3(1e-5, 0, 0)), other(Vec3(0, 0, 0.1), Vec3(1e-5, 0, 0));
  correct_touching(one.body, one.force, std::vector<int>{0}, h);
  correct(other.body, &other.force, h);
  EXPECT_EQ(one.body.state.x, other.body.state.x);
  EXPECT_EQ(one.body.state.v, other.body.state.v);
  EXPECT_EQ(one.body.energy.bounded_steps, 0);
}

// A spin of 30 rad/s turns by 0.6 rad in a step: linearised at its start that is a stretch by a tenth.
TEST(VelocityBound, ATouchingPieceKeepsItsWayAndItsMomentum) {
  for (const bool touching : {true, false}) {
    Pushed p(Vec3(0, 0, 30), Vec3(2e-5, 1e-5, 0));
    const std::vector<Vec3> start = p.body.state.x;
    const double before = p.energy(), work = p.force.dot(p.dx);
    correct_touching(p.body, p.force, touching ? std::vector<int>{0} : std::vector<int>(), h);
    Vec3 momentum = Vec3::Zero(), expected = Vec3::Zero();
    double off = 0;
    for (int n = 0; n < p.body.model.node_count(); ++n) {
      momentum += p.body.state.mass[n] * p.body.state.v[n];
      expected += p.body.state.mass[n] / h * p.dx.segment<3>(3 * n);
      off = std::max(off, (p.body.state.x[n] - start[n] - p.dx.segment<3>(3 * n)).norm());
    }
    EXPECT_LT((momentum - expected).norm(), 1e-12 * expected.norm());
    if (touching)
      EXPECT_LT(off, 1e-15);
    else
      EXPECT_GT(off, 1e-5);  // held back by energy_bound.h
    EXPECT_EQ(p.body.energy.bounded_steps, 1);
    // By its velocity it may lose all that is not its mean motion, and no more.
    const double mean = 0.5 * momentum.squaredNorm() / mass_of(p.body);
    const double strain = stored_energy(p.body.model, p.body.state, VecX::Zero(p.force.size()));
    EXPECT_LE(p.energy(), std::max(before + work, mean + strain) * (1 + 1e-8));
  }
}

}  // namespace
}  // namespace hapticd
