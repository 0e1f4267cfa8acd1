// The Delassus operator column by column, made when it is asked for: of a hundred contacts within reach a
// fifth may press, and δ = W λ + q asks for the columns of those alone.
//
//   own blocks W_jj of all contacts at once;  columns (i, j), all i, of those asked for  (equations:
//   delassus.h)
//
// H is never formed: a contact touches three nodes (a blade's edge four), so column j of H C Hᵀ is three
// 3-column panels of C weighted, then three 3×3 blocks of that for each i. Symmetric by construction: an
// entry that is there is copied. Units and shapes: rows.W(), m rows a contact. Guarantee: wait-free, no
// allocation. The problem and the rows must outlive what is asked for.
#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "physics/contact/rows.h"

namespace hapticd {
namespace delassus {

// Of a vector in space the fourth lane is not meant.
// A typedef: of an alias clang drops `aligned`, and faults.
typedef double Lanes __attribute__((vector_size(32), aligned(8), may_alias));

inline Lanes lanes(const Vec3& v) noexcept { return Lanes{v[0], v[1], v[2], 0}; }
// Not by reference: clang believes what one refers to to be aligned to 32. Nor by memcpy: with GCC the
// assembly of W takes three times as long.
inline Lanes load(const double* p) noexcept { return *reinterpret_cast<const Lanes*>(p); }
inline void store(double* p, Lanes v) noexcept { *reinterpret_cast<Lanes*>(p) = v; }

// Nodes that rows stand on, ascending.
struct NodesInUse {
  int count = 0;
  std::array<std::int32_t, max_patch_nodes> node;

  void find(const CondensedProblem& problem, const ContactRows& rows) noexcept {
    std::array<bool, max_patch_nodes> used{};
    count = 0;
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

  // Displacement of another contact's point per unit of this one's force in each direction: G f.
  struct Moved {
    Lanes by[columns];
  };
  Moved tissue(const PatchSample& s) const noexcept { return tissue<3>(s); }
  Moved tissue(const EdgeSample& s) const noexcept { return tissue<4>(s); }
  // B f is shift + turn × arm there.
  Lanes shift(int c) const noexcept { return shift_[c]; }
  const Vec3& turn(int c) const noexcept { return turn_[c]; }

 private:
  template <int corners, typename Sample>
  Moved tissue(const Sample& s) const noexcept {
    Moved u{};
    if (!deforms_ || s.node[0] < 0) return u;
    for (int a = 0; a < corners; ++a) {
      const double weight = s.weight[a];
      for (int c = 0; c < columns; ++c) u.by[c] += weight * load(node_[c].data() + 3 * s.node[a]);
    }
    return u;
  }

  template <typename Sample>
  void fill_nodes(const CondensedProblem& problem, const NodesInUse& used, const Sample& s,
                  const Mat3& frame) noexcept {
    constexpr int corners = std::is_same_v<Sample, EdgeSample> ? 4 : 3;
    const int size = 3 * problem.nodes;
    const double* C[corners];
    double weight[corners];
    for (int a = 0; a < corners; ++a) {
      C[a] = problem.C().data() + static_cast<std::ptrdiff_t>(3 * s.node[a]) * size;
      weight[a] = s.weight[a] * problem.column_scale[s.node[a]];
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
  double tissue(Lanes u) const noexcept { return sum(normal * u); }
  double operator()(const Panel<1>& panel, Lanes u, int) const noexcept {
    return sum(normal * (u + panel.shift(0)) + moment * lanes(panel.turn(0)));
  }

 private:
  static double sum(Lanes w) noexcept { return w[0] + w[1] + w[2]; }
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
  Lanes tissue(Lanes u) const noexcept {
    return u[0] * direction[0] + u[1] * direction[1] + u[2] * direction[2];
  }
  Lanes operator()(const Panel<3>& panel, Lanes u, int c) const noexcept {
    const Vec3& turn = panel.turn(c);
    return tissue(u + panel.shift(c)) + (turn[0] * moment[0] + turn[1] * moment[1] + turn[2] * moment[2]);
  }
};

}  // namespace delassus

template <int m>
class DelassusColumns {
 public:
  // The own blocks; no column is there yet.
  void begin(const CondensedProblem& problem, const EachInstrument<Vec6>& K_inv_diag,
             ContactRows& rows) noexcept;
  // Column block j; once each.
  void make(int j) noexcept;
  // All of W.
  void make_all() noexcept;

 private:
  void own_block(int j) noexcept;
  void column(int j, int first) noexcept;  // of contacts from `first` on, but j
  double* block(int i, int j) noexcept { return W_ + static_cast<std::ptrdiff_t>(m * j) * n_ + m * i; }

  const CondensedProblem* problem_ = nullptr;
  EachInstrument<Vec6> K_inv_diag_;
  const ContactRows* rows_ = nullptr;
  double* W_ = nullptr;
  std::ptrdiff_t n_ = 0;
  delassus::NodesInUse used_;
  delassus::Panel<m> panel_;
  std::array<delassus::Probe<m>, max_contacts> probe_;
  std::array<bool, max_contacts> made_{};
  int count_ = 0;  // of them
};

// Of rows with one a contact, or three.
struct EitherColumns {
  DelassusColumns<1> normal;
  DelassusColumns<3> whole;
};

extern template class DelassusColumns<1>;
extern template class DelassusColumns<3>;

}  // namespace hapticd
