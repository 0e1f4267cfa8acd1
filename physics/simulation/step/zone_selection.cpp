#include "physics/simulation/step/zone_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/contact/placed_instrument.h"
#include "physics/simulation/step/reference_scheduling.h"

namespace hapticd {
namespace {

constexpr double zone_keep = 1.15;     // in alarm distances: every node this near must be in the zone
constexpr double zone_reach = 1.6;     // … and a new zone reaches this far
constexpr double lasting_reach = 3.0;  // … that of a factor that serves until the zone moves
constexpr std::size_t max_zone_nodes = 200;
constexpr std::size_t max_halo_nodes = 200;
constexpr int longest_lead = 30;      // steps: a reference factor in the making looks ahead by no more
constexpr double pose_spacing = 0.5;  // of a zone's way, in alarm distances
constexpr double most_poses = 8;      // … of them

struct ZoneNode {
  double distance;  // [m]
  int node;
  bool needed;  // the present zone has to cover it
};

// What is near the instrument at X, nearest first.
std::vector<ZoneNode> nodes_at_instrument(const Body& body, const ZoneRequest& r, const Pose& X) {
  // A reference factor made elsewhere comes into use when it is adopted, and until the next is: its zone is
  // along the instrument's way between then, and it is asked for as long before the present one ends. It
  // reaches an edge farther, for the corners of faces that only just come near.
  const auto pose_in = [&](int steps) {
    Pose there = X;
    if (r.made_elsewhere) there.p += r.predictor.in(std::min(longest_lead, steps), r.last_steps);
    return there;
  };
  const int adopted = r.last_steps;
  const int replaced = 2 * adopted + rest_between_references + (adopted + 3) / 4;  // or later
  // Of an arc a little more than what its chord says.
  const double way = 1.6 * (pose_in(replaced).p - pose_in(adopted).p).norm();
  const int poses =
      static_cast<int>(std::min(most_poses, std::ceil(way / (pose_spacing * r.alarm_distance))));
  const double new_zone = body.model.corotational || r.made_elsewhere ? zone_reach : lasting_reach;
  const double reach = new_zone * r.alarm_distance + (r.made_elsewhere ? body.edge : 0);
  const double near = zone_keep * r.alarm_distance;

  const auto gap_below = [&](const PlacedInstrument& there, double bound, int n) {
    return there.near(body.state.x[n], bound) ? std::min(bound, there.gap(body.state.x[n]).distance) : bound;
  };
  const std::vector<Vec3>& x = body.state.x;
  const PlacedInstrument here(r.instrument, X), at_adopted(r.instrument, pose_in(adopted));
  // What is farther than that from the first place is far from all others.
  const double farthest = std::max(reach, near) + std::max(way, (pose_in(adopted).p - X.p).norm());
  std::vector<int> around;
  std::vector<double> gap(x.size(), std::numeric_limits<double>::infinity());
  std::vector<std::uint8_t> is_near(x.size(), 0);
  for (int n = 0; n < body.model.node_count(); ++n) {
    if (!at_adopted.near(x[n], farthest)) continue;
    around.push_back(n);
    gap[n] = at_adopted.gap(x[n]).distance;
    is_near[n] = gap[n] < near || (r.made_elsewhere && gap_below(here, near, n) < near);
  }
  std::vector<std::uint8_t> on_surface(x.size(), 0), needed(x.size(), 0);
  for (const SurfaceFace& face : body.surface.faces()) {
    for (const int n : face.nodes) on_surface[n] = 1;
    if (std::any_of(face.nodes.begin(), face.nodes.end(), [&](int n) { return is_near[n] != 0; }))
      for (const int n : face.nodes) needed[n] = 1;
  }
  for (int k = 1; r.made_elsewhere && k <= poses; ++k) {
    const PlacedInstrument on_the_way(r.instrument, pose_in(adopted + k * (replaced - adopted) / poses));
    for (const int n : around) gap[n] = gap_below(on_the_way, gap[n], n);
  }
  std::vector<ZoneNode> wanted;
  for (const int n : around)
    // Of nodes alike near, those of the surface come first: they are what patches are made of.
    if (gap[n] < reach || (r.made_elsewhere && needed[n]))
      wanted.push_back({gap[n] + (on_surface[n] ? 0 : body.edge), n, needed[n] != 0});
  std::sort(wanted.begin(), wanted.end(), [](const ZoneNode& a, const ZoneNode& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.node < b.node;
  });
  if (wanted.size() > max_zone_nodes) {
    // The halo begins with what is needed here and now, for an instrument that stops or turns back.
    std::stable_partition(wanted.begin() + max_zone_nodes, wanted.end(),
                          [](const ZoneNode& n) { return n.needed; });
    wanted.resize(std::min(wanted.size(), max_zone_nodes + max_halo_nodes));
  }
  return wanted;
}

}  // namespace

Zone select_zone(const Body& body, const ZoneRequest& r) {
  Zone zone;
  zone.nodes.assign(r.first.begin(), r.first.end());
  zone.needed.assign(r.needed.begin(), r.needed.end());
  std::vector<std::uint8_t> inside(body.state.x.size(), 0);
  for (const int n : zone.nodes) inside[n] = 1;
  const auto add = [&](int n, bool is_needed) {
    if (!inside[n]) zone.nodes.push_back(n);
    inside[n] = 1;
    if (is_needed) zone.needed.push_back(n);
  };
  if (r.X) {
    const std::vector<ZoneNode> near = nodes_at_instrument(body, r, *r.X);
    for (std::size_t k = 0; k < near.size(); ++k)
      if (k < max_zone_nodes)
        add(near[k].node, near[k].needed);
      else
        zone.halo.push_back(near[k].node);
  }
  for (const int n : r.contact_nodes) add(n, true);
  return zone;
}

}  // namespace hapticd
