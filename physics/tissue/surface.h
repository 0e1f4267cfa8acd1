// The boundary surface of the live tetrahedra, following cuts and removals at a cost that counts only what
// changes.
//
//   boundary = faces of live tetrahedra that no other live tetrahedron shares
//
// Triangles are wound outward. A face's id is 4·tet + face (outward_face), for good: a face that comes
// and goes elsewhere never renumbers the others. The order of `faces()` changes with cuts and removals.
// Contract: a face belongs to at most two tetrahedra; the constructor throws otherwise.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "physics/tissue/mesh.h"

namespace hapticd {

struct TissueModel;

struct SurfaceFace {
  Triangle nodes;
  int id;    // 4·tet + face
  bool cut;  // exposed by a removal or opened, not on the original boundary
};

// What a face without another side has in place of its neighbour's id.
inline constexpr int outer_face = -1;   // on the boundary of the first mesh
inline constexpr int opened_face = -2;  // a cut made it

// Per face id the id of the same face seen from the neighbour, or `outer_face`.
// Errors: std::invalid_argument if more than two tetrahedra share a face.
std::vector<int> faces_across(std::span<const Tet> tets);

class BoundarySurface {
 public:
  // opened: ids of faces that earlier cuts made; what is no boundary face is left out.
  explicit BoundarySurface(const TetMesh& mesh, std::span<const std::uint32_t> opened = {});

  // Deletes these tetrahedra's faces and exposes their live neighbours'. Already removed ones are skipped.
  void remove(std::span<const int> tets);

  // After a cut. `tets`: live, and their corners changed or they were taken into use; `opened`: both ids of
  // each face that opened. A part of a face is `cut` if the whole is. No allocation.
  void follow(const TissueModel& model, std::span<const int> tets,
              std::span<const std::array<int, 2>> opened);

  const std::vector<SurfaceFace>& faces() const noexcept { return faces_; }

 private:
  void insert(int id, bool cut);
  void erase(int id);
  void renew(const TissueModel& model, int tet);

  std::vector<Tet> tets_;
  std::vector<int> across_;    // faces_across
  std::vector<int> position_;  // per face id: index into faces_, or -1
  std::vector<bool> alive_;    // per tetrahedron
  std::vector<SurfaceFace> faces_;
};

}  // namespace hapticd
