#include "server/plan/plan_stroke.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "haptic/device.h"
#include "physics/simulation/patch.h"
#include "physics/tissue/surface.h"
#include "server/record/trajectory_reader.h"

namespace hapticd {
namespace {

constexpr double tick = 1e-3;              // [s]
constexpr double looked_at = 10e-3;        // of the trajectory, when the window is sought [s]
constexpr double approach_step = 0.25;     // in alarm distances
constexpr std::size_t most_approach = 30;  // poses
constexpr double begins_inside = 0.7;      // of its score has a window that begins in contact
constexpr double hand_speed = 0.1;         // of a made-up press, in the device's space [m/s]
constexpr double most_points = 3000;       // of a body's surface, for gaps

// Samples of a body's surface, at rest, no farther apart than those of contact where that is not too many.
std::vector<Vec3> surface_points(const SceneBody& body, double spacing) {
  const BoundarySurface surface(body.mesh);
  const auto& x = body.mesh.nodes;
  double area = 0;
  for (const SurfaceFace& f : surface.faces())
    area += 0.5 * (x[f.nodes[1]] - x[f.nodes[0]]).cross(x[f.nodes[2]] - x[f.nodes[0]]).norm();
  spacing = std::max(spacing, std::sqrt(area / most_points));
  std::vector<Vec3> points;
  for (const SurfaceFace& f : surface.faces()) {
    const Vec3 &p = x[f.nodes[0]], &q = x[f.nodes[1]], &r = x[f.nodes[2]];
    for (const auto& w : sample_weights(subdivisions(p, q, r, spacing)))
      points.push_back(w[0] * p + w[1] * q + w[2] * r);
  }
  return points;
}

bool deforms(const SceneBody& b) { return b.kind == BodyKind::deformable && b.simulated; }

double least_gap(const Instrument& instrument, const Pose& X, const std::vector<Vec3>& points) {
  double least = std::numeric_limits<double>::infinity();
  for (const Vec3& p : points) least = std::min(least, gap_at(instrument, X, p).distance);
  return least;
}

// Where a tip first destroys tissue: what it does from there on makes no sense without that.
double uncut_until(const Scene& scene, const Trajectory& device) {
  constexpr std::uint32_t phaco = 1;
  if (scene.first().removal.rate > 0)
    for (const TrajectorySample& s : device.samples)
      if (s.buttons & phaco) return s.t;
  return device.end();
}

template <typename PoseAt>
std::vector<Pose> thinned(double from, double to, double step, const PoseAt& pose_at, double alarm_distance) {
  std::vector<Pose> out;
  for (double t = from; t < to; t += step) {
    const Pose X = pose_at(t);
    if (out.empty() || (X.p - out.back().p).norm() > approach_step * alarm_distance) out.push_back(X);
  }
  return out;
}

// Without poses where it touches nothing before it cuts.
PilotStroke from_trajectory(const Scene& scene, double seconds) {
  const SceneInstrument& held = scene.first();
  const Trajectory device = read_trajectory(*held.trajectory, LengthUnit::metre);
  const double last = uncut_until(scene, device);
  std::vector<Vec3> points;
  for (const SceneBody& b : scene.bodies)
    if (deforms(b)) {
      const std::vector<Vec3> more = surface_points(b, scene.sample_spacing);
      points.insert(points.end(), more.begin(), more.end());
    }
  const auto pose_at = [&](double t) { return to_scene(held.device, sample_at(device, t)); };

  const auto looks = static_cast<std::size_t>(std::max(1.0, (last - device.begin()) / looked_at));
  std::vector<double> gap(looks), depth(looks);
  for (std::size_t i = 0; i < looks; ++i) {
    gap[i] = least_gap(held.shape, pose_at(device.begin() + looked_at * static_cast<double>(i)), points);
    depth[i] = std::max(0.0, -gap[i]);
  }
  if (*std::max_element(depth.begin(), depth.end()) <= 0) return {};
  // How far it has gone in contact.
  std::vector<double> way(looks, 0);
  for (std::size_t i = 1; i < looks; ++i) {
    const double t = device.begin() + looked_at * static_cast<double>(i);
    way[i] = way[i - 1] + (depth[i] > 0 ? (pose_at(t).p - pose_at(t - looked_at).p).norm() : 0);
  }
  const auto window = std::min(looks, static_cast<std::size_t>(std::max(1.0, seconds / looked_at)));
  std::size_t best = 0;
  double best_score = -1;
  for (std::size_t i = 0; i + window <= looks; ++i) {
    const auto [low, high] = std::minmax_element(depth.begin() + static_cast<std::ptrdiff_t>(i),
                                                 depth.begin() + static_cast<std::ptrdiff_t>(i + window));
    const bool clear = gap[i] > scene.alarm_distance || (way[i] == 0 && depth[i] == 0);
    const double score =
        (clear ? 1 : begins_inside) * (*high + (*high - *low) + 0.5 * (way[i + window - 1] - way[i]));
    if (score > best_score + 1e-12) best = i, best_score = score;
  }
  PilotStroke stroke;
  const double begin = device.begin() + looked_at * static_cast<double>(best);
  // From the trajectory's begin, or where that is too far from where it last was clear of everything. Not
  // from where it last was free: an instrument that has bent a thin body far aside is clear of where that was
  // at rest.
  const bool untouched = way[best] == 0 && depth[best] == 0;
  if (!untouched)
    stroke.approach = thinned(device.begin(), begin, 1 / scene.rate, pose_at, scene.alarm_distance);
  if (stroke.approach.size() > most_approach) {
    std::size_t clear = best;
    while (clear > 0 && depth[clear] > 0) --clear;
    stroke.approach = thinned(device.begin() + looked_at * static_cast<double>(clear), begin, 1 / scene.rate,
                              pose_at, scene.alarm_distance);
  }
  const double end = std::min(begin + seconds, last);
  for (double t = begin; t < end; t += tick) stroke.pose.push_back(pose_at(t));
  char text[256];
  std::snprintf(text, sizeof text, "%.2f to %.2f s of %s", begin, end, held.trajectory->filename().c_str());
  stroke.text = text;
  return stroke;
}

// Adds a straight way from the last pose.
void go(PilotStroke& stroke, const Vec3& way, double speed) {
  const Pose from = stroke.pose.back();
  const int ticks = std::max(1, static_cast<int>(std::ceil(way.norm() / (speed * tick))));
  for (int i = 1; i <= ticks; ++i) stroke.pose.push_back({from.p + way * i / ticks, from.q});
}

PilotStroke made_up(const Scene& scene, double seconds) {
  const SceneInstrument& held = scene.first();
  const double speed = hand_speed * held.device.position_scale;
  const Primitive& tip = held.shape.primitives[held.shape.tip];
  const double radius = tip.radius > 0 ? tip.radius : scene.alarm_distance;
  const Pose origin = to_scene(held.device, Pose{});
  int reached = 0;
  for (const SceneBody& b : scene.bodies) reached += deforms(b) && beyond_reach(scene, b) < 0;
  PilotStroke stroke;
  stroke.text = "a made-up press";
  for (const SceneBody& b : scene.bodies) {
    if (!deforms(b) || beyond_reach(scene, b) >= 0) continue;
    const std::vector<Vec3> points = surface_points(b, scene.sample_spacing);
    const Vec3 nearest = *std::min_element(points.begin(), points.end(), [&](const Vec3& x, const Vec3& y) {
      return (x - origin.p).squaredNorm() < (y - origin.p).squaredNorm();
    });
    const Vec3 way = (nearest - origin.p).stableNormalized();
    // To the first touch: no step is longer than the gap, so nothing is passed.
    Pose X = origin;
    double gap = least_gap(held.shape, X, points);
    for (int i = 0; i < 20 && gap < 0; ++i) {
      X.p -= radius * way;
      gap = least_gap(held.shape, X, points);
    }
    for (int i = 0; i < 200 && gap > 0.01 * radius; ++i) {
      X.p += gap * way;
      gap = least_gap(held.shape, X, points);
    }
    const double before = 0.2 * radius;
    stroke.pose.push_back({X.p - before * way, X.q});
    const auto first = stroke.pose.size();
    go(stroke, (before + 0.5 * radius) * way, speed);
    const auto share = first + static_cast<std::size_t>(seconds / tick / std::max(1, reached));
    const Vec3 sideways = way.unitOrthogonal();
    while (stroke.pose.size() < share) {
      go(stroke, radius * sideways, speed);
      go(stroke, -radius * sideways, speed);
    }
    stroke.pose.resize(std::max(share, first + 1));
  }
  return stroke;
}

}  // namespace

PilotStroke pilot_stroke(const Scene& scene, double seconds) {
  PilotStroke stroke;
  if (scene.first().trajectory) stroke = from_trajectory(scene, seconds);
  return stroke.pose.empty() ? made_up(scene, seconds) : stroke;
}

double beyond_reach(const Scene& scene, const SceneBody& body) {
  const SceneInstrument& held = scene.first();
  const Vec3 centre = to_scene(held.device, Pose{}).p;
  double tool = 0;  // from the instrument's origin to its farthest point
  for (const Primitive& p : held.shape.primitives) {
    double own = p.radius + p.half_length;
    for (const Vec3& v : p.vertices) own = std::max(own, v.norm());
    tool = std::max(tool, p.placement.p.norm() + own);
  }
  double nearest = std::numeric_limits<double>::infinity();
  for (const Vec3& x : body.mesh.nodes) nearest = std::min(nearest, (x - centre).norm());
  return nearest - held.device.workspace_radius * held.device.position_scale - tool - scene.alarm_distance;
}

}  // namespace hapticd
