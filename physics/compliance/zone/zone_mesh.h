// The meshes that a body's reference factors are made of: one until it is cut, then another after each cut.
//
// A reference factor is made on another thread while the model may be cut: so it has a copy. Of a mesh that
// one was made of already that is shared, ready for use; of a newer one it is what the factor's maker makes
// that from, on its own thread (METIS is not called again: growing_order.h). Cost of the copy: 150 bytes for
// each tetrahedron. Units as SystemMatrix's.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "physics/compliance/factor/node_order.h"
#include "physics/compliance/growing_order.h"
#include "physics/compliance/system_matrix.h"

namespace hapticd {

// What all reference factors of one mesh share; never changes.
struct ZoneStructure {
  ZoneStructure(const TissueModel& model, double step);  // METIS orders it
  ZoneStructure(const TissueModel& model, double step, std::vector<int> order);
  double h;
  NodeGraph graph;
  std::vector<int> fill_order;
  SystemMatrix matrix;  // not assembled: copied
};

struct ZoneMesh {
  int cuts = 0;  // that it has had
  int tets = 0;  // in use
  std::shared_ptr<const ZoneStructure> structure;
  // Without a structure: what one is made from.
  TissueModel model = {};  // what SystemMatrix needs of it
  double h = 0;
  std::vector<int> fill_order = {};

  void make_structure();
};

class ZoneMeshes {
 public:
  ZoneMeshes(const TissueModel& model, double h);

  // A cut; `before`: the elements of an earlier mesh. Returns these tetrahedra without duplicates. New nodes:
  // order() knows whom they came from.
  std::vector<int> cut(std::span<const SystemMatrix::Element> before, std::span<const int> tets);

  int cuts() const noexcept { return cuts_; }
  std::vector<int> cut_since(int cuts) const;  // tetrahedra
  const GrowingOrder& order() const noexcept { return order_; }
  const ZoneStructure& structure() const noexcept { return *structure_; }

  int spare_nodes() const noexcept { return model_.node_count() - model_.nodes_in_use; }

  ZoneMesh now() const;
  void made(const ZoneMesh& mesh);  // its structure is shared from here on

 private:
  const TissueModel& model_;
  std::shared_ptr<const ZoneStructure> structure_;
  int structure_cuts_ = 0;
  GrowingOrder order_;
  int cuts_ = 0;
  std::vector<int> cut_at_;  // per tetrahedron: the cut that changed it last
};

}  // namespace hapticd
