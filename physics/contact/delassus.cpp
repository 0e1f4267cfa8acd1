#include "physics/contact/delassus.h"

#include <algorithm>
#include <cstdint>
#include <type_traits>

namespace hapticd {
namespace {

constexpr double rigid_compliance = 1e-3;  // of the coupling's, at contacts with less of their own

// Of a vector in space the fourth lane is not meant.
// A typedef: of an alias clang drops `aligned`, and faults.
typedef double Lanes __attribute__((vector_size(32), aligned(8), may_alias));

Lanes lanes(const Vec3& v) noexcept { return Lanes{v[0], v[1], v[2], 0}; }
// Not by reference: clang believes what one refers to to be aligned to 32. Nor by memcpy: with GCC the
// assembly of W takes three times as long.
Lanes load(const double* p) noexcept { return *reinterpret_cast<const Lanes*>(p); }
void store(double* p, Lanes v) noexcept { *reinterpret_cast<Lanes*>(p) = v; }

// Nodes that rows stand on, ascending.
struct NodesInUse {
  int count = 0;
  std::array<std::int32_t, max_patch_nodes> node;

  NodesInUse(const CondensedProblem& problem, const ContactRows& rows) noexcept {
    std::array<bool, max_patch_nodes> used{};
    for (int i = 0; i < rows.contacts; ++i)
      for (const std::int32_t n : node_weights(problem, rows.row[i]).node) used[n] = true;
    for (int n = 0; n < problem.nodes; ++n)
      if (used[n]) node[count++] = n;
  }
};

// Column panel of one contact: how the nodes in use and its instrument move per unit of its force in each
// frame direction.
template <int columns>
class Panel {
 public:
  void fill(const CondensedProblem& problem, const NodesInUse& used, const Vec6& K_inv_diag,
            const ContactRow& row) noexcept {
    deforms_ = !node_weights(problem, row).node.empty();
    for (int c = 0; c < columns; ++c) {
      const Vec3 f = row.frame.col(c);
      shift_[c] = lanes(K_inv_diag.head<3>().cwiseProduct(f));
      turn_[c] = K_inv_diag.tail<3>().cwiseProduct(row.arm.cross(f));
    }
    if (!deforms_) return;
    if (row.edge < 0)
      fill_nodes(problem, used, problem.sample[row.sample], row.frame);
    else
      fill_nodes(problem, used, problem.edge[row.edge], row.frame);
  }

  // Displacement of another contact's point per unit of this one's force in direction c: G f.
  Lanes tissue(const PatchSample& s, int c) const noexcept {
    if (!deforms_ || s.node[0] < 0) return Lanes{};
    const double* p = node_[c].data();
    return s.weight[0] * load(p + 3 * s.node[0]) + s.weight[1] * load(p + 3 * s.node[1]) +
           s.weight[2] * load(p + 3 * s.node[2]);
  }
  Lanes tissue(const EdgeSample& s, int c) const noexcept {
    Lanes u{};
    for (int a = 0; deforms_ && a < 4; ++a) u += s.weight[a] * load(node_[c].data() + 3 * s.node[a]);
    return u;
  }
  // B f is shift + turn × arm there.
  Lanes shift(int c) const noexcept { return shift_[c]; }
  const Vec3& turn(int c) const noexcept { return turn_[c]; }

 private:
  template <typename Sample>
  void fill_nodes(const CondensedProblem& problem, const NodesInUse& used, const Sample& s,
                  const Mat3& frame) noexcept {
    constexpr int corners = std::is_same_v<Sample, EdgeSample> ? 4 : 3;
    const int size = 3 * problem.nodes;
    const double* C[corners];
    double weight[corners];
    for (int a = 0; a < corners; ++a) {
      C[a] = problem.C_pp.data() + static_cast<std::ptrdiff_t>(3 * s.node[a]) * size;
      weight[a] = s.weight[a];
    }
    const auto fill_node = [&](int n, const auto& at) noexcept {
      Lanes moved[3]{};  // per unit of force along each axis of space
      for (int k = 0; k < 3; ++k)
        for (int a = 0; a < corners; ++a) moved[k] += weight[a] * at(C[a] + k * size + 3 * n);
      for (int c = 0; c < columns; ++c)
        store(node_[c].data() + 3 * n,
              frame(0, c) * moved[0] + frame(1, c) * moved[1] + frame(2, c) * moved[2]);
    };
    for (int k = 0; k + 1 < used.count; ++k) fill_node(used.node[k], load);
    // What is behind the last node may not be C's.
    if (used.count > 0)
      fill_node(used.node[used.count - 1], [](const double* p) noexcept {
        return Lanes{p[0], p[1], p[2], 0};
      });
  }

