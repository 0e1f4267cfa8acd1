// The boundary surface of the live tetrahedra, following removals at a cost that counts only what changes.
//
//   boundary = faces of live tetrahedra that no other live tetrahedron shares
//
// Triangles are wound outward. A face's id is 4·tet + face (outward_face), for good: a face that comes
// and goes elsewhere never renumbers the others. The order of `faces()` changes with removals.
// Contract: a face belongs to at most two tetrahedra; the constructor throws otherwise.
#pragma once

#include <span>
#include <vector>

#include "physics/tissue/mesh.h"

namespace hapticd {

struct SurfaceFace {
  Triangle nodes;
  int id;    // 4·tet + face
  bool cut;  // exposed by a removal, not on the original boundary
};

// Per face id the id of the same face seen from the neighbour, or -1 on the mesh's boundary.
// Errors: std::invalid_argument if more than two tetrahedra share a face.
std::vector<int> faces_across(std::span<const Tet> tets);

class BoundarySurface {
 public:
  explicit BoundarySurface(const TetMesh& mesh);

  // Deletes these tetrahedra's faces and exposes their live neighbours'. Already removed ones are skipped.
  void remove(std::span<const int> tets);

  const std::vector<SurfaceFace>& faces() const noexcept { return faces_; }

 private:
  void insert(int id, bool cut);
  void erase(int id);

  std::vector<Tet> tets_;
  std::vector<int> across_;    // faces_across
  std::vector<int> position_;  // per face id: index into faces_, or -1
  std::vector<bool> alive_;    // per tetrahedron
  std::vector<SurfaceFace> faces_;
};

}  // namespace hapticd
