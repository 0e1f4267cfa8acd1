// Solids: a manufactured field, NAFEMS LE10, Boussinesq.
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_analytic.h"
#include "tools/chart/tissue/tissue_check.h"
#include "tools/chart/tissue/tissue_hertz.h"
#include "tools/chart/tissue/tissue_static.h"

namespace hapticd {

namespace {

constexpr double pi = std::numbers::pi;

// u = φ c, φ = sin πx sin πy sin πz on the unit cube; f = −(μ ∇²u + (λ+μ) ∇∇·u).
struct Manufactured {
  Vec3 c{1e-3, -2e-3, 1.5e-3};
  Material material{1, 0.3, 1, 0, 0};

  Vec3 u(const Vec3& x) const {
    return std::sin(pi * x.x()) * std::sin(pi * x.y()) * std::sin(pi * x.z()) * c;
  }
  Mat3 gradient(const Vec3& x) const {
    const Vec3 s = (pi * x).array().sin(), k = (pi * x).array().cos();
    return pi * c * Vec3(k[0] * s[1] * s[2], s[0] * k[1] * s[2], s[0] * s[1] * k[2]).transpose();
  }
  Vec3 load(const Vec3& x) const {
    const Vec3 s = (pi * x).array().sin(), k = (pi * x).array().cos();
    const double phi = s[0] * s[1] * s[2];
    Mat3 hessian;
    hessian << -phi, k[0] * k[1] * s[2], k[0] * s[1] * k[2],  //
        k[0] * k[1] * s[2], -phi, s[0] * k[1] * k[2],         //
        k[0] * s[1] * k[2], s[0] * k[1] * k[2], -phi;
    const double mu = material.mu(), lambda = material.lambda();
    return pi * pi * (3 * mu * phi * c - (lambda + mu) * hessian * c);
  }
};

// Four points, exact for squares; weights are a quarter each.
constexpr double near_corner = 0.58541019662496845446, far_corner = 0.13819660112501051518;

template <class At>
void quadrature(const TissueModel& model, At at) {
  for (int t = 0; t < model.tet_count(); ++t) {
    const Tet& tet = model.mesh.tets[t];
    for (int q = 0; q < 4; ++q) {
      Eigen::Vector4d N = Eigen::Vector4d::Constant(far_corner);
      N[q] = near_corner;
      Vec3 x = Vec3::Zero();
      for (int a = 0; a < 4; ++a) x += N[a] * model.mesh.nodes[tet[a]];
      at(t, N, x, model.volume[t] / 4);
    }
  }
}

// NAFEMS LE10: quarter of an elliptic plate with an elliptic hole, x and y radii inside (2, 1), outside
// (3.25, 2.75).
struct Plate {
  TissueModel model;
  int ns, nt, nz;
  int node(int i, int j, int k) const { return i + (ns + 1) * (j + (nt + 1) * k); }
};

constexpr double thickness = 0.6;

Plate elliptic_plate(int k) {
  const int ns = 6 * k, nt = 8 * k, nz = 4 * k;
  TetMesh mesh = box_mesh({1, 1, 1}, ns, nt, nz);
  for (Vec3& p : mesh.nodes) {
    const double s = p.x(), angle = 0.5 * pi * p.y();
    p = {(2 + 1.25 * s) * std::cos(angle), (1 + 1.75 * s) * std::sin(angle), thickness * (p.z() - 0.5)};
  }
  return {make_tissue_model(std::move(mesh), {210e9, 0.3, 7800, 0, 0}, {}, Vec3::Zero()), ns, nt, nz};
}

// σ_yy at D, the inner edge on the x axis, top: what the free faces leave of it is E ε_yy + ν (σ_xx + σ_zz),
// with σ_xx = 0 and σ_zz = −p there; ε_yy from the displacement along the edge, odd in y.
double stress_at_d(const Plate& plate, const VecX& u, double pressure) {
  const auto uy = [&](int j) { return u[3 * plate.node(0, j, plate.nz) + 1]; };
  const auto y = [&](int j) { return plate.model.mesh.nodes[plate.node(0, j, plate.nz)].y(); };
  // u_y = a y + b y³ through the first two nodes.
  const double q1 = uy(1) / y(1), q2 = uy(2) / y(2), s1 = y(1) * y(1), s2 = y(2) * y(2);
  const double strain = (q1 * s2 - q2 * s1) / (s2 - s1);
  return plate.model.material.young * strain - plate.model.material.poisson * pressure;
}

double le10(int k) {
  constexpr double pressure = 1e6, tiny = 1e-9;
  const Plate plate = elliptic_plate(k);
  Held held;
  hold(
      plate.model, 1, [](const Vec3& x) { return x.y() < tiny; }, held);
  hold(
      plate.model, 0, [](const Vec3& x) { return x.x() < tiny; }, held);
  for (int kz = 0; kz <= plate.nz; ++kz)
    for (int j = 0; j <= plate.nt; ++j) {
      const int n = plate.node(plate.ns, j, kz);
      held[3 * n] = held[3 * n + 1] = 0;
      if (2 * kz == plate.nz) held[3 * n + 2] = 0;
    }
  const VecX load = surface_load(plate.model, Vec3(0, 0, -pressure),
                                 [](const Vec3& x) { return x.z() > 0.5 * thickness - tiny; });
  return stress_at_d(plate, solve_linear(plate.model, load, held), pressure);
}

}  // namespace

void check_manufactured(Effort effort, TissueFindings& findings) {
  const Manufactured exact;
  TissueSeries place{"manufactured field: displacement, L²", 2, {}, {}};
  TissueSeries slope{"manufactured field: gradient, L²", 1, {}, {}};
  for (const int n : effort == Effort::quick ? std::vector{6, 12} : std::vector{6, 12, 24}) {
    TetMesh mesh = box_mesh({1, 1, 1}, n, n, n);
    jitter_interior(mesh, {1, 1, 1}, 0.15 / n, 11);
    const TissueModel model = make_tissue_model(std::move(mesh), exact.material, {}, Vec3::Zero());
    VecX load = VecX::Zero(3 * model.node_count());
    quadrature(model, [&](int t, const Eigen::Vector4d& N, const Vec3& x, double weight) {
      for (int a = 0; a < 4; ++a) load.segment<3>(3 * model.mesh.tets[t][a]) += weight * N[a] * exact.load(x);
    });
    Held held;
    for (int axis = 0; axis < 3; ++axis)
      hold(
          model, axis,
          [](const Vec3& x) {
            return on_box_boundary(x, {1, 1, 1});
          },
          held);
    const VecX u = solve_linear(model, load, held);
    double off = 0, steep = 0, size = 0, whole = 0;
    quadrature(model, [&](int t, const Eigen::Vector4d& N, const Vec3& x, double weight) {
      Vec3 at = Vec3::Zero();
      Mat3 G = Mat3::Zero();
      for (int a = 0; a < 4; ++a) {
        const Vec3 ua = u.segment<3>(3 * model.mesh.tets[t][a]);
        at += N[a] * ua;
        G += ua * model.gradients[t].col(a).transpose();
      }
      off += weight * (at - exact.u(x)).squaredNorm();
      size += weight * exact.u(x).squaredNorm();
      steep += weight * (G - exact.gradient(x)).squaredNorm();
      whole += weight * exact.gradient(x).squaredNorm();
    });
    place.size.push_back(1.0 / n);
    place.error.push_back(std::sqrt(off / size));
    slope.size.push_back(1.0 / n);
    slope.error.push_back(std::sqrt(steep / whole));
  }
  const char* source = "Strang and Fix 1973: h² and h for linear elements";
  findings.converges(place, 0.1, source);
  findings.converges(slope, 0.1, source);
}

void check_le10(Effort effort, TissueFindings& findings) {
  constexpr double nafems = -5.38e6;
  TissueSeries series{"NAFEMS LE10: stress at D", 2, {}, {}};
  double stress[2] = {0, 0};
  const std::vector<int> levels = effort == Effort::quick ? std::vector{1, 2} : std::vector{1, 2, 3, 4};
  for (const int k : levels) {
    stress[0] = stress[1];
    stress[1] = le10(k);
    series.size.push_back(1.0 / k);
    series.error.push_back(std::abs(stress[1] / nafems - 1));
  }
  const double ratio = static_cast<double>(levels.back()) / levels[levels.size() - 2];
  findings.series.push_back(series);
  const char* source = "NAFEMS, The standard benchmarks, LE10: −5.38 MPa";
  findings.check("NAFEMS LE10: σ_yy at D, extrapolated (order 2) [Pa]", nafems,
                 extrapolated(stress[0], stress[1], ratio, 2), effort == Effort::quick ? 0.05 : 0.02, source);
  findings.check("NAFEMS LE10: σ_yy at D, finest mesh [Pa]", nafems, stress[1],
                 effort == Effort::quick ? 0.2 : 0.05, source);
}

void check_boussinesq(Effort effort, TissueFindings& findings) {
  constexpr double young = 3000, nu = 0.3, force = 1e-3, half = 1e-2, beta = 3;
  TissueSeries series{"Boussinesq: sinking of the surface", 2, {}, {}};
  for (const int n : effort == Effort::quick ? std::vector{8, 16} : std::vector{8, 16, 32}) {
    const TissueModel model =
        make_tissue_model(graded_block(n, half, beta), {young, nu, 1000, 0, 0}, {}, Vec3::Zero());
    Held held;
    VecX load = VecX::Zero(3 * model.node_count());
    const double edge = half * (1 - 1e-9);
    for (int k = 0; k < model.node_count(); ++k) {
      const Vec3& x = model.mesh.nodes[k];
      if (x.norm() < 1e-12) load[3 * k + 2] = -force;
      if (std::max({std::abs(x.x()), std::abs(x.y()), -x.z()}) < edge) continue;
      const Vec3 u = boussinesq(x, force, young, nu);
      for (int axis = 0; axis < 3; ++axis) held[3 * k + axis] = u[axis];
    }
    const VecX u = solve_linear(model, load, held);
    // Away from the singularity, and where the far field is not given.
    double off = 0, whole = 0;
    for (int k = 0; k < model.node_count(); ++k) {
      const Vec3& x = model.mesh.nodes[k];
      if (x.z() < -1e-9 || x.norm() < 0.15 * half || x.norm() > 0.7 * half) continue;
      const double exact = boussinesq(x, force, young, nu).z();
      off += std::pow(u[3 * k + 2] - exact, 2);
      whole += exact * exact;
    }
    series.size.push_back(1.0 / n);
    series.error.push_back(std::sqrt(off / whole));
  }
  const char* source = "Boussinesq 1885; the far faces are given his displacement";
  findings.converges(series, 0.25, source);
  findings.check("Boussinesq: sinking of the surface, rms error", 0, series.error.back(),
                 effort == Effort::quick ? 0.05 : 0.02, source);
}

}  // namespace hapticd
