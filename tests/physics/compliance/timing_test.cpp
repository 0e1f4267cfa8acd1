// Not a test: prints the table of physics/compliance/MEASURED.md. Run by
//   test_physics --gtest_also_run_disabled_tests --gtest_filter='*Timing*'
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <malloc.h>
#include <numeric>

#include "physics/compliance/compliance.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

void report(const char* what, const std::function<void()>& work) {
  std::vector<double> ms(31);
  for (double& t : ms) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    t = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  }
  std::sort(ms.begin(), ms.end());
  std::printf("%-36s median %7.3f   best %7.3f   worst %7.3f ms\n", what, ms[15], ms.front(), ms.back());
}

TEST(Timing, DISABLED_ExactStepOfThePapersSize) {
  // As the daemon does: without it, page faults dominate.
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  TetMesh mesh = box_mesh({9e-3, 9e-3, 6e-3}, 10, 10, 8);
  const std::vector<int> bottom = mesh.group("bottom")->nodes;
  const Material soft{3000, 0.45, 1000, 0, 1e-3};
  const TissueModel model = make_tissue_model(std::move(mesh), soft, bottom, Vec3::Zero());
  TissueState state = rest_state(model);
  std::printf("%d nodes, %d tetrahedra\n", model.node_count(), model.tet_count());

  std::vector<int> nearest(model.node_count());
  std::iota(nearest.begin(), nearest.end(), 0);
  const Vec3 tip(4.5e-3, 4.5e-3, 6e-3);
  std::sort(nearest.begin(), nearest.end(), [&](int a, int b) {
    return (model.mesh.nodes[a] - tip).norm() < (model.mesh.nodes[b] - tip).norm();
  });
  bool stretched = false;
  report("rotations, body moving", [&] {
    for (Vec3& x : state.x) x = Vec3(x.x() + (stretched ? -40 : 40) * x.z() * x.z(), x.y(), x.z());
    stretched = !stretched;
    update_rotations(model, state);
  });
  VecX f(3 * model.node_count());
  report("internal forces", [&] { internal_forces(model, state, f); });

  const auto compliance = make_exact_compliance(model, 0.02);
  for (const int size : {60, 100, 160}) {
    const std::vector<int> zone(nearest.begin(), nearest.begin() + size);
    std::printf("zone of %d nodes\n", size);
    report("  zone moved, and update", [&] {
      compliance->move_zone({});
      compliance->move_zone(zone);
      compliance->update(state);
    });
    report("  update", [&] { compliance->update(state); });
    MatX block(180, 180);
    report("  patch of the 60 nearest", [&] { compliance->patch({zone.data(), 60}, block); });
    report("  patch of the 60 farthest", [&] { compliance->patch({zone.data() + size - 60, 60}, block); });
  }
  f.setRandom();
  report("apply", [&] { compliance->apply(f, f); });
}

}  // namespace
}  // namespace hapticd
