#include "physics/cutting/rest_grid.h"

#include "tests/physics/cutting/cut_body.h"
#include "tests/physics/tissue/random_shapes.h"

namespace hapticd {
namespace {

std::vector<int> looked_for(const CutBody& body, const Eigen::AlignedBox3d& wanted) {
  std::vector<int> tets;
  for (int t = 0; t < body.model.tets_in_use; ++t) {
    if (!body.state.alive[t]) continue;
    Eigen::AlignedBox3d box;
    for (const int n : body.model.mesh.tets[t]) box.extend(body.model.mesh.nodes[n]);
    if (box.intersects(wanted)) tets.push_back(t);
  }
  return tets;
}

TEST(RestGrid, FindsWhatALookAtEveryElementFinds) {
  CutBody body{box_mesh({2, 1, 0.5}, 6, 4, 3, 6), {400, 6000}};
  RestGrid grid(body.model);
  std::mt19937 random(1);
  std::vector<int> found;
  int hits = 0;
  for (int k = 0; k < 300; ++k) {
    const auto [a, b] = body.random_edge(random);
    ASSERT_EQ(body.split(a, b, 0.5), CutStatus::done);
    if (k % 10 == 0) body.remove({static_cast<int>(random() % body.model.tets_in_use)});
    const Vec3 centre = Vec3(1, 0.5, 0.25) + Vec3(1, 0.5, 0.5).cwiseProduct(random_vector(random, 1.2));
    const Vec3 half = random_vector(random, 0.3).cwiseAbs();
    const Eigen::AlignedBox3d box(centre - half, centre + half);
    grid.find(body.model, body.state, box, found);
    ASSERT_EQ(found, looked_for(body, box)) << k;
    hits += !found.empty();
  }
  EXPECT_GT(hits, 50);
  EXPECT_LT(hits, 290);
}

}  // namespace
}  // namespace hapticd
