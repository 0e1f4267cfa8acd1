#include "tools/chart/step/travelling_tip.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/tissue/surface.h"
#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"
#include "server/scene/scene_reader.h"

namespace hapticd {

Scene lens_under_tip(const std::string& lens, double alarm_distance, double sample_spacing) {
  const std::filesystem::path scenes = config_directory() / "scenes";
  Scene scene = read_scene(scenes / "lens_large" / "lens_5k.yaml");
  SceneBody& body = scene.bodies.at(0);
  body.mesh_file =
      lens == "1k" ? scenes / "cataract" / "lens.msh" : scenes / "lens_large" / ("lens_" + lens + ".msh");
  if (lens == "100k" && !std::filesystem::is_regular_file(body.mesh_file))
    throw InputError(body.mesh_file, 0, "",
                     "is not there: it is too large to be shipped; `mesh.sh 100k` beside it makes it (gmsh)");
  body.mesh = read_mesh_file(body.mesh_file);
  const MeshGroup* zonule = body.mesh.group("zonule");
  if (!zonule) throw InputError(body.mesh_file, 0, "", "has no group 'zonule'");
  body.fixed_nodes = zonule->nodes;
  scene.alarm_distance = alarm_distance;
  scene.sample_spacing = sample_spacing;
  return scene;
}

TravellingTip::TravellingTip(const Scene& scene, const TipSettings& settings)
    : settings_(settings), radius_(scene.first().shape.primitives.at(scene.first().shape.tip).radius) {
  const TetMesh& mesh = scene.bodies.at(0).mesh;
  const BoundarySurface boundary(mesh);
  for (const SurfaceFace& face : boundary.faces()) {
    const auto [a, b, c] = face.nodes;
    const std::array<Vec3, 3> x = {mesh.nodes[a], mesh.nodes[b], mesh.nodes[c]};
    if ((x[1] - x[0]).cross(x[2] - x[0]).z() > 0) faces_.push_back(x);
  }
}

Pose TravellingTip::at(double t) const {
  const double way = settings_.speed * t;
  const double r = settings_.around + settings_.aside * std::sin(way / 5e-3);
  const double angle = way / 1.2e-3 + settings_.turned;
  Pose X;
  X.p = {r * std::cos(angle), r * std::sin(angle), 0};
  X.p.z() = surface(X.p.x(), X.p.y()) + radius_ - settings_.depth;
  return X;
}

double TravellingTip::surface(double x, double y) const {
  double highest = -std::numeric_limits<double>::infinity();
  for (const auto& f : faces_) {
    // Areas of the corners' opposite triangles, seen from above.
    double area[3], sum = 0;
    bool inside = true;
    for (int k = 0; k < 3 && inside; ++k) {
      const Vec3& p = f[(k + 1) % 3];
      const Vec3& q = f[(k + 2) % 3];
      area[k] = (p.x() - x) * (q.y() - y) - (p.y() - y) * (q.x() - x);
      inside = area[k] >= 0;
      sum += area[k];
    }
    if (inside && sum > 0)
      highest = std::max(highest, (area[0] * f[0].z() + area[1] * f[1].z() + area[2] * f[2].z()) / sum);
  }
  return highest;
}

}  // namespace hapticd
