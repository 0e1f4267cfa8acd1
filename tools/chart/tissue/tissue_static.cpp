#include "tools/chart/tissue/tissue_static.h"

#include <Eigen/CholmodSupport>
#include <Eigen/LU>
#include <cmath>
#include <stdexcept>

#include "physics/compliance/system_matrix.h"
#include "physics/tissue/surface.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {

namespace {

using Sparse = Eigen::SparseMatrix<double>;
constexpr double long_step = 1e9;  // [s]: M/h² counts for nothing

// ∂²E/∂x² of all live tetrahedra, the turn of R included: with S = RᵀF, dR = R w×, (tr(S) I − S) w =
// axl(RᵀdF),
//   dP = 2μ dF + λ (R:dF) R − (2μ − λ tr(S − I)) dR.
Sparse full_tangent(const TissueModel& model, const TissueState& state) {
  const double mu = model.material.mu(), lambda = model.material.lambda();
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(144 * model.mesh.tets.size());
  for (int t = 0; t < model.tet_count(); ++t) {
    const Tet& tet = model.mesh.tets[t];
    const Mat3& R = state.rotation[t];
    const Mat3 S = R.transpose() * deformation_gradient(corners_of(tet, state.x), model.gradients[t]);
    const Mat3 turning = (S.trace() * Mat3::Identity() - 0.5 * (S + S.transpose())).inverse();
    for (int a = 0; a < 4; ++a)
      for (int axis = 0; axis < 3; ++axis) {
        const Mat3 dF = Vec3::Unit(axis) * model.gradients[t].col(a).transpose();
        const Mat3 A = R.transpose() * dF;
        const Vec3 w = turning * Vec3(A(2, 1) - A(1, 2), A(0, 2) - A(2, 0), A(1, 0) - A(0, 1));
        Mat3 cross;
        cross << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
        const Mat3 dP =
            2 * mu * dF + lambda * A.trace() * R - (2 * mu - lambda * (S.trace() - 3)) * R * cross;
        const Eigen::Matrix<double, 3, 4> df = model.volume[t] * dP * model.gradients[t];
        for (int b = 0; b < 4; ++b)
          for (int r = 0; r < 3; ++r) entries.emplace_back(3 * tet[b] + r, 3 * tet[a] + axis, df(r, b));
      }
  }
  Sparse K(3 * model.node_count(), 3 * model.node_count());
  K.setFromTriplets(entries.begin(), entries.end());
  return K;
}

// K without the rows and columns that are held, factored.
class Reduced {
 public:
  Reduced(const Sparse& K, const Held& held) : K_(K) {
    index_.assign(K.rows(), 0);
    for (const auto& [k, value] : held) index_[k] = -1;
    for (int& i : index_)
      if (i == 0) i = size_++;
    std::vector<Eigen::Triplet<double>> entries;
    entries.reserve(K.nonZeros());
    for (int c = 0; c < K.outerSize(); ++c)
      for (Sparse::InnerIterator it(K, c); it; ++it)
        if (index_[it.row()] >= 0 && index_[c] >= 0)
          entries.emplace_back(index_[it.row()], index_[c], it.value());
    Sparse free(size_, size_);
    free.setFromTriplets(entries.begin(), entries.end());
    factor_.compute(free);
    definite_ = factor_.info() == Eigen::Success;
  }
  bool definite() const { return definite_; }

  VecX solve(const VecX& load, const Held& held) const {
    if (!definite_) throw std::runtime_error("the stiffness is singular");
    VecX u = VecX::Zero(K_.rows());
    for (const auto& [k, value] : held) u[k] = value;
    const VecX right = load - K_ * u;
    VecX b(size_);
    for (Eigen::Index k = 0; k < u.size(); ++k)
      if (index_[k] >= 0) b[index_[k]] = right[k];
    const VecX solved = factor_.solve(b);
    for (Eigen::Index k = 0; k < u.size(); ++k)
      if (index_[k] >= 0) u[k] = solved[index_[k]];
    return u;
  }

 private:
  const Sparse& K_;
  std::vector<int> index_;
  int size_ = 0;
  bool definite_ = false;
  Eigen::CholmodSupernodalLLT<Sparse> factor_;
};

}  // namespace

Sparse stiffness_at_rest(const TissueModel& model) {
  return assemble_system_matrix(model, rest_state(model), long_step);
}

double factor_operations(const Sparse& K) {
  Eigen::CholmodSupernodalLLT<Sparse> factor;
  factor.analyzePattern(K);
  return factor.cholmod().fl;
}

