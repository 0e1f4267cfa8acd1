// The system matrix A as 3×3 blocks on the node graph, assembled afresh from live tetrahedra.
//
//   A = M/h² + B/h + K = (1/h² + α/h) M + (1 + β/h) K,   K = Σ_e K_e(R_e);   of a static body A = K
//
// Units: A [N/m], h [s]. Shapes: one block per node, one per edge (i, j) with i < j: rows of i, columns of j;
// the blocks of (j, i) are their transposes. Rows of fixed and orphan nodes are those of the identity times
// `identity_scale`, the mean diagonal of the others, so that they neither couple nor spoil the conditioning.
// Only nodes in use have rows. K has the springs' k I too, on their nodes, and K̂ of what is condensed.
// Everything needed is copied or shared: the model may go. Source: the paper, eq. (2).
#pragma once

#include <Eigen/SparseCore>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "physics/compliance/factor/node_order.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

class SystemMatrix {
 public:
  SystemMatrix(const TissueModel& model, const NodeGraph& graph, double h);

  // At the state's rotations; no allocation.
  void assemble(const TissueState& state) noexcept;

  struct Edge {
    int i, j;  // i < j, both free
  };
  int node_count() const noexcept { return static_cast<int>(diagonal_.size()); }
  const std::vector<Edge>& edges() const noexcept { return edges_; }
  const std::vector<Mat3>& diagonal() const noexcept { return diagonal_; }
  const std::vector<Mat3>& coupling() const noexcept { return coupling_; }   // per edge
  bool in_system(int node) const noexcept { return in_system_[node] != 0; }  // neither fixed nor orphan
  double identity_scale() const noexcept { return identity_scale_; }

  VecX multiply(const VecX& x) const;  // A x

  // Per edge, whether a live tetrahedron has it: the others' blocks are zero for ever.
  std::vector<std::uint8_t> live_edges(const TissueState& state) const;
  NodeGraph graph_of(const std::vector<std::uint8_t>& live_edges) const;

  struct Element {
    Tet node = no_tet;  // ascending
    std::array<int, 6> edge = {-1, -1, -1,
                               -1, -1, -1};   // 01 02 03 12 13 23 of `node`; -1 where a node is fixed
    Gradients gradients = Gradients::Zero();  // columns follow `node`
    double volume = 0;
    Elasticity law = {};
  };
  const std::vector<Element>& elements() const noexcept {
    return elements_;
  }  // per tetrahedron, spare ones too
  const std::vector<std::uint8_t>& fixed() const noexcept { return fixed_; }  // of the model: spare nodes too
  bool fixed(int node) const noexcept { return fixed_[node] != 0; }
  // What one element adds: blocks from (1 + β/h) μ and λ, and on the diagonal of each of its nodes
  // (1/h² + α/h) times a quarter of its mass.
  double stiffness() const noexcept;  // 1 + β/h
  double mu(const Element& element) const noexcept { return stiffness() * element.law.mu; }
  double lambda(const Element& element) const noexcept { return stiffness() * element.law.lambda; }
  double lumped_mass(const Element& element) const noexcept;

 private:
  void add_collapsed(const Collapsed& c) noexcept;
  void add_condensed() noexcept;

  double h_;
  Material material_;
  bool dynamic_;
  std::vector<std::uint8_t> fixed_;
  std::vector<NodeSpring> springs_;  // of the model
  std::shared_ptr<const CondensedTissue> condensed_;
  std::vector<int> condensed_edge_;  // of its pairs i < j, j after j
  std::vector<Element> elements_;
  std::vector<Edge> edges_;
  std::vector<Mat3> diagonal_;
  std::vector<Mat3> coupling_;
  std::vector<std::uint8_t> in_system_;
  double identity_scale_ = 1;
};

// The model's tetrahedron as it is now, without its edges.
SystemMatrix::Element element_of(const TissueModel& model, int tet) noexcept;

// The nearest of a tetrahedron and those it was split from that these elements know; -1: none is.
int known_ancestor(const TissueModel& model, std::span<const SystemMatrix::Element> elements,
                   int tet) noexcept;

// A x at a state, element by element without A. Entries outside the system are zero, and have to be in x.
VecX multiply_system_matrix(const TissueModel& model, const TissueState& state, double h, const VecX& x);

// The same matrix, both triangles, summed element by element without any of the above: for oracles.
Eigen::SparseMatrix<double> assemble_system_matrix(const TissueModel& model, const TissueState& state,
                                                   double h);

}  // namespace hapticd
