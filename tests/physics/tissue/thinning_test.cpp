// Tissue of which a share is left: forces, energy, mass and stiffness are those of so much volume.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "physics/compliance/system_matrix.h"
#include "physics/tissue/stored_energy.h"
#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;

struct Soft {
  TissueModel model;
  TissueState state;

  explicit Soft(Law law = Law::corotational) {
    Material material{3000, 0.45, 1000, 2.0, 3e-3};
    material.law = law;
    TetMesh mesh = box_mesh(Vec3(9e-3, 8e-3, 6e-3), 3, 3, 3);
    const std::vector<int> bottom = mesh.group("bottom")->nodes;
    model = make_tissue_model(std::move(mesh), material, bottom, Vec3(0, 0, -9.81));
    state = rest_state(model);
    std::mt19937 random(3);
    for (int n = 0; n < model.node_count(); ++n)
      if (!model.fixed[n]) state.x[n] += random_vector(random, law == Law::guarded ? 2e-3 : 5e-4);
    update_rotations(model, state);
  }

  void thin(double left) {
    std::vector<Thinned> all;
    for (int t = 0; t < model.tet_count(); ++t) all.push_back({t, left});
    thin_tets(model, state, all);
    update_rotations(model, state);  // what is collapsed follows
  }
  VecX forces() const {
    VecX f(3 * model.node_count());
    internal_forces(model, state, f);
    return f;
  }
};

// Half of everything left, everywhere: half of the forces, the energy, the mass and A.
TEST(Thinning, HalfOfTheTissueIsHalfOfItAll) {
  for (const Law law : {Law::corotational, Law::guarded}) {
    Soft whole(law), half(law);
    half.thin(0.5);
    EXPECT_LT((2 * half.forces() - whole.forces()).norm(), 1e-13 * whole.forces().norm());
    EXPECT_NEAR(2 * elastic_energy(half.model, half.state), elastic_energy(whole.model, whole.state),
                1e-13 * elastic_energy(whole.model, whole.state));
    const VecX still = VecX::Zero(3 * whole.model.node_count());
    EXPECT_NEAR(2 * stored_energy(half.model, half.state, still),
                stored_energy(whole.model, whole.state, still),
                1e-13 * stored_energy(whole.model, whole.state, still));
    const double mass = std::accumulate(whole.state.mass.begin(), whole.state.mass.end(), 0.0);
    EXPECT_NEAR(2 * std::accumulate(half.state.mass.begin(), half.state.mass.end(), 0.0), mass, 1e-13 * mass);
    const MatX A = assemble_system_matrix(whole.model, whole.state, h),
               B = assemble_system_matrix(half.model, half.state, h);
    EXPECT_LT((2 * B - A).norm(), 1e-13 * A.norm());
  }
}

// Energy is a sum over tetrahedra, each in proportion to what is left of it; the force stays its gradient.
TEST(Thinning, ForceIsTheGradientOfWhatIsLeft) {
  Soft s;
  thin_tets(s.model, s.state, std::vector<Thinned>{{3, 0.7}, {50, 0.2}, {51, 0.1}, {90, 0.01}});
  const VecX f = s.forces();
  std::mt19937 random(5);
  for (int trial = 0; trial < 20; ++trial) {
    VecX dx = VecX::Zero(f.size());
    for (int n = 0; n < s.model.node_count(); ++n)
      if (!s.model.fixed[n]) dx.segment<3>(3 * n) = random_vector(random, 1e-8);
    const double change = stored_energy(s.model, s.state, dx) - stored_energy(s.model, s.state, -dx);
    EXPECT_NEAR(change, -2 * f.dot(dx), 1e-6 * f.norm() * dx.norm());
  }
}

TEST(Thinning, OfNothingChangesNothing) {
  Soft s;
  const VecX before = s.forces();
  thin_tets(s.model, s.state, {});
  EXPECT_EQ(s.state.thinnings, 0);
  EXPECT_EQ(s.forces(), before);
}

}  // namespace
}  // namespace hapticd
