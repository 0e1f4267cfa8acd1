// The compliance of one tetrahedron held at its base, and a device's limit: two hand answers from the libraries.
//
//   free apex at height s, nu = 0:   C_zz = 6 / (s E)
#include <cmath>
#include <cstdio>
#include <vector>

#include <haptic/limits.h>
#include <physics/compliance/blas_threads.h>
#include <physics/compliance/compliance.h>

int main() {
  using namespace hapticd;
  use_one_blas_thread();
  constexpr double s = 0.01, young = 6000;
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {s, 0, 0}, {0, s, 0}, {0, 0, s}};
  mesh.tets = {{0, 1, 2, 3}};
  TissueModel model = make_tissue_model(mesh, {young, 0.0, 1000, 0, 0}, std::vector<int>{0, 1, 2}, Vec3::Zero());
  model.dynamic = false;
  const auto compliance = make_compliance(ComplianceMethod::exact, model, 0.02);
  compliance->update(rest_state(model));
  VecX force = VecX::Zero(12), moved(12);
  force[11] = 1;
  compliance->apply(force, moved);
  std::printf("C_zz = %.6f m/N\n", moved[11]);

  DeviceSettings device;
  device.max_force = 3;
  bool hit = false;
  const Wrench felt = saturated(device, {Vec3(0, 0, 10), Vec3::Zero()}, hit);
  std::printf("felt %.1f N\n", felt.force.z());
  return std::abs(moved[11] - 0.1) < 1e-12 && hit && felt.force.z() == 3 ? 0 : 1;
}
