#include "physics/tissue/surface.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace hapticd {

namespace {

struct KeyedFace {
  Triangle key;  // sorted nodes: equal for the two sides of a shared face
  int id;
};

std::vector<KeyedFace> sorted_faces(std::span<const Tet> tets) {
  std::vector<KeyedFace> faces;
  faces.reserve(4 * tets.size());
  for (int t = 0; t < static_cast<int>(tets.size()); ++t)
    for (int f = 0; f < 4 && tets[t] != no_tet; ++f) {
      Triangle key = outward_face(tets[t], f);
      std::sort(key.begin(), key.end());
      faces.push_back({key, 4 * t + f});
    }
  std::sort(faces.begin(), faces.end(), [](const KeyedFace& a, const KeyedFace& b) {
    return a.key != b.key ? a.key < b.key : a.id < b.id;
  });
  return faces;
}

}  // namespace

std::vector<int> faces_across(std::span<const Tet> tets) {
  std::vector<int> across(4 * tets.size(), -1);
  const std::vector<KeyedFace> faces = sorted_faces(tets);
  for (std::size_t i = 0; i + 1 < faces.size(); ++i) {
    if (faces[i].key != faces[i + 1].key) continue;
    if (across[faces[i].id] >= 0)
      throw std::invalid_argument("more than two tetrahedra share a face of tetrahedron " +
                                  std::to_string(faces[i].id / 4));
    across[faces[i].id] = faces[i + 1].id;
    across[faces[i + 1].id] = faces[i].id;
  }
  return across;
}

BoundarySurface::BoundarySurface(const TetMesh& mesh)
    : tets_(mesh.tets),
      across_(faces_across(mesh.tets)),
      position_(4 * mesh.tets.size(), -1),
      alive_(mesh.tets.size(), true) {
  for (int id = 0; id < static_cast<int>(across_.size()); ++id)
    if (across_[id] < 0 && tets_[id / 4] != no_tet) insert(id, false);
}

void BoundarySurface::remove(std::span<const int> tets) {
  for (const int t : tets) {
    if (!alive_[t]) continue;
    alive_[t] = false;
    for (int id = 4 * t; id < 4 * t + 4; ++id) {
      if (position_[id] >= 0)
        erase(id);
      else
        insert(across_[id], true);
    }
  }
}

void BoundarySurface::insert(int id, bool cut) {
  position_[id] = static_cast<int>(faces_.size());
  faces_.push_back({outward_face(tets_[id / 4], id % 4), id, cut});
}

void BoundarySurface::erase(int id) {
  const int hole = position_[id];
  faces_[hole] = faces_.back();
  position_[faces_[hole].id] = hole;
  position_[id] = -1;
  faces_.pop_back();
}

}  // namespace hapticd
