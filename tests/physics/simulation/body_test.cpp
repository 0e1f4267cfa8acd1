#include "physics/simulation/body.h"

#include <gtest/gtest.h>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;
constexpr double cell = 1e-3;

// A held cube with a flap of two tetrahedra that hangs by the cube's edge at x = y = cell.
struct Hinge {
  Body body;
  std::vector<int> flap;  // its nodes off the hinge

  Hinge() : body(settings(), h, Vec3::Zero()) {
    for (int n = 0; n < body.model.node_count(); ++n)
      if (!body.model.fixed[n]) flap.push_back(n);
    body.compliance->update(body.state);
  }

  static BodySettings settings() {
    BodySettings s;
    s.mesh = box_mesh(Vec3(cell, cell, cell), 1, 1, 1);
    int low = -1, high = -1;
    for (int n = 0; n < static_cast<int>(s.mesh.nodes.size()); ++n) {
      s.fixed_nodes.push_back(n);
      if ((s.mesh.nodes[n] - Vec3(cell, cell, 0)).norm() < 1e-9) low = n;
      if ((s.mesh.nodes[n] - Vec3(cell, cell, cell)).norm() < 1e-9) high = n;
    }
    const int a = static_cast<int>(s.mesh.nodes.size());
    s.mesh.nodes.insert(s.mesh.nodes.end(),
                        {Vec3(2, 1.2, 0.2) * cell, Vec3(1.2, 2, 0.8) * cell, Vec3(2.2, 2.2, 0.6) * cell});
    const auto add = [&](Tet t) {
      if (signed_volume(s.mesh.nodes[t[0]], s.mesh.nodes[t[1]], s.mesh.nodes[t[2]], s.mesh.nodes[t[3]]) < 0)
        std::swap(t[2], t[3]);
      s.mesh.tets.push_back(t);
    };
    add({low, high, a, a + 1});
    add({high, a, a + 1, a + 2});
    s.material = {3000, 0.45, 1000, 0, 0};
    return s;
  }

  // As one linear step turns it: by tan⁻¹ θ, and larger by √(1 + θ²).
  void turn(double theta) {
    for (const int n : flap) {
      const Vec3 arm = body.state.x[n] - Vec3(cell, cell, 0);
      body.state.x[n] += theta * Vec3::UnitZ().cross(arm);
    }
  }

  double longest_free_motion() const {
    double longest = 0;
    for (const int n : flap) longest = std::max(longest, body.free.dx.segment<3>(3 * n).norm());
    return longest;
  }
};

// What one step turned by 60°, the fresh free motion brings back; it does not throw it.
TEST(FreshFreeMotion, AFlapThatTurnedFarIsNotThrown) {
  Hinge hinge;
  hinge.turn(1.7);
  fresh_free_motion(hinge.body, h);
  EXPECT_LT(hinge.longest_free_motion(), 2 * cell);

  // With its new rotation its force would find next to no stiffness.
  compute_free_motion(hinge.body, h);
  EXPECT_GT(hinge.longest_free_motion(), 100 * cell);
}

TEST(FreshFreeMotion, OfWhatTurnedLittleIsThatOfTheNewRotations) {
  Hinge hinge, other;
  hinge.turn(0.2);
  other.turn(0.2);
  fresh_free_motion(hinge.body, h);
  update_rotations(other.body.model, other.body.state);
  compute_free_motion(other.body, h);
  EXPECT_EQ(hinge.body.free.dx, other.body.free.dx);
  EXPECT_EQ(hinge.body.state.rotation, other.body.state.rotation);
}

}  // namespace
}  // namespace hapticd
