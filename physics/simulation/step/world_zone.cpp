// Which nodes a compliance keeps at hand, and the reference factors that it is counted from (compliance.h).
//
// A zone has what is near the instrument, with a reference factor made here; with one made elsewhere
// (`makes_references_`), what will be near when it comes into use. A step whose free motion is not believed
// makes its reference factor itself.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "physics/contact/placed_instrument.h"
#include "physics/simulation/world.h"

namespace hapticd {
namespace {

constexpr double zone_keep = 1.15;     // in alarm distances: every node this near must be in the zone
constexpr double zone_reach = 1.6;     // … and a new zone reaches this far
constexpr double lasting_reach = 3.0;  // … that of a factor that serves until the zone moves
constexpr std::size_t max_zone_nodes = 200;
constexpr std::size_t max_ring_nodes = 200;
constexpr int longest_lead = 30;            // steps: a reference factor in the making looks ahead by no more
constexpr int rest_between_references = 2;  // steps
constexpr double pose_spacing = 0.5;   // of a zone's way, in alarm distances
constexpr double most_poses = 8;       // … of them
constexpr double most_plausible = 2;   // edges that a free motion takes a node without being looked into

}  // namespace

std::vector<ReferenceJob> World::wanted_references() {
  std::vector<ReferenceJob> jobs;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.deformable || !body.reference_wanted || body.reference_under_way) continue;
    if (body.reference_steps < rest_between_references) continue;
    body.reference_wanted = false;
    if (!body.references) continue;
    std::unique_ptr<ReferenceFactor> reference = body.references->snapshot_reference(body.state);
    body.reference_under_way = true;
    body.reference_steps = 0;
    jobs.push_back({static_cast<int>(b), std::move(reference), false});
  }
  return jobs;
}

// After an interim problem, which needs the factor that there is. A new reference factor is of no use before
// an `update`, and a body that sleeps has none in this step: its reference factor waits until it wakes, or
// the interim problem of the step that wakes it would find no factor. What sleeps does not change, so the
// reference factor still fits.
void World::adopt_references(StepReport& report) {
  std::vector<ReferenceJob> waiting;
  for (ReferenceJob& job : made_) {
    Body& body = bodies_[job.body];
    if (body.asleep) {
      waiting.push_back(std::move(job));
      continue;
    }
    body.reference_under_way = false;
    body.last_reference_steps = body.reference_steps;
    body.reference_steps = 0;
    if (std::exchange(body.reference_outdated, false) || job.failed || !job.reference) continue;
    body.references->adopt_reference(std::move(job.reference), body.state);
    ahead_[job.body] = 0;
    ++report.references_adopted;
  }
  made_ = std::move(waiting);
}

std::vector<World::ZoneNode> World::zone_at_instrument(const Body& body, const Pose& X) const {
  // A reference factor made elsewhere comes into use when it is adopted, and until the next is: its zone is
  // along the instrument's way between then, and it is asked for as long before the present one ends. It
  // reaches an edge farther, for the corners of faces that only just come near.
  const auto pose_in = [&](int steps) {
    Pose there = X;
    if (makes_references_)
      there.p += pose_predictor_.in(std::min(longest_lead, steps), body.last_reference_steps);
    return there;
  };
  const int adopted = body.last_reference_steps;
  const int replaced = 2 * adopted + rest_between_references + (adopted + 3) / 4;  // or later
  // Of an arc a little more than what its chord says.
  const double way = 1.6 * (pose_in(replaced).p - pose_in(adopted).p).norm();
  const int poses =
      static_cast<int>(std::min(most_poses, std::ceil(way / (pose_spacing * settings_.alarm_distance))));
  const double new_zone = body.model.corotational || makes_references_ ? zone_reach : lasting_reach;
  const double reach = new_zone * settings_.alarm_distance + (makes_references_ ? body.edge : 0);
  const double near = zone_keep * settings_.alarm_distance;

  const auto gap_below = [&](const PlacedInstrument& there, double bound, int n) {
    return there.near(body.state.x[n], bound) ? std::min(bound, there.gap(body.state.x[n]).distance) : bound;
  };
  const std::vector<Vec3>& x = body.state.x;
  const PlacedInstrument here(*instrument_, X), at_adopted(*instrument_, pose_in(adopted));
  // What is farther than that from the first place is far from all others.
  const double farthest = std::max(reach, near) + std::max(way, (pose_in(adopted).p - X.p).norm());
  std::vector<int> around;
  std::vector<double> gap(x.size(), std::numeric_limits<double>::infinity());
  std::vector<std::uint8_t> is_near(x.size(), 0);
  for (int n = 0; n < body.model.node_count(); ++n) {
    if (!at_adopted.near(x[n], farthest)) continue;
    around.push_back(n);
    gap[n] = at_adopted.gap(x[n]).distance;
    is_near[n] = gap[n] < near || (makes_references_ && gap_below(here, near, n) < near);
  }
  std::vector<std::uint8_t> on_surface(x.size(), 0), needed(x.size(), 0);
  for (const SurfaceFace& face : body.surface.faces()) {
    for (const int n : face.nodes) on_surface[n] = 1;
    if (std::any_of(face.nodes.begin(), face.nodes.end(), [&](int n) { return is_near[n] != 0; }))
      for (const int n : face.nodes) needed[n] = 1;
  }
  for (int k = 1; makes_references_ && k <= poses; ++k) {
    const PlacedInstrument on_the_way(*instrument_, pose_in(adopted + k * (replaced - adopted) / poses));
    for (const int n : around) gap[n] = gap_below(on_the_way, gap[n], n);
  }
  std::vector<ZoneNode> wanted;
  for (const int n : around)
    // Of nodes alike near, those of the surface come first: they are what patches are made of.
    if (gap[n] < reach || (makes_references_ && needed[n]))
      wanted.push_back({gap[n] + (on_surface[n] ? 0 : body.edge), n, needed[n] != 0});
  std::sort(wanted.begin(), wanted.end(), [](const ZoneNode& a, const ZoneNode& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.node < b.node;
  });
  if (wanted.size() > max_zone_nodes) {
    // The halo begins with what is needed here and now, for an instrument that stops or turns back.
    std::stable_partition(wanted.begin() + max_zone_nodes, wanted.end(),
                          [](const ZoneNode& n) { return n.needed; });
    wanted.resize(std::min(wanted.size(), max_zone_nodes + max_ring_nodes));
  }
  return wanted;
}

