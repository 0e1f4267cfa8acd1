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
constexpr double step_keep = 1.0;      // both of a factor that a step makes: its corner is dense, and the
constexpr double step_reach = 1.25;    // compliance gives what it leaves out as well
constexpr double lasting_reach = 3.0;  // … that of a factor that serves until the zone moves
constexpr std::size_t max_halo_nodes = 200;
constexpr int longest_lead = 30;      // steps: a reference factor in the making looks ahead by no more
constexpr double pose_spacing = 0.5;  // of a zone's way, in alarm distances
constexpr double most_poses = 8;      // … of them

double zone_radius(const Body& body, const ZoneRequest& r) {
  const double new_zone = r.made_elsewhere          ? zone_reach
                          : body.model.corotational ? step_reach
                                                    : lasting_reach;
  return new_zone * r.alarm_distance + (r.made_elsewhere ? body.edge : 0);
}

struct ZoneNode {
  double distance;  // [m]
  int node;
  bool needed;     // the present zone has to cover it
  int instrument;  // the nearest
};

// What is near instruments, by node of a body.
struct Nearness {
  explicit Nearness(std::size_t nodes)
      : gap(nodes, std::numeric_limits<double>::infinity()),
        of(nodes, 0),
        is_near(nodes, 0),
        around(nodes, 0) {}
  void meet(int node, int instrument, double distance) {
    const auto n = static_cast<std::size_t>(node);
    if (!(distance < gap[n])) return;
    gap[n] = distance;
    of[n] = instrument;
  }
  std::vector<double> gap;  // to where an instrument is, or will be; infinite where `around` is 0 [m]
  std::vector<int> of;      // that instrument
  std::vector<std::uint8_t> is_near;  // here and now
  std::vector<std::uint8_t> around;
};

template <class Visit>
void each_candidate(const Body& body, const ZoneRequest& r, const Visit& visit) {
  if (r.among.empty()) return body.model.each_node(visit);
  for (const int n : r.among) visit(n);
}

// Instrument i on its way.
void add_instrument(const Body& body, const ZoneRequest& r, int i, Nearness& near_by) {
  const Instrument& instrument = r.instruments[i];
  const Pose& X = r.X[i];
  // A reference factor made elsewhere comes into use when it is adopted, and until the next is: its zone is
  // along the instrument's way between then, and it is asked for as long before the present one ends. It
  // reaches an edge farther, for the corners of faces that only just come near.
  const auto pose_in = [&](int steps) {
    Pose there = X;
    if (r.made_elsewhere) there.p += r.motion[i].predictor().in(std::min(longest_lead, steps), r.last_steps);
    return there;
  };
  const int adopted = r.last_steps;
  const int replaced = 2 * adopted + rest_between_references + (adopted + 3) / 4;  // or later
  // Of an arc a little more than what its chord says.
  const double way = 1.6 * (pose_in(replaced).p - pose_in(adopted).p).norm();
  const int poses =
      static_cast<int>(std::min(most_poses, std::ceil(way / (pose_spacing * r.alarm_distance))));
  const double near = (r.made_elsewhere ? zone_keep : step_keep) * r.alarm_distance;

  const auto gap_below = [&](const PlacedInstrument& there, double bound, int n) {
    return there.near(body.state.x[n], bound) ? std::min(bound, there.gap(body.state.x[n]).distance) : bound;
  };
  const std::vector<Vec3>& x = body.state.x;
  const PlacedInstrument here(instrument, X), at_adopted(instrument, pose_in(adopted));
  // What is farther than that from the first place is far from all others.
  const double farthest =
      std::max(zone_radius(body, r), near) + std::max(way, (pose_in(adopted).p - X.p).norm());
  std::vector<int> around;
  each_candidate(body, r, [&](int n) {
    if (!at_adopted.near(x[n], farthest)) return;
    around.push_back(n);
    near_by.around[n] = 1;
    const double gap = at_adopted.gap(x[n]).distance;
    near_by.meet(n, i, gap);
    near_by.is_near[n] |= gap < near || (r.made_elsewhere && gap_below(here, near, n) < near);
  });
  for (int k = 1; r.made_elsewhere && k <= poses; ++k) {
    const PlacedInstrument on_the_way(instrument, pose_in(adopted + k * (replaced - adopted) / poses));
    for (const int n : around) near_by.meet(n, i, gap_below(on_the_way, near_by.gap[n], n));
  }
}

bool nearer(const ZoneNode& a, const ZoneNode& b) {
  return a.distance != b.distance ? a.distance < b.distance : a.node < b.node;
}

// Each instrument has a share of the zone, so that what one lies on leaves the other its tissue; what is left
// goes to the nearest.
void share_zone(std::vector<ZoneNode>& nearest_first, const InstrumentPoses& X) {
  const auto present = std::count(X.present.value.begin(), X.present.value.end(), true);
  if (present < 2) return;
  const int share = static_cast<int>(max_zone_nodes) / static_cast<int>(present);
  EachInstrument<int> taken;
  std::vector<ZoneNode> shares, rest;
  for (const ZoneNode& n : nearest_first) (taken[n.instrument]++ < share ? shares : rest).push_back(n);
  shares.insert(shares.end(), rest.begin(), rest.end());
  nearest_first = std::move(shares);
  std::sort(nearest_first.begin(), nearest_first.begin() + max_zone_nodes, nearer);
}

// What is near the instruments, nearest first.
std::vector<ZoneNode> nodes_at_instruments(const Body& body, const ZoneRequest& r) {
  const std::size_t count = body.state.x.size();
  Nearness near_by(count);
  for (int i = 0; i < r.instruments.count(); ++i)
    if (r.X.present[i]) add_instrument(body, r, i, near_by);
  std::vector<std::uint8_t> on_surface(count, 0), needed(count, 0);
  for (const SurfaceFace& face : body.surface.faces()) {
    for (const int n : face.nodes) on_surface[n] = 1;
    if (std::any_of(face.nodes.begin(), face.nodes.end(), [&](int n) { return near_by.is_near[n] != 0; }))
      for (const int n : face.nodes) needed[n] = 1;
  }
  const double reach = zone_radius(body, r);
  std::vector<ZoneNode> wanted;
  each_candidate(body, r, [&](int n) {
    // Of nodes alike near, those of the surface come first: they are what patches are made of.
    if (near_by.around[n] && (near_by.gap[n] < reach || (r.made_elsewhere && needed[n])))
      wanted.push_back({near_by.gap[n] + (on_surface[n] ? 0 : body.edge), n, needed[n] != 0, near_by.of[n]});
  });
  std::sort(wanted.begin(), wanted.end(), nearer);
  if (wanted.size() > max_zone_nodes) {
    share_zone(wanted, r.X);
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
  // What C will be asked for comes first: the corner ends with the zone's first nodes, and C costs least for
  // the corner's last.
  const std::vector<ZoneNode> near = r.X.any() ? nodes_at_instruments(body, r) : std::vector<ZoneNode>();
  const std::size_t inner = std::min(near.size(), max_zone_nodes);
  for (std::size_t k = 0; k < inner; ++k)
    if (near[k].needed) add(near[k].node, true);
  for (const int n : r.contact_nodes) add(n, true);
  for (std::size_t k = 0; k < inner; ++k) add(near[k].node, false);
  for (std::size_t k = inner; k < near.size(); ++k) zone.halo.push_back(near[k].node);
  return zone;
}

}  // namespace hapticd
