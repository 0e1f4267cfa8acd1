#include "tools/chart/force/force_motion.h"

#include <algorithm>

#include "physics/tissue/surface.h"
#include "server/files/input_error.h"
#include "server/record/trajectory_reader.h"

namespace hapticd {

namespace {

const SceneBody& tissue_of(const Scene& scene) {
  for (const SceneBody& body : scene.bodies)
    if (body.kind == BodyKind::deformable) return body;
  throw InputError(scene.file, 0, "bodies", "has no deformable body");
}

// Points of the surface at rest: corners, and the middles of edges and faces.
std::vector<Vec3> surface_points(const SceneBody& body) {
  std::vector<Vec3> points;
  const BoundarySurface surface(body.mesh);
  for (const SurfaceFace& face : surface.faces()) {
    const Vec3 &a = body.mesh.nodes[face.nodes[0]], &b = body.mesh.nodes[face.nodes[1]],
               &c = body.mesh.nodes[face.nodes[2]];
    for (const Vec3& p :
         {a, b, c, Vec3((a + b) / 2), Vec3((b + c) / 2), Vec3((c + a) / 2), Vec3((a + b + c) / 3)})
      points.push_back(p);
  }
  return points;
}

double overlap(const std::vector<Vec3>& points, const Instrument& instrument, const Pose& X) {
  double deepest = -1;
  for (const Vec3& p : points) deepest = std::max(deepest, -gap_at(instrument, X, p).distance);
  return deepest;
}

Trajectory mapped(const Scene& scene, const Trajectory& recording) {
  std::vector<TrajectorySample> samples = recording.samples;
  for (TrajectorySample& s : samples) s.pose = to_scene(scene.device, s.pose);
  return make_trajectory(std::move(samples));
}

Quat mean_orientation(const std::vector<TrajectorySample>& samples) {
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (const TrajectorySample& s : samples) {
    const Eigen::Vector4d q = s.pose.q.coeffs();
    sum += q.dot(samples.front().pose.q.coeffs()) < 0 ? Eigen::Vector4d(-q) : q;
  }
  return Quat(sum).normalized();
}

Trajectory fitted(const Scene& scene, const std::vector<Vec3>& surface, const Trajectory& recording,
                  const WindowSettings& settings) {
  std::vector<TrajectorySample> samples = recording.samples;
  Vec3 low = samples.front().pose.p, high = low;
  for (const TrajectorySample& s : samples) {
    low = low.cwiseMin(s.pose.p);
    high = high.cwiseMax(s.pose.p);
  }
  const Vec3 middle = 0.5 * (low + high);
  const double sideways = 0.5 * (high - low).head<2>().maxCoeff();
  const double scale = std::min(scene.device.position_scale, settings.reach / std::max(sideways, 1e-9));
  const Quat upright = mean_orientation(samples).conjugate();
  const Vec3 top = *std::max_element(surface.begin(), surface.end(),
                                     [](const Vec3& a, const Vec3& b) { return a.z() < b.z(); });
  for (TrajectorySample& s : samples) {
    s.pose.p = scale * (s.pose.p - middle) + top;
    s.pose.q = (s.pose.q * upright).normalized();
  }
  // The higher, the less it overlaps.
  double lift_low = -20e-3, lift_high = 20e-3;
  for (int i = 0; i < 24; ++i) {
    const double lift = 0.5 * (lift_low + lift_high);
    double deepest = -1;
    for (const TrajectorySample& s : samples)
      deepest =
          std::max(deepest, overlap(surface, scene.instrument, {s.pose.p + lift * Vec3::UnitZ(), s.pose.q}));
    (deepest > settings.depth ? lift_low : lift_high) = lift;
  }
  for (TrajectorySample& s : samples) s.pose.p.z() += lift_high;
  return make_trajectory(std::move(samples));
}

}  // namespace

double rest_overlap(const Scene& scene, const Pose& X) {
  return overlap(surface_points(tissue_of(scene)), scene.instrument, X);
}

OfflineInput motion_in_scene(const Scene& scene, const std::filesystem::path& file,
                             const WindowSettings& settings) {
  const std::vector<Vec3> surface = surface_points(tissue_of(scene));
  const Trajectory recording = read_trajectory(file, LengthUnit::metre);
  const bool own = scene.trajectory && std::filesystem::equivalent(*scene.trajectory, file);
  constexpr double look = 4e-3;          // [s]
  constexpr double clearance = 0.05e-3;  // above the tissue, of an approach [m]
  OfflineInput input;
  input.motion = own ? mapped(scene, recording) : fitted(scene, surface, recording, settings);
  double first = input.motion.begin();
  // A recording that begins inside the tissue has no state to begin with: its next contact is the first.
  const auto touches = [&](double t) {
    return overlap(surface, scene.instrument, sample_at(input.motion, t)) > 0;
  };
  double out = first;
  while (out < input.motion.end() && touches(out)) out += look;
  if (out < input.motion.end()) first = out;
  while (first < input.motion.end() && !touches(first)) first += look;
  if (first >= input.motion.end() && out > input.motion.begin()) first = input.motion.begin();
  if (first >= input.motion.end()) throw InputError(file, 0, "", "never comes near the tissue");
  input.from = std::max(input.motion.begin(), first - settings.lead);
  input.to = std::min(input.motion.end(), input.from + settings.length);
  if (touches(input.from)) {
    Pose X = sample_at(input.motion, input.from);
    const double z = X.p.z();
    while (overlap(surface, scene.instrument, X) > -clearance) X.p.z() += clearance;
    input.approach = X.p.z() - z;
  }
  return input;
}

}  // namespace hapticd
