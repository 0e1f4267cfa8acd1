// Nearly incompressible tissue: how linear tetrahedra lock, and what the remedies bring and cost.
//
//   none      as they are
//   lowered   ν to 0.45, E raised so that the indentation modulus E/(1 − ν²) stays (material.h): free
//   patches   one dilation for each patch of tetrahedra, V_P λ b_P b_Pᵀ with b_P = Σ V_e b_e / V_P: more
//   coupled
//             nodes, hence a larger factor
//
// A patch is a node's whole star where none of it is taken; what is left over joins a neighbour. Stiffness is
// the load over the displacement it makes, relative to the exact solution's. Source of the patches: de Souza
// Neto, Pires and Owen 2005 (F-bar patch), at small strain.
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "physics/compliance/system_matrix.h"
#include "physics/tissue/surface.h"
#include "physics/tissue/tetrahedron.h"
#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_analytic.h"
#include "tools/chart/tissue/tissue_check.h"
#include "tools/chart/tissue/tissue_static.h"

namespace hapticd {

namespace {

constexpr double young = 3000, tiny = 1e-9;

struct Problem {
  TissueModel model;
  VecX load;
  Held held;
  double size;                                      // of elements
  std::function<double(const VecX&)> displacement;  // whose exact value is `exact`
  double exact;
};

// Uniform pressure on a square of side 2a on a half-space: the middle sinks 8/π ln(1 + √2) p a (1 − ν²)/E.
// Timoshenko and Goodier 1951, §139. The far faces are given Boussinesq's displacement.
Problem indentation(int n, const Material& real, const Material& used) {
  constexpr double half = 1e-2, beta = 3, pressure = 10;
  const double a = half * std::sinh(0.25 * beta) / std::sinh(beta);
  TetMesh mesh = box_mesh({2, 2, 1}, n, n, n / 2);
  for (Vec3& p : mesh.nodes) {
    p -= Vec3(1, 1, 1);
    p = half / std::sinh(beta) * (beta * p.array()).sinh().matrix();
  }
  Problem s{make_tissue_model(std::move(mesh), used, {}, Vec3::Zero()), {}, {}, 8.0 / n, {}, 0};
  s.load = surface_load(s.model, Vec3(0, 0, -pressure), [&](const Vec3& x) {
    return x.z() > -tiny && std::max(std::abs(x.x()), std::abs(x.y())) < a * (1 + 1e-9);
  });
  int middle = 0;
  for (int k = 0; k < s.model.node_count(); ++k) {
    const Vec3& x = s.model.mesh.nodes[k];
    if (x.norm() < tiny) middle = k;
    if (std::max({std::abs(x.x()), std::abs(x.y()), -x.z()}) < half * (1 - 1e-9)) continue;
    const Vec3 u = boussinesq(x, 4 * a * a * pressure, real.young, real.poisson);
    for (int axis = 0; axis < 3; ++axis) s.held[3 * k + axis] = u[axis];
  }
  s.displacement = [middle](const VecX& u) { return -u[3 * middle + 2]; };
  s.exact = 8 / std::numbers::pi * std::log(1 + std::sqrt(2.0)) * pressure * a *
            (1 - real.poisson * real.poisson) / real.young;
  return s;
}

// A quarter of a tube in plane strain, inner radius 1 cm, outer 2 cm, under pressure from inside.
Problem cylinder(int n, const Material& real, const Material& used) {
  constexpr double inner = 1e-2, outer = 2e-2, pressure = 100;
  const int around = 2 * n;
  TetMesh mesh = box_mesh({1, 1, (outer - inner) / n}, n, around, 1);
  for (Vec3& p : mesh.nodes) {
    const double r = inner + (outer - inner) * p.x(), angle = 0.5 * std::numbers::pi * p.y();
    p = {r * std::cos(angle), r * std::sin(angle), p.z()};
  }
  Problem s{make_tissue_model(std::move(mesh), used, {}, Vec3::Zero()), {}, {}, 1.0 / n, {}, 0};
  const auto& x = s.model.mesh.nodes;
  const auto inside = [&](int k) { return x[k].head<2>().norm() < inner * (1 + 1e-6); };
  s.load = VecX::Zero(3 * s.model.node_count());
  const BoundarySurface surface(s.model.mesh);
  for (const SurfaceFace& f : surface.faces()) {
    const auto [a, b, c] = f.nodes;
    if (!inside(a) || !inside(b) || !inside(c)) continue;
    const Vec3 area = 0.5 * (x[b] - x[a]).cross(x[c] - x[a]);
    for (const int k : f.nodes) s.load.segment<3>(3 * k) -= pressure / 3 * area;
  }
  hold(
      s.model, 0, [](const Vec3& p) { return p.x() < tiny; }, s.held);
  hold(
      s.model, 1, [](const Vec3& p) { return p.y() < tiny; }, s.held);
  hold(
      s.model, 2, [](const Vec3&) { return true; }, s.held);
  std::vector<int> wall;
  for (int k = 0; k < s.model.node_count(); ++k)
    if (inside(k)) wall.push_back(k);
  s.displacement = [wall, nodes = x](const VecX& u) {
    double sum = 0;
    for (const int k : wall) sum += u.segment<2>(3 * k).dot(nodes[k].head<2>().normalized());
    return sum / static_cast<double>(wall.size());
  };
  s.exact = lame_inner(pressure, inner, outer, real.young, real.poisson);
  return s;
}

// The patch of each tetrahedron.
std::vector<int> star_patches(const TetMesh& mesh, int& patches) {
  std::vector<std::vector<int>> star(mesh.nodes.size());
  for (int t = 0; t < static_cast<int>(mesh.tets.size()); ++t)
    for (const int n : mesh.tets[t]) star[n].push_back(t);
  std::vector<int> patch(mesh.tets.size(), -1);
  patches = 0;
  for (const std::vector<int>& own : star) {
    if (own.empty() || std::any_of(own.begin(), own.end(), [&](int t) { return patch[t] >= 0; })) continue;
    for (const int t : own) patch[t] = patches;
    ++patches;
  }
  std::map<Triangle, std::vector<int>> sides;
  for (int t = 0; t < static_cast<int>(mesh.tets.size()); ++t)
    for (int f = 0; f < 4; ++f) {
      Triangle key = outward_face(mesh.tets[t], f);
      std::sort(key.begin(), key.end());
      sides[key].push_back(t);
    }
  std::vector<int> members(patches, 0);
  for (const int p : patch)
    if (p >= 0) ++members[p];
  for (bool changed = true; changed;) {
    changed = false;
    for (int t = 0; t < static_cast<int>(mesh.tets.size()); ++t) {
      if (patch[t] >= 0) continue;
      int best = -1;
      for (int f = 0; f < 4; ++f) {
        Triangle key = outward_face(mesh.tets[t], f);
        std::sort(key.begin(), key.end());
        for (const int other : sides[key])
          if (patch[other] >= 0 && (best < 0 || members[patch[other]] < members[best])) best = patch[other];
      }
      if (best < 0) continue;
      patch[t] = best;
      ++members[best];
      changed = true;
    }
  }
  return patch;
}

// K with the dilation of each patch instead of each tetrahedron's own.
Eigen::SparseMatrix<double> patched_stiffness(const TissueModel& model) {
  int patches = 0;
  const std::vector<int> patch = star_patches(model.mesh, patches);
  std::vector<std::map<int, Vec3>> dilation(patches);
  std::vector<double> volume(patches, 0);
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&](int i, int j, const Mat3& block) {
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) entries.emplace_back(3 * i + r, 3 * j + c, block(r, c));
  };
  for (int t = 0; t < model.tet_count(); ++t) {
    const Tet& tet = model.mesh.tets[t];
    const Gradients& g = model.gradients[t];
    for (int a = 0; a < 4; ++a) {
      auto [at, fresh] = dilation[patch[t]].try_emplace(tet[a], Vec3::Zero());
      at->second += model.volume[t] * g.col(a);
      for (int b = 0; b < 4; ++b)
        add(tet[a], tet[b], stiffness_block(g.col(a), g.col(b), model.volume[t], model.material.mu(), 0));
    }
    volume[patch[t]] += model.volume[t];
  }
  for (int p = 0; p < patches; ++p)
    for (const auto& [i, bi] : dilation[p])
      for (const auto& [j, bj] : dilation[p])
        add(i, j, model.material.lambda() / volume[p] * bi * bj.transpose());
  Eigen::SparseMatrix<double> K(3 * model.node_count(), 3 * model.node_count());
  K.setFromTriplets(entries.begin(), entries.end());
  return K;
}