  bool deforms_ = false;
  // One more for the last node's fourth lane.
  std::array<std::array<double, 3 * max_patch_nodes + 1>, columns> node_{};
  Lanes shift_[columns];
  std::array<Vec3, columns> turn_;
};

// One contact as the others meet it. n·(turn × arm) = turn·(arm × n).
template <int m>
struct Probe;

template <>
struct Probe<1> {
  Lanes normal, moment;
  Probe() = default;
  explicit Probe(const ContactRow& row) noexcept
      : normal(lanes(row.frame.col(0))), moment(lanes(row.arm.cross(row.frame.col(0)))) {}
  template <typename Sample>
  double operator()(const Panel<1>& panel, const Sample& s, int) const noexcept {
    const Lanes w = normal * (panel.tissue(s, 0) + panel.shift(0)) + moment * lanes(panel.turn(0));
    return w[0] + w[1] + w[2];
  }
  template <typename Sample>
  double tissue(const Panel<1>& panel, const Sample& s, int) const noexcept {
    const Lanes w = normal * panel.tissue(s, 0);
    return w[0] + w[1] + w[2];
  }
};

// Lanes are the contact's three rows: no sum across them.
template <>
struct Probe<3> {
  Lanes direction[3], moment[3];  // by axis of space
  Probe() = default;
  explicit Probe(const ContactRow& row) noexcept {
    for (int k = 0; k < 3; ++k) direction[k] = lanes(row.frame.row(k));
    for (int c = 0; c < 3; ++c) {
      const Vec3 t = row.arm.cross(row.frame.col(c));
      for (int k = 0; k < 3; ++k) moment[k][c] = t[k];
    }
    for (int k = 0; k < 3; ++k) moment[k][3] = 0;
  }
  template <typename Sample>
  Lanes operator()(const Panel<3>& panel, const Sample& s, int c) const noexcept {
    const Lanes u = panel.tissue(s, c) + panel.shift(c);
    const Vec3& turn = panel.turn(c);
    return u[0] * direction[0] + u[1] * direction[1] + u[2] * direction[2] + turn[0] * moment[0] +
           turn[1] * moment[1] + turn[2] * moment[2];
  }
  template <typename Sample>
  Lanes tissue(const Panel<3>& panel, const Sample& s, int c) const noexcept {
    const Lanes u = panel.tissue(s, c);
    return u[0] * direction[0] + u[1] * direction[1] + u[2] * direction[2];
  }
};

void set_column(Eigen::Matrix<double, 1, 1>& block, int, double w) noexcept { block(0, 0) = w; }
void set_column(Mat3& block, int c, Lanes w) noexcept {
  for (int r = 0; r < 3; ++r) block(r, c) = w[r];
}

// What the couplings of two rows' instruments have in common: B, in the rows' frames.
Mat3 coupling(const EachInstrument<Vec6>& K_inv_diag, const ContactRow& i, const ContactRow& j) noexcept {
  const auto cross = [](const Vec3& r) {
    Mat3 m;
    m << 0, -r.z(), r.y(), r.z(), 0, -r.x(), -r.y(), r.x(), 0;
    return m;
  };
  Mat3 B = Mat3::Zero();
  const auto add = [&](int of_i, const Vec3& r_i, int of_j, const Vec3& r_j, double sign) {
    if (of_i < 0 || of_i != of_j) return;
    const Vec6& K = K_inv_diag[of_i];
    B += sign * (Mat3(K.head<3>().asDiagonal()) - cross(r_i) * K.tail<3>().asDiagonal() * cross(r_j));
  };
  add(i.instrument, i.arm, j.instrument, j.arm, 1);
  add(i.instrument, i.arm, j.other, j.other_arm, -1);
  add(i.other, i.other_arm, j.instrument, j.arm, -1);
  add(i.other, i.other_arm, j.other, j.other_arm, 1);
  return i.frame.transpose() * B * j.frame;
}

// Compliance that a contact lacks to a thousandth of the coupling's there; traces of the three directions.
template <int columns>
double missing_compliance(const CondensedProblem& problem, const Vec6& K_inv_diag, const ContactRow& row,
                          const Panel<columns>& panel) noexcept {
  const Vec3 turn = K_inv_diag.tail<3>();
  double B = K_inv_diag.head<3>().sum(), G = 0;
  for (int c = 0; c < 3; ++c) B += turn[c] * (row.arm.squaredNorm() - row.arm[c] * row.arm[c]);
  for (int c = 0; c < columns; ++c) {
    const Lanes u =
        row.edge < 0 ? panel.tissue(problem.sample[row.sample], c) : panel.tissue(problem.edge[row.edge], c);
    G += row.frame.col(c).dot(Vec3(u[0], u[1], u[2]));
  }
  return std::max(0.0, rigid_compliance * B / 3 - G / columns);
}

template <int m>
void assemble(const CondensedProblem& problem, const EachInstrument<Vec6>& K_inv_diag,
              ContactRows& rows) noexcept {
  auto W = rows.W();
  const NodesInUse used(problem, rows);
  Panel<m> panel;
  std::array<Probe<m>, max_contacts> probe;
  for (int i = 0; i < rows.contacts; ++i) probe[i] = Probe<m>(rows.row[i]);
  for (int j = 0; j < rows.contacts; ++j) {
    const ContactRow& of = rows.row[j];
    panel.fill(problem, used, K_inv_diag[of.instrument], of);
    for (int i = j; i < rows.contacts; ++i) {
      const ContactRow& row = rows.row[i];
      if (row.other >= 0 || of.other >= 0) {
        Mat3 B = coupling(K_inv_diag, row, of);
        if (i == j)
          B.triangularView<Eigen::StrictlyUpper>() = B.transpose();  // or round-off would not be symmetric
        W.template block<m, m>(m * i, m * j) = B.template topLeftCorner<m, m>();
        if (i > j) W.template block<m, m>(m * j, m * i) = B.template topLeftCorner<m, m>().transpose();
        if (i == j)
          W.template block<m, m>(m * j, m * j).diagonal().array() += rigid_compliance * B.trace() / 3;
        continue;
      }
      const bool one_instrument = row.instrument == of.instrument;
      const auto fill = [&](const auto& sample) {
        Eigen::Matrix<double, m, m> w;
        for (int c = 0; c < m; ++c)
          set_column(w, c, one_instrument ? probe[i](panel, sample, c) : probe[i].tissue(panel, sample, c));
        if (i == j) w.template triangularView<Eigen::StrictlyUpper>() = w.transpose();
        W.template block<m, m>(m * i, m * j) = w;
        W.template block<m, m>(m * j, m * i) = w.transpose();
      };
      if (row.edge < 0)
        fill(problem.sample[row.sample]);
      else
        fill(problem.edge[row.edge]);
    }
    if (of.other >= 0) continue;
    const double missing = missing_compliance(problem, K_inv_diag[of.instrument], of, panel);
    for (int c = 0; c < m; ++c) W(m * j + c, m * j + c) += missing;
    if (of.edge >= 0) W(m * j, m * j) += of.compliance;
  }
}

}  // namespace

void assemble_delassus(const CondensedProblem& problem, const EachInstrument<Vec6>& K_inv_diag,
                       ContactRows& rows) noexcept {
  if (rows.rows_per_contact == 1)
    assemble<1>(problem, K_inv_diag, rows);
  else
    assemble<3>(problem, K_inv_diag, rows);
}

}  // namespace hapticd