void World::update_zone(int b, const InstrumentSample& sample, std::span<const int> nodes) {
  Body& body = bodies_[b];
  // Of the reference factor after the one in the making, the zone is chosen when that is adopted.
  if (makes_references_ && body.reference_under_way) return;
  // What is near now is where the instrument is no more when a reference factor made elsewhere comes into
  // use.
  const Pose* X = sample.present ? &sample.pose : nullptr;
  const bool covered = makes_references_ ? choose_zone(b, X, {}, nodes) : choose_zone(b, X, nodes, nodes);
  if (!covered) body.reference_wanted = true;
  if (!covered && !makes_references_) ahead_[b] = 0;
}

// Tells the compliance which nodes: `first`, and those near X (null: no instrument). Returns whether what it
// has covers those that are needed: so near, or named as such.
bool World::choose_zone(int b, const Pose* X, std::span<const int> first, std::span<const int> needed) {
  const Within collision(times(), StepPart::collision);
  Body& body = bodies_[b];
  // Nearest first: the patch of the nodes named first is the cheapest.
  std::vector<int> zone(first.begin(), first.end());
  std::vector<std::uint8_t> inside(body.state.x.size(), 0);
  for (int n : zone) inside[n] = 1;
  std::vector<int> must(needed.begin(), needed.end());
  const auto add = [&](int n, bool is_needed) {
    if (!inside[n]) zone.push_back(n);
    inside[n] = 1;
    if (is_needed) must.push_back(n);
  };
  std::vector<int> halo;
  if (X) {
    const std::vector<ZoneNode> near = zone_at_instrument(body, *X);
    for (std::size_t k = 0; k < near.size(); ++k)
      if (k < max_zone_nodes)
        add(near[k].node, near[k].needed);
      else
        halo.push_back(near[k].node);
  }
  for (const int n : contacts_.nodes_of(b)) add(n, true);
  const bool covered = body.compliance->zone_covers(must);
  // A zone for the next reference factor may follow the instrument at every step; one that is factored here
  // may not.
  if (!makes_references_ && covered) return true;
  body.compliance->move_zone(zone);
  if (body.references) body.references->move_halo(halo);
  return covered;
}

// Tissue let go springs back by an edge in a step, not by many. Where elements outside the zone have turned
// far since the reference factor, it has next to no stiffness against what they do, and what a step gets
// wrong of them the next gets wrong by several times as much: a reference factor that comes late lets the
// tissue burst. The half that a step leaves out is looked into where the step before took a node by an edge.
bool World::free_motion_plausible(Body& body) {
  if (!makes_references_) return true;
  const auto within = [&](double edges) {
    double largest = 0;
    for (int n = 0; n < body.model.node_count(); ++n)
      largest = std::max(largest, body.dx_free.segment<3>(3 * n).squaredNorm());
    return largest <= edges * edges * body.edge * body.edge;
  };
  if (body.forward_solved) {
    const double fast = body.edge / settings_.h;
    const bool slow = std::all_of(body.state.v.begin(), body.state.v.end(),
                                  [&](const Vec3& v) { return v.squaredNorm() < fast * fast; });
    if (slow && within(most_plausible)) return true;
    finish_free_motion(body, nullptr);
  }
  return within(most_plausible) || !body.references ||
         body.references->disagreement(body.state, body.dx_free) < 1;
}

// Of the present state, in this step, however long that takes.
void World::make_reference(int b, StepReport& report) {
  Body& body = bodies_[b];
  choose_zone(b, was_present_ ? &last_pose_ : nullptr, patch_nodes_of(b), {});
  if (!body.references) return;
  std::unique_ptr<ReferenceFactor> reference = body.references->snapshot_reference(body.state);
  reference->make();
  body.references->adopt_reference(std::move(reference), body.state);
  body.compliance->update(body.state);
  body.reference_outdated = body.reference_under_way;
  ++report.synchronous_references;
}

void World::cover(int b, const InstrumentSample& sample, std::span<const int> nodes, StepReport& report) {
  Body& body = bodies_[b];
  if (body.compliance->zone_covers(nodes)) return;
  // The instrument outran the zone within one step: factor again with the zone where it is now, or ask for
  // a reference factor there and meanwhile pay for a half solve per node.
  update_zone(b, sample, nodes);
  if (body.compliance->zone_covers(nodes))
    body.compliance->update(body.state);
  else
    for (const int n : nodes) report.uncovered_nodes += !body.compliance->zone_covers(std::span(&n, 1));
}

}  // namespace hapticd
