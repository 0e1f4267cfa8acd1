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

Trajectory mapped(const DeviceSettings& device, const Trajectory& recording) {
  std::vector<TrajectorySample> samples = recording.samples;
  for (TrajectorySample& s : samples) s.pose = to_scene(device, s.pose);
  return make_trajectory(std::move(samples));
}

// How high above X the instrument is clear of the tissue at rest; 0: it is at X [m].
double clear_above(const std::vector<Vec3>& surface, const Instrument& instrument, Pose X) {
  constexpr double clearance = 0.05e-3;  // [m]
  if (overlap(surface, instrument, X) <= 0) return 0;
  const double z = X.p.z();
  while (overlap(surface, instrument, X) > -clearance) X.p.z() += clearance;
  return X.p.z() - z;
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
  const double scale =
      std::min(scene.first().device.position_scale, settings.reach / std::max(sideways, 1e-9));
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
      deepest = std::max(deepest,
                         overlap(surface, scene.first().shape, {s.pose.p + lift * Vec3::UnitZ(), s.pose.q}));
    (deepest > settings.depth ? lift_low : lift_high) = lift;
  }
  for (TrajectorySample& s : samples) s.pose.p.z() += lift_high;
  return make_trajectory(std::move(samples));
}

}  // namespace

double rest_overlap(const Scene& scene, const Pose& X) {
  return overlap(surface_points(tissue_of(scene)), scene.first().shape, X);
}

OfflineInput motion_in_scene(const Scene& scene, const std::filesystem::path& file,
                             const WindowSettings& settings) {
  const std::vector<Vec3> surface = surface_points(tissue_of(scene));
  const Trajectory recording = read_trajectory(file, LengthUnit::metre);
  const bool own = scene.first().trajectory && std::filesystem::equivalent(*scene.first().trajectory, file);
  constexpr double look = 4e-3;  // [s]
  OfflineInput input;
  const Trajectory motion =
      own ? mapped(scene.first().device, recording) : fitted(scene, surface, recording, settings);
  input.motion = motion;
  double first = motion.begin();
  // A recording that begins inside the tissue has no state to begin with: its next contact is the first.
  const auto touches = [&](double t) {
    return overlap(surface, scene.first().shape, sample_at(motion, t)) > 0;
  };
  double out = first;
  while (out < motion.end() && touches(out)) out += look;
  if (out < motion.end()) first = out;
  while (first < motion.end() && !touches(first)) first += look;
  if (first >= motion.end() && out > motion.begin()) first = motion.begin();
  if (first >= motion.end()) throw InputError(file, 0, "", "never comes near the tissue");
  input.from = std::max(motion.begin(), first - settings.lead);
  input.to = std::min(motion.end(), input.from + settings.length);
  input.approach = clear_above(surface, scene.first().shape, sample_at(motion, input.from));
  return input;
}

OfflineInput motions_in_window(const Scene& scene, const ForceWindow& window) {
  constexpr double settle = 0.3;  // [s]
  const std::vector<Vec3> surface = surface_points(tissue_of(scene));
  OfflineInput input;
  input.from = window.from;
  input.to = window.to;
  input.settle = settle;
  input.leads_in = window.history;
  if (window.removals) input.pedals = Pedals::suction;
  for (std::size_t k = 0; k < scene.instruments.size(); ++k) {
    const SceneInstrument& held = scene.instruments[k];
    if (!held.trajectory)
      throw InputError(scene.file, 0, "trajectory",
                       "'" + held.name + "' has none: each instrument needs its own");
    const Trajectory motion = mapped(held.device, read_trajectory(*held.trajectory, LengthUnit::metre));
    if (motion.begin() > window.from || motion.end() < window.to)
      throw InputError(*held.trajectory, 0, "", "does not cover the window '" + window.name + "'");
    const int i = static_cast<int>(k);
    input.motion[i] = motion;
    if (!window.history) input.approach[i] = clear_above(surface, held.shape, sample_at(motion, window.from));
  }
  return input;
}

}  // namespace hapticd
