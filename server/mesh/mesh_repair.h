// What is wrong with a mesh as it stands in its file, and the repairs that change nothing but its
// book-keeping.
//
//   orientation   an inverted tetrahedron gets two of its nodes exchanged
//   duplicates    nodes within 1e-9 of the mesh's diagonal become one (the lowest number); a tetrahedron that
//                 then names a node twice held nothing and goes, one that stands there twice is kept once
//   orphans       nodes of no tetrahedron go
//
// Not repaired, because it needs another mesh: a tetrahedron without volume whose nodes are apart, and a face
// that three tetrahedra share. Merging joins what touches node on node: `pieces` says how much.
// Errors: InputError with file and line for a node that is missing, twice there or not finite, and for what
// is not repaired.
#pragma once

#include "physics/tissue/mesh.h"
#include "server/mesh/mesh_reader_raw.h"

namespace hapticd {

struct MeshFaults {
  int inverted = 0;
  int duplicate_nodes = 0;  // beyond the first at each place
  int collapsed = 0;        // tetrahedra between duplicates of one place
  int repeated = 0;         // tetrahedra that stand there more than once, counted beyond the first
  int orphan_nodes = 0;
  int pieces_before = 0, pieces = 0;  // connected by nodes
  int first_inverted_line = 0;        // 0: none, or a binary file

  // hapticd reads the file as it stands, and nothing in it is beside the point.
  bool clean() const { return inverted + duplicate_nodes + collapsed + repeated + orphan_nodes == 0; }
  // hapticd refuses the file as it stands.
  bool refused() const { return inverted + collapsed > 0; }
};

struct RepairedMesh {
  MeshFaults faults;
  TetMesh mesh;
};

// merge: join duplicate nodes.
RepairedMesh repair_mesh(RawMesh raw, bool merge);

}  // namespace hapticd
