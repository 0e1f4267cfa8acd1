#include "physics/tissue/mesh_quality.h"
#include "physics/tissue/surface.h"
#include "server/files/input_error.h"
#include "server/mesh/mesh_reader.h"
#include "server/mesh/mesh_repair.h"
#include "tests/fuzz/targets.h"

namespace hapticd {
namespace {

void check(const TetMesh& mesh) {
  demand(!mesh.tets.empty(), "a mesh that is read has tetrahedra");
  const auto nodes = static_cast<int>(mesh.nodes.size());
  for (const Tet& t : mesh.tets)
    for (const int n : t) demand(n >= 0 && n < nodes, "a corner is a node");
  for (const Vec3& x : mesh.nodes) demand(x.allFinite(), "a node is finite");
  for (const MeshGroup& g : mesh.groups) {
    for (const int n : g.nodes) demand(n >= 0 && n < nodes, "a group's node is a node");
    for (const int e : g.tets)
      demand(e >= 0 && e < static_cast<int>(mesh.tets.size()), "… its element an element");
  }
}

}  // namespace

void fuzz_mesh(FuzzInput input) {
  const std::string bytes = text_of(input);
  try {
    check(read_mesh(bytes, "fuzz.msh"));
  } catch (const InputError&) {
  }
  try {
    for (const bool merge : {false, true}) {
      const RepairedMesh repaired = repair_mesh(read_raw_mesh(bytes, "fuzz.msh"), merge);
      check(repaired.mesh);
      measure_mesh(repaired.mesh);
    }
  } catch (const InputError&) {
  }
}

}  // namespace hapticd
