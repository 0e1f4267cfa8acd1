// The arithmetic of tetrahedron.h on eight live tetrahedra side by side: entry by entry, so that the compiler
// may use vector registers.
//
//   F = Σ_a x_a g_aᵀ,   f_a = P g_a
//
// Shapes: m[entry][lane], entries of column-major 3×3 and 3×4 matrices. Units: tetrahedron.h's. Guarantee:
// wait-free, no allocation. Results agree with tetrahedron.h's to round-off.
#pragma once

#include <algorithm>

#include "physics/tissue/tissue.h"

namespace hapticd {

inline constexpr int element_lanes = 8;

template <int entries>
struct Lanes {
  double m[entries][element_lanes];

  void set(int lane, const double* from) noexcept {
    for (int i = 0; i < entries; ++i) m[i][lane] = from[i];
  }
  Eigen::Matrix<double, 3, entries / 3> matrix(int lane) const noexcept {
    Eigen::Matrix<double, 3, entries / 3> of;
    for (int i = 0; i < entries; ++i) of.data()[i] = m[i][lane];
    return of;
  }
};
using Lanes3x3 = Lanes<9>;
using Lanes3x4 = Lanes<12>;

// Calls visit(tets, count) with live tetrahedra, eight at a time; lanes beyond the count repeat the first.
template <class Visit>
void each_eight(const TissueModel& model, const TissueState& state, const Visit& visit) {
  int tet[element_lanes] = {};
  int count = 0;
  model.each_tet([&](int t) {
    if (!state.alive[t]) return;
    tet[count++] = t;
    if (count < element_lanes) return;
    visit(tet, count);
    count = 0;
  });
  if (count == 0) return;
  std::fill(tet + count, tet + element_lanes, tet[0]);
  visit(tet, count);
}

// The vectors of their corners: `at(node)` points to three numbers.
template <class At>
void load_corners(const TissueModel& model, const int* tet, const At& at, Lanes3x4& x) noexcept {
  for (int l = 0; l < element_lanes; ++l)
    for (int a = 0; a < 4; ++a) {
      const double* from = at(model.mesh.tets[tet[l]][a]);
      for (int i = 0; i < 3; ++i) x.m[3 * a + i][l] = from[i];
    }
}

inline void load_gradients(const TissueModel& model, const int* tet, Lanes3x4& g) noexcept {
  for (int l = 0; l < element_lanes; ++l) g.set(l, model.gradients[tet[l]].data());
}

inline void deformation_gradients(const Lanes3x4& x, const Lanes3x4& g, Lanes3x3& F) noexcept {
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i)
      for (int l = 0; l < element_lanes; ++l) {
        double sum = 0;
        for (int a = 0; a < 4; ++a) sum += x.m[3 * a + i][l] * g.m[3 * a + j][l];
        F.m[3 * j + i][l] = sum;
      }
}

// Adds P g to the corners' entries of f.
inline void add_forces(const TissueModel& model, const int* tet, int count, const Lanes3x3& P,
                       const Lanes3x4& g, double* f) noexcept {
  Lanes3x4 force;
  for (int a = 0; a < 4; ++a)
    for (int i = 0; i < 3; ++i)
      for (int l = 0; l < element_lanes; ++l)
        force.m[3 * a + i][l] =
            P.m[i][l] * g.m[3 * a][l] + P.m[3 + i][l] * g.m[3 * a + 1][l] + P.m[6 + i][l] * g.m[3 * a + 2][l];
  for (int l = 0; l < count; ++l)
    for (int a = 0; a < 4; ++a) {
      double* to = f + 3 * static_cast<std::ptrdiff_t>(model.mesh.tets[tet[l]][a]);
      for (int i = 0; i < 3; ++i) to[i] += force.m[3 * a + i][l];
    }
}

}  // namespace hapticd
