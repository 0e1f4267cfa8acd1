#include "physics/contact/delassus.h"

#include <algorithm>

namespace hapticd {
namespace {

constexpr double rigid_compliance = 1e-3;  // of the coupling's, at contacts with less of their own

Mat3 cross_matrix(const Vec3& r) noexcept {
  Mat3 m;
  m << 0, -r.z(), r.y(), r.z(), 0, -r.x(), -r.y(), r.x(), 0;
  return m;
}

// Σ_a w_a C(:, a) of one sample: 3·nodes × 3.
class Panel {
 public:
  void fill(const CondensedProblem& problem, const PatchSample& s) noexcept {
    const auto C = problem.C();
    const int size = 3 * problem.nodes;
    for (int c = 0; c < 3; ++c) {
      const double* a0 = C.data() + static_cast<std::ptrdiff_t>(3 * s.node[0] + c) * size;
      const double* a1 = C.data() + static_cast<std::ptrdiff_t>(3 * s.node[1] + c) * size;
      const double* a2 = C.data() + static_cast<std::ptrdiff_t>(3 * s.node[2] + c) * size;
      double* out = column_[c].data();
      for (int k = 0; k < size; ++k) out[k] = s.weight[0] * a0[k] + s.weight[1] * a1[k] + s.weight[2] * a2[k];
    }
  }

  // G of another sample against this one: Σ_b w_b panel(b, :).
  Mat3 at(const PatchSample& s) const noexcept {
    Mat3 G;
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r)
        G(r, c) = s.weight[0] * column_[c][3 * s.node[0] + r] + s.weight[1] * column_[c][3 * s.node[1] + r] +
                  s.weight[2] * column_[c][3 * s.node[2] + r];
    return G;
  }

 private:
  std::array<std::array<double, 3 * max_patch_nodes>, 3> column_;
};

}  // namespace

void assemble_delassus(const CondensedProblem& problem, const Vec6& K_inv_diag, ContactRows& rows) noexcept {
  auto W = rows.W();
  Panel panel;
  for (int j = 0; j < rows.contacts; ++j) {
    const ContactRow& col = rows.row[j];
    const PatchSample& of_col = problem.sample[col.sample];
    const bool deforms = of_col.node[0] >= 0;
    if (deforms) panel.fill(problem, of_col);
    const Mat3 K_r_inv_r = K_inv_diag.tail<3>().asDiagonal() * cross_matrix(col.arm);
    for (int i = j; i < rows.contacts; ++i) {
      const ContactRow& row = rows.row[i];
      const PatchSample& of_row = problem.sample[row.sample];
      Mat3 G = Mat3::Zero();
      if (deforms && of_row.node[0] >= 0) G = panel.at(of_row);
      Mat3 B = -cross_matrix(row.arm) * K_r_inv_r;
      B.diagonal() += K_inv_diag.head<3>();
      if (i == j) {
        const double missing = (rigid_compliance * B.trace() - G.trace()) / 3;
        G.diagonal().array() += std::max(0.0, missing);
      }
      G += B;
      if (rows.rows_per_contact == 1) {
        W(i, j) = row.frame.col(0).dot(G * col.frame.col(0));
        W(j, i) = W(i, j);
        continue;
      }
      Mat3 block = row.frame.transpose() * (G * col.frame);
      if (i == j) block = (0.5 * (block + block.transpose())).eval();
      W.block<3, 3>(3 * i, 3 * j) = block;
      W.block<3, 3>(3 * j, 3 * i) = block.transpose();
    }
  }
}

}  // namespace hapticd
