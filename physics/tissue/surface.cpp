#include "physics/tissue/surface.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "physics/tissue/tissue.h"

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
  std::vector<int> across(4 * tets.size(), outer_face);
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

BoundarySurface::BoundarySurface(const TetMesh& mesh, std::span<const std::uint32_t> opened)
    : tets_(mesh.tets),
      across_(faces_across(mesh.tets)),
      position_(4 * mesh.tets.size(), -1),
      alive_(mesh.tets.size(), true) {
  faces_.reserve(across_.size());
  for (int id = 0; id < static_cast<int>(across_.size()); ++id)
    if (across_[id] < 0 && tets_[id / 4] != no_tet) insert(id, false);
  for (const std::uint32_t id : opened)
    if (id < position_.size() && position_[id] >= 0) faces_[position_[id]].cut = true;
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

void BoundarySurface::follow(const TissueModel& model, std::span<const int> tets,
                             std::span<const std::array<int, 2>> opened) {
  for (const int t : tets) renew(model, t);
  for (const auto& sides : opened)
    for (const int id : sides) renew(model, id / 4);
}

// Its corners and neighbours, which may have its faces under new ids, and which of its faces are boundary.
void BoundarySurface::renew(const TissueModel& model, int tet) {
  if (!alive_[tet]) return;
  tets_[tet] = model.mesh.tets[tet];
  for (int id = 4 * tet; id < 4 * tet + 4; ++id) {
    const int other = across_[id] = model.across[id];
    if (other >= 0) across_[other] = id;
    if (position_[id] >= 0) erase(id);
    if (other < 0 || !alive_[other / 4]) insert(id, other != outer_face);
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
