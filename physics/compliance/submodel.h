// Some of a body's tetrahedra with their nodes, as a model of their own that is numbered anew.
//
// What is simulated of a body whose rest is condensed is one, and so is what is far from it:
// the rest has no part in their factors. A spring of a boundary node of condensed tissue is in K̂ already.
// Units and shapes: as tissue.h. Errors: std::invalid_argument for a node or tetrahedron the body has not.
#pragma once

#include <span>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

struct Submodel {
  // nodes, tets: of the body, ascending, every corner among the nodes; condensed: of the body, its boundary
  // among the nodes, or null.
  Submodel(const TissueModel& whole, std::vector<int> nodes, std::vector<int> tets,
           const CondensedTissue* condensed);
  Submodel(const Submodel&) = delete;
  Submodel& operator=(const Submodel&) = delete;

  // All that a compliance looks at, of the body's present state.
  const TissueState& follow(const TissueState& whole);

  // Those of a list that are in it, by its own numbers; valid until the next.
  const std::vector<int>& nodes_of(std::span<const int> whole) { return own(whole, of_node); }
  const std::vector<int>& tets_of(std::span<const int> whole) { return own(whole, of_tet); }

  VecX gather(const Eigen::Ref<const VecX>& whole) const;
  void scatter(const VecX& own, Eigen::Ref<VecX> whole) const;  // the rest is zero

  TissueModel model;
  TissueState state;                 // at rest, all alive, until it follows
  std::vector<int> node, tet;        // of the body
  std::vector<int> of_node, of_tet;  // −1: not in it

 private:
  Tet own(const Tet& corners) const;
  const std::vector<int>& own(std::span<const int> whole, const std::vector<int>& number);

  std::vector<int> list_;
};

}  // namespace hapticd
