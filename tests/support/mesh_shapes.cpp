#include "tests/support/mesh_shapes.h"

#include <random>
#include <stdexcept>

namespace hapticd {

namespace {

// Cell corners are numbered by bits: x = 1, y = 2, z = 4.
constexpr int six[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                           {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
constexpr int five[5][4] = {{1, 2, 4, 7}, {0, 1, 2, 4}, {3, 2, 1, 7}, {5, 1, 4, 7}, {6, 4, 2, 7}};

void add_positive(TetMesh& mesh, Tet t) {
  const auto& x = mesh.nodes;
  if (signed_volume(x[t[0]], x[t[1]], x[t[2]], x[t[3]]) < 0) std::swap(t[2], t[3]);
  mesh.tets.push_back(t);
}

}  // namespace

TetMesh box_mesh(const Vec3& size, int nx, int ny, int nz, int tets_per_cell) {
  if (tets_per_cell != 5 && tets_per_cell != 6)
    throw std::invalid_argument("box_mesh: 5 or 6 tetrahedra a cell");
  if (nx < 1 || ny < 1 || nz < 1) throw std::invalid_argument("box_mesh: needs at least one cell each way");
  TetMesh mesh;
  for (int k = 0; k <= nz; ++k)
    for (int j = 0; j <= ny; ++j)
      for (int i = 0; i <= nx; ++i)
        mesh.nodes.emplace_back(size.x() * i / nx, size.y() * j / ny, size.z() * k / nz);
  const auto node = [&](int i, int j, int k) { return i + (nx + 1) * (j + (ny + 1) * k); };
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i) {
        // The five-way split's diagonals only meet across faces when every other cell is mirrored in x.
        const int mirror = tets_per_cell == 5 ? (i + j + k) & 1 : 0;
        const auto corner = [&](int c) {
          return node(i + ((c & 1) ^ mirror), j + ((c >> 1) & 1), k + (c >> 2));
        };
        const auto split = tets_per_cell == 6 ? &six[0] : &five[0];
        for (int t = 0; t < tets_per_cell; ++t) {
          const int* c = split[t];
          add_positive(mesh, {corner(c[0]), corner(c[1]), corner(c[2]), corner(c[3])});
        }
      }
  MeshGroup bottom;
  bottom.name = "bottom";
  for (int n = 0; n < (nx + 1) * (ny + 1); ++n) bottom.nodes.push_back(n);
  mesh.groups.push_back(std::move(bottom));
  return mesh;
}

bool on_box_boundary(const Vec3& node, const Vec3& size) {
  const Vec3 tolerance = 1e-9 * size;
  return (node.array() <= tolerance.array()).any() || (node.array() >= (size - tolerance).array()).any();
}

void jitter_interior(TetMesh& mesh, const Vec3& size, double amplitude, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> shift(-amplitude, amplitude);
  for (Vec3& x : mesh.nodes) {
    if (on_box_boundary(x, size)) continue;
    for (int axis = 0; axis < 3; ++axis) x[axis] += shift(random);
  }
}

}  // namespace hapticd
