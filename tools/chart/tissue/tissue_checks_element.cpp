// The element: patch test, invariance, force against energy, tangent against force.
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <random>

#include "physics/compliance/system_matrix.h"
#include "physics/tissue/rotation.h"
#include "physics/tissue/tetrahedron.h"
#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_check.h"
#include "tools/chart/tissue/tissue_static.h"

namespace hapticd {

namespace {

const Vec3 size(9e-3, 8e-3, 6e-3);
const Material soft{3000, 0.45, 1000, 0, 0};

TissueModel irregular_box(int cells) {
  TetMesh mesh = box_mesh(size, cells, cells, cells);
  jitter_interior(mesh, size, 0.25 * size.z() / cells, 7);
  return make_tissue_model(std::move(mesh), soft, {}, Vec3::Zero());
}

Mat3 random_matrix(std::mt19937& random, double largest) {
  std::uniform_real_distribution<double> uniform(-largest, largest);
  Mat3 M;
  for (int c = 0; c < 3; ++c)
    for (int r = 0; r < 3; ++r) M(r, c) = uniform(random);
  return M;
}

Mat3 random_turn(std::mt19937& random) {
  return nearest_rotation_by_svd(random_matrix(random, 1), Mat3::Identity());
}

// Every node off its place by up to `amount`.
TissueState shaken(const TissueModel& model, double amount, std::mt19937& random) {
  TissueState state = rest_state(model);
  for (Vec3& x : state.x) x += amount * random_matrix(random, 1).col(0);
  update_rotations(model, state);
  return state;
}

VecX forces(const TissueModel& model, const TissueState& state) {
  VecX f(3 * model.node_count());
  internal_forces(model, state, f);
  return f;
}

// The force's slope by central differences, column by column.
MatX slope_of_force(const TissueModel& model, const TissueState& state, double step) {
  MatX K(3 * model.node_count(), 3 * model.node_count());
  for (Eigen::Index k = 0; k < K.cols(); ++k) {
    TissueState moved = state;
    moved.x[k / 3][k % 3] += step;
    update_rotations(model, moved);
    const VecX forward = forces(model, moved);
    moved.x[k / 3][k % 3] -= 2 * step;
    update_rotations(model, moved);
    K.col(k) = (forces(model, moved) - forward) / (2 * step);
  }
  return K;
}

}  // namespace

void check_patch(Effort, TissueFindings& findings) {
  const TissueModel model = irregular_box(4);
  std::mt19937 random(4);
  const Mat3 G = random_matrix(random, 0.05);
  Held held;
  for (int axis = 0; axis < 3; ++axis)
    for (int n = 0; n < model.node_count(); ++n)
      if (on_box_boundary(model.mesh.nodes[n], size)) held[3 * n + axis] = (G * model.mesh.nodes[n])[axis];
  const VecX u = solve_linear(model, VecX::Zero(3 * model.node_count()), held);
  VecX exact(u.size());
  for (int n = 0; n < model.node_count(); ++n) exact.segment<3>(3 * n) = G * model.mesh.nodes[n];
  const char* irons = "an affine field is a solution: Irons 1966";
  findings.check("patch test, displacement inside", 0, (u - exact).norm() / exact.norm(), 1e-12, irons);

  // Pulled along x by a uniform traction, held by rollers only: stress and both strains are uniform.
  const double pull = 10;
  Held rollers;
  for (int axis = 0; axis < 3; ++axis)
    hold(
        model, axis, [&](const Vec3& x) { return x[axis] < 1e-9; }, rollers);
  const VecX load =
      surface_load(model, Vec3(pull, 0, 0), [](const Vec3& x) { return x.x() > size.x() - 1e-9; });
  const VecX stretched = solve_linear(model, load, rollers);
  const int corner = model.node_count() - 1;
  findings.check("uniaxial stress: E from the stretch [Pa]", soft.young,
                 pull / (stretched[3 * corner] / size.x()), 1e-10, "Hooke");
  findings.check("uniaxial stress: Poisson's ratio", soft.poisson,
                 -(stretched[3 * corner + 2] / size.z()) / (stretched[3 * corner] / size.x()), 1e-10,
                 "Hooke");
}

void check_invariance(Effort, TissueFindings& findings) {
  const TissueModel model = irregular_box(3);
  std::mt19937 random(3);
  double energy_change = 0, force_change = 0, push = 0, twist = 0, rigid = 0;
  for (int trial = 0; trial < 10; ++trial) {
    const TissueState state = shaken(model, 4e-4, random);
    const Mat3 Q = random_turn(random);
    const Vec3 shift = random_matrix(random, 0.05).col(0);
    TissueState moved = state;
    TissueState carried = rest_state(model);
    for (int n = 0; n < model.node_count(); ++n) {
      moved.x[n] = Q * state.x[n] + shift;
      carried.x[n] = Q * carried.x[n] + shift;
    }
    update_rotations(model, moved);
    update_rotations(model, carried);
    const double energy = elastic_energy(model, state);
    energy_change = std::max(energy_change, std::abs(elastic_energy(model, moved) / energy - 1));
    const VecX f = forces(model, state), g = forces(model, moved);
    Vec3 force = Vec3::Zero(), torque = Vec3::Zero();
    double difference = 0;
    for (int n = 0; n < model.node_count(); ++n) {
      difference += (g.segment<3>(3 * n) - Q * f.segment<3>(3 * n)).squaredNorm();
      force += f.segment<3>(3 * n);
      torque += state.x[n].cross(f.segment<3>(3 * n));
    }
    force_change = std::max(force_change, std::sqrt(difference) / f.norm());
    push = std::max(push, force.norm() / f.norm());
    twist = std::max(twist, torque.norm() / (f.norm() * size.x()));
    rigid = std::max(rigid, forces(model, carried).norm() / (soft.young * size.x() * size.x()));
  }
  const char* frame = "frame indifference";
  findings.check("rigid motion: force over E size²", 0, rigid, 1e-12, frame);
  findings.check("E(Qx + t) = E(x), strained", 0, energy_change, 1e-10, frame);
  findings.check("f(Qx + t) = Q f(x), strained", 0, force_change, 1e-10, frame);
  findings.check("free body: resultant force", 0, push, 1e-12, "Newton's third law");
  findings.check("free body: resultant torque", 0, twist, 1e-11, "Newton's third law");
}

void check_derivatives(Effort, TissueFindings& findings) {
  const TissueModel model = irregular_box(2);
  std::mt19937 random(2);
  const TissueState state = shaken(model, 3e-4, random);
  const VecX f = forces(model, state);
  double worst = 0;
  const double step = 1e-8;
  for (Eigen::Index k = 0; k < f.size(); ++k) {
    TissueState moved = state;
    moved.x[k / 3][k % 3] += step;
    update_rotations(model, moved);
    const double forward = elastic_energy(model, moved);
    moved.x[k / 3][k % 3] -= 2 * step;
    update_rotations(model, moved);
    worst = std::max(worst, std::abs((forward - elastic_energy(model, moved)) / (2 * step) + f[k]));
  }
  const char* differences = "central differences";
  findings.check("force against the energy's slope, large strain", 0, worst / f.norm(), 1e-6, differences);

  const TissueState rest = rest_state(model);
  const MatX K = stiffness_at_rest(model);
  findings.check("tangent against the force's slope, at rest", 0,
                 (K - slope_of_force(model, rest, step)).norm() / K.norm(), 1e-6, differences);

  // What the co-rotational tangent leaves out, the turn of R, grows with strain in proportion.
  TissueSeries left_out{"what the tangent leaves out, against strain", 1, {}, {}};
  const Mat3 strain = Mat3(Vec3(1, -0.5, -0.5).asDiagonal());
  const Mat3 Q = random_turn(random);
  for (const double amount : {0.2, 0.1, 0.05, 0.025}) {
    TissueState strained = rest;
    for (Vec3& x : strained.x) x = Q * (Mat3::Identity() + amount * strain) * x;
    update_rotations(model, strained);
    const MatX tangent = assemble_system_matrix(model, strained, 1e9);
    const MatX slope = slope_of_force(model, strained, step);
    left_out.size.push_back(amount);
    left_out.error.push_back((tangent - slope).norm() / slope.norm());
  }
  findings.converges(left_out, 0.1, differences);
}

}  // namespace hapticd
