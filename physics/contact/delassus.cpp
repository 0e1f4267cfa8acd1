#include "physics/contact/delassus.h"

#include <algorithm>

namespace hapticd {
namespace {

constexpr double rigid_compliance = 1e-3;  // of the coupling's, at contacts with less of their own

// Column panel of one contact: how nodes and instrument move per unit of its force in each frame direction.
class Panel {
 public:
  void fill(const CondensedProblem& problem, const Vec6& K_inv_diag, const ContactRow& row,
            int columns) noexcept {
    const PatchSample& s = problem.sample[row.sample];
    deforms_ = s.node[0] >= 0;
    for (int c = 0; c < columns; ++c) {
      const Vec3 f = row.frame.col(c);
      shift_[c] = K_inv_diag.head<3>().cwiseProduct(f);
      turn_[c] = K_inv_diag.tail<3>().cwiseProduct(row.arm.cross(f));
      if (deforms_) fill_column(problem, s, f, node_[c].data());
    }
  }

  // Displacement of another contact's point against the instrument, per unit of this one's force: G f + B f.
  Vec3 tissue(const PatchSample& s, int c) const noexcept {
    if (!deforms_ || s.node[0] < 0) return Vec3::Zero();
    const double* p = node_[c].data();
    const double *p0 = p + 3 * s.node[0], *p1 = p + 3 * s.node[1], *p2 = p + 3 * s.node[2];
    const double w0 = s.weight[0], w1 = s.weight[1], w2 = s.weight[2];
    return {w0 * p0[0] + w1 * p1[0] + w2 * p2[0], w0 * p0[1] + w1 * p1[1] + w2 * p2[1],
            w0 * p0[2] + w1 * p1[2] + w2 * p2[2]};
  }
  Vec3 coupling(const Vec3& arm, int c) const noexcept { return shift_[c] + turn_[c].cross(arm); }

 private:
  static void fill_column(const CondensedProblem& problem, const PatchSample& s, const Vec3& f,
                          double* out) noexcept {
    const int size = 3 * problem.nodes;
    for (int a = 0; a < 3; ++a) {
      const double* C = problem.C_pp.data() + static_cast<std::ptrdiff_t>(3 * s.node[a]) * size;
      const double x = s.weight[a] * f[0], y = s.weight[a] * f[1], z = s.weight[a] * f[2];
      if (a == 0) {
        for (int k = 0; k < size; ++k) out[k] = x * C[k] + y * C[size + k] + z * C[2 * size + k];
      } else {
        for (int k = 0; k < size; ++k) out[k] += x * C[k] + y * C[size + k] + z * C[2 * size + k];
      }
    }
  }

  bool deforms_ = false;
  std::array<std::array<double, 3 * max_patch_nodes>, 3> node_;
  std::array<Vec3, 3> shift_, turn_;
};

// Compliance that a contact lacks to a thousandth of the coupling's there; traces of the three directions.
double missing_compliance(const CondensedProblem& problem, const Vec6& K_inv_diag, const ContactRow& row,
                          const Panel& panel, int columns) noexcept {
  const Vec3 turn = K_inv_diag.tail<3>();
  double B = K_inv_diag.head<3>().sum(), G = 0;
  for (int c = 0; c < 3; ++c) B += turn[c] * (row.arm.squaredNorm() - row.arm[c] * row.arm[c]);
  const PatchSample& s = problem.sample[row.sample];
  for (int c = 0; c < columns; ++c) G += row.frame.col(c).dot(panel.tissue(s, c));
  return std::max(0.0, rigid_compliance * B / 3 - G / columns);
}

}  // namespace

void assemble_delassus(const CondensedProblem& problem, const Vec6& K_inv_diag, ContactRows& rows) noexcept {
  auto W = rows.W();
  const int m = rows.rows_per_contact;
  Panel panel;
  for (int j = 0; j < rows.contacts; ++j) {
    panel.fill(problem, K_inv_diag, rows.row[j], m);
    for (int i = j; i < rows.contacts; ++i) {
      const ContactRow& row = rows.row[i];
      const PatchSample& sample = problem.sample[row.sample];
      for (int c = 0; c < m; ++c) {
        const Vec3 u = panel.tissue(sample, c) + panel.coupling(row.arm, c);
        for (int r = i == j ? c : 0; r < m; ++r) {
          const double w = row.frame.col(r).dot(u);
          W(m * i + r, m * j + c) = w;
          W(m * j + c, m * i + r) = w;
        }
      }
    }
    const double missing = missing_compliance(problem, K_inv_diag, rows.row[j], panel, m);
    for (int c = 0; c < m; ++c) W(m * j + c, m * j + c) += missing;
  }
}

}  // namespace hapticd
