#include "tools/chart/solver/contact_surface.h"

#include <algorithm>
#include <map>

#include "physics/compliance/compliance.h"
#include "physics/simulation/patch.h"
#include "physics/tissue/surface.h"
#include "tools/chart/chart.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;

// A box with a corner at the origin, six tetrahedra a cell around the diagonal from corner 0 to corner 7.
TetMesh box(const Vec3& size, int n, int nz) {
  constexpr int corners[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                                 {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
  TetMesh mesh;
  for (int k = 0; k <= nz; ++k)
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i)
        mesh.nodes.emplace_back(size.x() * i / n, size.y() * j / n, size.z() * k / nz);
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i)
        for (const auto& c : corners) {
          Tet t;
          for (int a = 0; a < 4; ++a)
            t[a] = i + (c[a] & 1) + (n + 1) * (j + (c[a] >> 1 & 1) + (n + 1) * (k + (c[a] >> 2)));
          const auto& x = mesh.nodes;
          if (signed_volume(x[t[0]], x[t[1]], x[t[2]], x[t[3]]) < 0) std::swap(t[2], t[3]);
          mesh.tets.push_back(t);
        }
  return mesh;
}

// Nodes, compliance and points of the faces nearest to `centre`, until `most_nodes` are taken.
ContactSurface surface_of(const TissueModel& model, const Vec3& centre, int most_nodes, int per_triangle) {
  const BoundarySurface boundary(model.mesh);
  struct Face {
    double distance;
    Triangle nodes;
  };
  std::vector<Face> faces;
  for (const SurfaceFace& f : boundary.faces()) {
    const auto& x = model.mesh.nodes;
    const Vec3 middle = (x[f.nodes[0]] + x[f.nodes[1]] + x[f.nodes[2]]) / 3;
    const Vec3 outward = (x[f.nodes[1]] - x[f.nodes[0]]).cross(x[f.nodes[2]] - x[f.nodes[0]]);
    if (outward.z() > 0.3 * outward.norm()) faces.push_back({(middle - centre).norm(), f.nodes});
  }
  std::stable_sort(faces.begin(), faces.end(),
                   [](const Face& a, const Face& b) { return a.distance < b.distance; });

  ContactSurface surface;
  surface.centre = centre;
  std::map<int, int> index;
  std::vector<int> nodes;
  for (const Face& f : faces) {
    const auto fresh =
        std::count_if(f.nodes.begin(), f.nodes.end(), [&](int n) { return index.count(n) == 0; });
    if (static_cast<int>(nodes.size() + fresh) > most_nodes) break;
    std::array<int, 3> local;
    for (int a = 0; a < 3; ++a) {
      const auto [at, added] = index.emplace(f.nodes[a], static_cast<int>(nodes.size()));
      if (added) nodes.push_back(f.nodes[a]);
      local[a] = at->second;
    }
    for (const std::array<double, 3>& w : sample_weights(per_triangle))
      surface.points.push_back({local, w, Vec3::Zero()});
  }
  for (const int n : nodes) surface.x.push_back(model.mesh.nodes[n]);
  const auto compliance = make_exact_compliance(model, h);
  compliance->move_zone(nodes);
  compliance->update(rest_state(model));
  surface.C.resize(3 * nodes.size(), 3 * nodes.size());
  compliance->patch(nodes, surface.C);
  return surface;
}

}  // namespace

ContactSurface lens_surface(int per_triangle) {
  const TissueModel model = read_lens("1k");
  const auto higher = [](const Vec3& a, const Vec3& b) { return a.z() < b.z(); };
  const Vec3 pole = *std::max_element(model.mesh.nodes.begin(), model.mesh.nodes.end(), higher);
  return surface_of(model, pole, 90, per_triangle);
}

ContactSurface block_surface(int cells, int per_triangle) {
  const Vec3 size(8e-3, 8e-3, 6e-3);
  TetMesh mesh = box(size, cells, 5);
  std::vector<int> bottom(static_cast<std::size_t>(cells + 1) * (cells + 1));
  for (std::size_t n = 0; n < bottom.size(); ++n) bottom[n] = static_cast<int>(n);
  const TissueModel model =
      make_tissue_model(std::move(mesh), {3.0e3, 0.45, 1090, 2.0, 2.0e-3}, bottom, Vec3::Zero());
  return surface_of(model, Vec3(4e-3, 4e-3, 6e-3), 1 << 20, per_triangle);
}

ContactSurface pair_of(const ContactSurface& surface, double apart) {
  const int n = static_cast<int>(surface.x.size());
  ContactSurface pair = surface;
  pair.C = MatX::Zero(6 * n, 6 * n);
  for (int side = 0; side < 2; ++side) pair.C.block(3 * n * side, 3 * n * side, 3 * n, 3 * n) = surface.C;
  const Vec3 shift(0.5 * apart, 0, 0);
  for (Vec3& x : pair.x) x -= shift;
  for (const Vec3& x : surface.x) pair.x.push_back(x + shift);
  for (SurfacePoint p : surface.points) {
    for (int& a : p.node) a += n;
    pair.points.push_back(p);
  }
  return pair;
}

ContactSurface rigid_plane(double side, int per_side) {
  ContactSurface surface;
  for (int j = 0; j < per_side; ++j)
    for (int i = 0; i < per_side; ++i)
      surface.points.push_back(
          {{-1, -1, -1}, {0, 0, 0}, side * Vec3((i + 0.5) / per_side - 0.5, (j + 0.5) / per_side - 0.5, 0)});
  return surface;
}

ContactSurface repeated(const ContactSurface& surface, int times) {
  ContactSurface result = surface;
  result.points.clear();
  for (const SurfacePoint& p : surface.points)
    for (int k = 0; k < times; ++k) result.points.push_back(p);
  return result;
}

}  // namespace hapticd