VecX solve_linear(const Sparse& K, const VecX& load, const Held& held) {
  return Reduced(K, held).solve(load, held);
}

VecX solve_linear(const TissueModel& model, const VecX& load, const Held& held) {
  const Sparse K = stiffness_at_rest(model);
  return solve_linear(K, load, held);
}

// The whole tangent where it is positive definite, else the co-rotational one, which is everywhere.
static VecX newton_direction(const TissueModel& model, const TissueState& state, const VecX& residual,
                             const Held& still) {
  const Sparse K = full_tangent(model, state);
  const Reduced whole(K, still);
  if (whole.definite()) return whole.solve(residual, still);
  return solve_linear(assemble_system_matrix(model, state, long_step), residual, still);
}

LargeSolution solve_large(const TissueModel& model, const VecX& load, const Held& held, int load_steps) {
  constexpr int most_iterations = 200;
  constexpr double small = 1e-8;
  LargeSolution s;
  s.state = rest_state(model);
  Held still = held;
  for (auto& [k, value] : still) value = 0;
  for (int step = 1; step <= load_steps; ++step) {
    const VecX f = load * (static_cast<double>(step) / load_steps);
    const auto potential = [&](const TissueState& at) {
      double work = 0;
      for (int n = 0; n < model.node_count(); ++n) work += f.segment<3>(3 * n).dot(at.x[n]);
      return elastic_energy(model, at) - work;
    };
    double energy = potential(s.state);
    for (int i = 0;; ++i) {
      VecX residual(f.size());
      internal_forces(model, s.state, residual);
      residual += f;
      for (const auto& [k, value] : still) residual[k] = 0;
      s.residual = residual.norm() / f.norm();
      if (s.residual < (step == load_steps ? small : 1e-3)) break;
      if (i == most_iterations) throw std::runtime_error("Newton does not end");
      const VecX u = newton_direction(model, s.state, residual, still);
      for (double length = 1; length > 1e-4; length /= 2) {
        TissueState next = s.state;
        for (int n = 0; n < model.node_count(); ++n) next.x[n] += length * u.segment<3>(3 * n);
        update_rotations(model, next);
        const double after = potential(next);
        if (after > energy + 1e-10 * std::abs(energy)) continue;
        energy = after;
        s.state = std::move(next);
        break;
      }
      ++s.iterations;
    }
  }
  return s;
}

double lowest_frequency(const TissueModel& model, const Held& held) {
  const Sparse K = stiffness_at_rest(model);
  const Reduced factor(K, held);
  const TissueState state = rest_state(model);
  VecX mass(3 * model.node_count());
  for (int n = 0; n < model.node_count(); ++n) mass.segment<3>(3 * n).setConstant(state.mass[n]);
  VecX u = VecX::Random(mass.size());
  double omega = 0;
  for (int i = 0; i < 200; ++i) {
    u = factor.solve(mass.cwiseProduct(u), held);
    u /= std::sqrt(u.dot(mass.cwiseProduct(u)));
    const double next = std::sqrt(u.dot(K * u));
    if (std::abs(next - omega) < 1e-9 * next) return next;
    omega = next;
  }
  throw std::runtime_error("inverse iteration does not end");
}

VecX surface_load(const TissueModel& model, const Vec3& traction,
                  const std::function<bool(const Vec3&)>& where) {
  VecX f = VecX::Zero(3 * model.node_count());
  const auto& x = model.mesh.nodes;
  const BoundarySurface surface(model.mesh);
  for (const SurfaceFace& face : surface.faces()) {
    const auto [a, b, c] = face.nodes;
    if (!where(x[a]) || !where(x[b]) || !where(x[c])) continue;
    const double area = 0.5 * (x[b] - x[a]).cross(x[c] - x[a]).norm();
    for (const int n : face.nodes) f.segment<3>(3 * n) += area / 3 * traction;
  }
  return f;
}

std::vector<Mat3> small_stress(const TissueModel& model, const VecX& u) {
  std::vector<Mat3> stress;
  for (int t = 0; t < model.tet_count(); ++t) {
    Mat3 G = Mat3::Zero();
    for (int a = 0; a < 4; ++a)
      G += u.segment<3>(3 * model.mesh.tets[t][a]) * model.gradients[t].col(a).transpose();
    const Mat3 strain = 0.5 * (G + G.transpose());
    stress.push_back(2 * model.material.mu() * strain +
                     model.material.lambda() * strain.trace() * Mat3::Identity());
  }
  return stress;
}

}  // namespace hapticd