using Maker = Problem (*)(int, const Material&, const Material&);

void measure(const char* name, Maker make, int n, double nu, TissueFindings& findings) {
  const Material real{young, nu, 1000, 0, 0};
  const auto point = [&](const char* remedy, const Problem& s, const Eigen::SparseMatrix<double>& K) {
    const double stiffness = s.exact / s.displacement(solve_linear(K, s.load, s.held));
    findings.locking.push_back({name, remedy, nu, s.size, stiffness, factor_operations(K)});
  };
  const Problem plain = make(n, real, real);
  point("none", plain, stiffness_at_rest(plain.model));
  point("patches", plain, patched_stiffness(plain.model));
  const Problem softer = make(n, real, lowered(real, 0.45));
  point("lowered", softer, stiffness_at_rest(softer.model));
}

}  // namespace

double indentation_stiffness(double poisson, double cap, int n) {
  const Material real{young, poisson, 1000, 0, 0};
  const Problem s = indentation(n, real, lowered(real, cap));
  return s.exact / s.displacement(solve_linear(stiffness_at_rest(s.model), s.load, s.held));
}

void check_locking(Effort effort, TissueFindings& findings) {
  const std::vector<int> indented = effort == Effort::quick ? std::vector{8, 16} : std::vector{8, 16, 24};
  const std::vector<int> tubes = effort == Effort::quick ? std::vector{2, 4} : std::vector{2, 4, 8, 16};
  const std::vector<double> ratios =
      effort == Effort::quick ? std::vector{0.45, 0.499} : std::vector{0.3, 0.45, 0.49, 0.499};
  for (const double nu : ratios) {
    for (const int n : indented) measure("indentation", indentation, n, nu, findings);
    for (const int n : tubes) measure("cylinder", cylinder, n, nu, findings);
  }
  // The last ratio, the finest mesh: the claims.
  for (const char* problem : {"indentation", "cylinder"})
    for (const auto& [remedy, tolerance] : {std::pair{"lowered", 0.2}, std::pair{"patches", 0.05}}) {
      double stiffness = 0;
      for (const LockingPoint& p : findings.locking)
        if (p.problem == problem && p.remedy == remedy) stiffness = p.stiffness;
      findings.check(
          std::string(problem) + ", ν = 0.499, " + remedy + ": stiffness over the exact, finest mesh", 1,
          stiffness, tolerance,
          std::string(problem) == "cylinder" ? "Lamé 1852" : "Timoshenko and Goodier 1951, §139");
    }
}

}  // namespace hapticd
