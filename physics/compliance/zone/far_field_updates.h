// Low-rank changes of a reference factor outside its corner: A' = A ∓ V₁V₁ᵀ ∓ V₂V₂ᵀ …, and ties of its nodes
// to new ones of the corner, kept between its two halves. The corner may grow between two of them: the
// earlier V are zero in its new rows.
//
//   [A_rr A_rz V_r; A_zr A_zz V_z; V_rᵀ V_zᵀ D⁰]   with D⁰ = ±I eliminates to A' where λ goes first (a tie of
//   u_r to u_z has V_r = I, V_z = −I, D⁰ = 0: λ is the force between them), and to
//   Y = L_rr⁻¹ V_r,   v = V_z − L_zr Y,   D = ±I − YᵀY,   S_out' = S_out − v D⁻¹ vᵀ
//
// where it goes between r and z. So a removal that reaches out of the zone costs one sparse half solve and a
// change of S_out, once: the corner and C_pp of every later step cost what they did. Only `apply` has the
// λ to solve, of an element at most twelve. Woodbury in factor form: no inverse of the removed element is
// needed. Terms are eliminated in the order they came, so T of a later one is reduced by the earlier:
//   t_ij = −Y_iᵀY_j − Σ_k<i t_kiᵀ D_k⁻¹ t_kj,   and the same for v_j and D_j.
// Every D_j is definite as long as A is after each term (negative for an added one and for a tie).
// Shapes: columns in the order's places, 3·nodes. Units: V Vᵀ, D⁻¹ v vᵀ [N/m].
// Source: the paper, eqs. (3)–(6); departure: it keeps the terms against the whole of C.
#pragma once

#include <Eigen/Cholesky>
#include <vector>

#include "physics/compliance/element_term.h"
#include "physics/compliance/zone/leading_columns.h"

namespace hapticd {

class FarFieldUpdates {
 public:
  using Corner = Eigen::Ref<MatX, 0, Eigen::OuterStride<>>;

  void clear();
  bool empty() const noexcept { return terms_.empty(); }

  // `places`: in the order, of the nodes that V has three rows each of. False, and nothing is changed, when D
  // is not definite.
  [[nodiscard]] bool change(LeadingColumns& panels, const Eigen::Ref<const MatX>& V,
                            std::span<const int> places, TermSign sign, Corner S_out);

  // The nodes at these places outside the corner are one with as many of the corner, from `row` on, that are
  // not coupled to anything yet.
  [[nodiscard]] bool tie(LeadingColumns& panels, std::span<const int> places, Eigen::Index row, Corner S_out);

  // Between the halves, for each column of X: λ before the corner's solve, and after it.
  void before_corner(const Eigen::Ref<const MatX>& X, MatX& g, Eigen::Ref<MatX> corner) const;
  void after_corner(const Eigen::Ref<const MatX>& corner, MatX& g, Eigen::Ref<MatX> X) const;

  // gᵀ D⁻¹ g after `before_corner`: what the λ give to bᵀ A'⁻¹ b.
  void add_energy(const MatX& g, MatX& C) const;

  int columns() const noexcept { return columns_; }
  std::size_t memory_bytes() const noexcept;

 private:
  Eigen::Ref<MatX> scratch(const LeadingColumns& panels, Eigen::Index rank, Eigen::Index corner);
  // Of the V in scratch.
  bool eliminate(LeadingColumns& panels, Eigen::Ref<MatX> X, std::span<const int> nonzero, double D0,
                 Corner S_out);

  struct Term {
    int first = 0;         // of its λ
    std::vector<int> row;  // rest rows where Y may be nonzero
    MatX Y;                // |row| × rank
    MatX v;                // corner, as it was then × rank
    MatX W;                // first × rank: D_i⁻¹ t_ij of the earlier terms, stacked
    double sign = 1;       // of D
    Eigen::LLT<MatX> D;    // of sign · D
  };
  static MatX solved(const Term& term, const MatX& b) { return term.sign * term.D.solve(b); }

  std::vector<Term> terms_;
  int columns_ = 0;
  MatX X_;  // scratch, zero between calls
};

}  // namespace hapticd
