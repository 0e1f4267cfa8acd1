// Statics and modes of one body with single degrees of freedom held, for checks: symmetry planes, rollers.
//
//   linear     K u = f,   K at rest, u_k given for every held k
//   at large   minimise E(x) − fᵀx by Newton with ∂²E/∂x², the turn of R included, and a line search
//   modes      K u = ω² M u, the lowest, by inverse iteration
//
// K is the product's own (system_matrix.h) at a step so long that mass counts for nothing; only the
// elimination of single degrees of freedom and CHOLMOD's call are made here. Units: m, N, rad/s. Shapes:
// 3·nodes. Errors: std::runtime_error where K is singular or Newton does not end.
#pragma once

#include <Eigen/SparseCore>
#include <functional>
#include <map>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

using Held = std::map<int, double>;  // degree of freedom 3·node + axis → displacement

// Holds one axis of every node that `where` is true of.
template <class Where>
void hold(const TissueModel& model, int axis, Where where, Held& held, double value = 0) {
  for (int n = 0; n < model.node_count(); ++n)
    if (where(model.mesh.nodes[n])) held[3 * n + axis] = value;
}

VecX solve_linear(const TissueModel& model, const VecX& load, const Held& held);
// The same with a stiffness matrix of one's own.
VecX solve_linear(const Eigen::SparseMatrix<double>& K, const VecX& load, const Held& held);
// Floating-point operations of factoring K, nothing held, in CHOLMOD's order.
double factor_operations(const Eigen::SparseMatrix<double>& K);
Eigen::SparseMatrix<double> stiffness_at_rest(const TissueModel& model);

struct LargeSolution {
  TissueState state;
  int iterations = 0;
  double residual = 0;  // relative to the load
};
LargeSolution solve_large(const TissueModel& model, const VecX& load, const Held& held, int load_steps);

double lowest_frequency(const TissueModel& model, const Held& held);

// The force on each node of a uniform traction [Pa] on the boundary's faces that `where` is true of (all
// corners).
VecX surface_load(const TissueModel& model, const Vec3& traction,
                  const std::function<bool(const Vec3&)>& where);

// The stress [Pa] of each tetrahedron under a small displacement.
std::vector<Mat3> small_stress(const TissueModel& model, const VecX& u);

}  // namespace hapticd
