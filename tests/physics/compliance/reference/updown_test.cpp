// The pieces of a low-rank removal, each with a hand answer.
#include <gtest/gtest.h>

#include <stdexcept>

#include "physics/compliance/compliance.h"
#include "physics/compliance/element_term.h"
#include "physics/compliance/reference/warp_rotation.h"
#include "physics/compliance/system_matrix.h"
#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

const Vec3 size(9e-3, 8e-3, 6e-3);
constexpr double h = 0.02;

TEST(ElementTerm, IsWhatTheAssemblyLosesWithTheElement) {
  for (const double density : {1000.0, 0.0}) {
    TetMesh mesh = box_mesh(size, 2, 2, 2);
    const std::vector<int> bottom = mesh.group("bottom")->nodes;
    const TissueModel model =
        make_tissue_model(std::move(mesh), {3000, 0.45, density, 2, 3e-3}, bottom, Vec3::Zero());
    TissueState state = rest_state(model);
    std::mt19937 random(3);
    for (Mat3& R : state.rotation) R = random_rotation(random);
    for (const int t : {0, 13, 30, 47}) {
      const Tet& tet = model.mesh.tets[t];
      const Tet reversed = {tet[3], tet[1], tet[0], tet[2]};
      const ElementTerm term = element_term(model, h, t, 1, state.rotation[t], reversed);
      TissueState without = state;
      remove_tets(model, without, std::span(&t, 1));
      MatX lost = MatX(assemble_system_matrix(model, state, h) - assemble_system_matrix(model, without, h));
      double largest = 0;
      int free_corners = 0;
      for (int i = 0; i < 4; ++i) {
        if (model.fixed[reversed[i]]) continue;
        ++free_corners;
        for (int j = 0; j < 4; ++j) {
          // Fixed and orphan nodes have the identity instead.
          if (model.fixed[reversed[j]] || without.live_tets_of_node[reversed[i]] == 0 ||
              without.live_tets_of_node[reversed[j]] == 0)
            continue;
          const Mat3 expected = lost.block<3, 3>(3 * reversed[i], 3 * reversed[j]);
          const Mat3 product = term.V.middleRows<3>(3 * i) * term.V.middleRows<3>(3 * j).transpose();
          largest = std::max(largest, expected.norm());
          EXPECT_LT((product - expected).norm(), 1e-14 * 10) << t;
        }
      }
      EXPECT_GT(largest, 0.1);
      // Six modes that strain it; of a held one fewer are free. With mass, every coordinate counts.
      EXPECT_EQ(term.rank, density > 0 ? 3 * free_corners : std::min(6, 3 * free_corners)) << t;
    }
  }
}

TEST(WarpRotation, IsTheRotationOfARigidTurn) {
  const TissueModel model =
      make_tissue_model(box_mesh(size, 2, 2, 2), {3000, 0.45, 1000, 0, 0}, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  std::mt19937 random(4);
  for (Mat3& R : state.rotation) R = random_rotation(random);
  WarpRotation turn(model);
  turn.set_reference(state.rotation, model.tets_in_use);
  const Mat3 Q = Eigen::AngleAxisd(0.8, Vec3(3, -1, 2).normalized()).toRotationMatrix();
  for (Mat3& R : state.rotation) R = Q * R;
  for (int n = 0; n < model.node_count(); ++n) EXPECT_LT((turn(n, state) - Q).norm(), 1e-13);
  EXPECT_NEAR(angle_of(turn(5, state)), 0.8, 1e-13);
  std::fill(state.alive.begin(), state.alive.end(), std::uint8_t{0});
  EXPECT_EQ(turn(5, state), Mat3(Mat3::Identity()));
}

TEST(DenseCompliance, RefusesLargeBodies) {
  const TissueModel model =
      make_tissue_model(box_mesh(size, 14, 14, 14), {3000, 0.45, 1000, 0, 0}, {}, Vec3::Zero());
  ASSERT_GT(model.node_count(), 3000);
  const auto compliance = make_compliance(ComplianceMethod::dense, model, h);
  EXPECT_THROW(compliance->update(rest_state(model)), std::invalid_argument);
}

TEST(UpdownCompliance, KnowsItsZoneAndMovesIt) {
  TetMesh mesh = box_mesh(size, 2, 2, 2);
  const std::vector<int> bottom = mesh.group("bottom")->nodes;
  const TissueModel model =
      make_tissue_model(std::move(mesh), {3000, 0.45, 1000, 2, 3e-3}, bottom, Vec3::Zero());
  const TissueState state = rest_state(model);
  const auto updown = make_compliance(ComplianceMethod::updown, model, h);
  const int fixed = 0;
  const std::vector<int> zone = {20, 22, fixed};
  updown->move_zone(zone);
  MatX block(3, 3);
  EXPECT_THROW(updown->patch(std::vector<int>{20}, block), std::runtime_error);
  updown->update(state);
  updown->patch(std::vector<int>{fixed}, block);
  EXPECT_EQ(block, MatX(MatX::Zero(3, 3)));
  EXPECT_FALSE(updown->zone_covers(std::vector<int>{20, 21}));
  EXPECT_THROW(updown->patch(std::vector<int>{21}, block), std::invalid_argument);
  EXPECT_THROW(updown->move_zone(std::vector<int>{27}), std::invalid_argument);
  updown->update(state);
  EXPECT_EQ(updown->report().reference_age, 2);
  updown->move_zone(std::vector<int>{21});
  updown->update(state);
  EXPECT_EQ(updown->report().reference_age, 1);  // a new order is a new reference factor
  updown->patch(std::vector<int>{21}, block);
  EXPECT_GT(block.determinant(), 0);

  // Bent since the reference factor: warping is not exact then, and the report says so.
  TissueState bent = state;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) bent.x[n].x() += 4e-3 * std::pow(bent.x[n].z() / size.z(), 2);
  update_rotations(model, bent);
  updown->update(bent);
  const ComplianceReport report = updown->report();
  EXPECT_NE(report.health, ComplianceHealth::good);
  EXPECT_GT(report.residual, 1e-3);
  EXPECT_GT(report.rotation_since_reference, 0.1);
}

}  // namespace
}  // namespace hapticd
