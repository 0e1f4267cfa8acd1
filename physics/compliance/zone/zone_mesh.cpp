#include "physics/compliance/zone/zone_mesh.h"

#include <utility>

namespace hapticd {

ZoneStructure::ZoneStructure(const TissueModel& model, double step)
    : h(step), graph(node_graph(model)), fill_order(fill_reducing_order(graph)), matrix(model, graph, step) {}

ZoneStructure::ZoneStructure(const TissueModel& model, double step, std::vector<int> order)
    : h(step), graph(node_graph(model)), fill_order(std::move(order)), matrix(model, graph, step) {}

void ZoneMesh::make_structure() {
  if (structure) return;
  structure = std::make_shared<const ZoneStructure>(model, h, std::move(fill_order));
  model = {};
}

ZoneMeshes::ZoneMeshes(const TissueModel& model, double h)
    : model_(model),
      structure_(std::make_shared<const ZoneStructure>(model, h)),
      order_(structure_->fill_order),
      cut_at_(model.tet_count(), 0) {}

std::vector<int> ZoneMeshes::cut(std::span<const SystemMatrix::Element> before, std::span<const int> tets) {
  ++cuts_;
  std::vector<int> once;
  for (const int t : tets)
    if (std::exchange(cut_at_[t], cuts_) != cuts_) once.push_back(t);
  order_.follow(model_, before, once);
  return once;
}

std::vector<int> ZoneMeshes::cut_since(int cuts) const {
  std::vector<int> tets;
  for (int t = 0; t < model_.tets_in_use; ++t)
    if (cut_at_[t] > cuts) tets.push_back(t);
  return tets;
}

ZoneMesh ZoneMeshes::now() const {
  ZoneMesh mesh;
  mesh.cuts = cuts_;
  mesh.tets = model_.tets_in_use;
  if (structure_cuts_ == cuts_) {
    mesh.structure = structure_;
    return mesh;
  }
  mesh.model.mesh.tets = model_.mesh.tets;
  mesh.model.material = model_.material;
  mesh.model.elastic = model_.elastic;
  mesh.model.springs = model_.springs;
  mesh.model.condensed = model_.condensed;
  mesh.model.gradients = model_.gradients;
  mesh.model.volume = model_.volume;
  mesh.model.fixed = model_.fixed;
  mesh.model.nodes_in_use = model_.nodes_in_use;
  mesh.model.tets_in_use = model_.tets_in_use;
  mesh.model.dynamic = model_.dynamic;
  mesh.h = structure_->h;
  mesh.fill_order = order_.order();
  return mesh;
}

void ZoneMeshes::made(const ZoneMesh& mesh) {
  structure_ = mesh.structure;
  structure_cuts_ = mesh.cuts;
}

}  // namespace hapticd
