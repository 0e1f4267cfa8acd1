#include "physics/simulation/region/region_stage.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>

#include "physics/simulation/region/body_regions.h"
#include "physics/simulation/region/region_entry.h"
#include "physics/simulation/step/zone_selection.h"

namespace hapticd {
namespace {

constexpr double better = 0.25;     // of the spacing: what another region has to be nearer by
constexpr double most_ahead = 0.3;  // of the radius: how far ahead of the instrument a region may be
constexpr double looked_at = 2.5;   // of the spacing: within that, what was made is made anew if need be
constexpr double made_within = 2;   // of the radius: beyond, none is made before the instrument comes nearer
constexpr int chord = 4;            // of the way that says where the instrument goes [steps]
constexpr int most_steps = 12;      // that it is looked ahead by

// What is far from one region, and a compliance of what is near, made on any thread.
class FarTissue final : public ReferenceFactor {
 public:
  FarTissue(const Body& body, int region, const WorldSettings& settings)
      : whole_(body.regions->whole),
        regions_(body.regions->regions),
        region_(region),
        gone_(body.regions->gone),
        edge_(body.edge),
        settings_(settings) {
    on_surface_.assign(whole_->mesh.nodes.size(), 0);
    for (const SurfaceFace& face : body.surface.faces())
      for (const int n : face.nodes) on_surface_[static_cast<std::size_t>(n)] = 1;
  }
  void make() override {
    far_ = regions_->make(region_, gone_);
    if (far_) prepared_ = prepare_region(*whole_, *far_, far_->near_tet, zone(), settings_);
  }
  // failed: the region is not asked for again.
  void give(BodyRegions& to, bool failed) {
    if (failed) far_.reset();
    to.take(region_, {far_, far_ == nullptr, gone_.size(), gone_.size(), std::move(prepared_)});
  }

 private:
  // What is nearest to the place; of nodes alike near, those of the surface come first.
  std::vector<int> zone() const {
    std::vector<std::pair<double, int>> nearest;
    for (const int n : far_->near_node)
      nearest.emplace_back((whole_->mesh.nodes[n] - regions_->place(region_)).norm() +
                               (on_surface_[static_cast<std::size_t>(n)] ? 0 : edge_),
                           n);
    std::sort(nearest.begin(), nearest.end());
    nearest.resize(std::min(nearest.size(), max_zone_nodes));
    std::vector<int> nodes;
    for (const auto& [distance, n] : nearest) nodes.push_back(n);
    return nodes;
  }

  std::shared_ptr<const TissueModel> whole_;
  std::shared_ptr<NearRegions> regions_;
  int region_;
  std::vector<int> gone_;
  double edge_;
  const WorldSettings settings_;
  std::vector<std::uint8_t> on_surface_;
  std::shared_ptr<const CondensedTissue> far_;
  std::shared_ptr<PreparedRegion> prepared_;
};

struct Place {
  Vec3 here, ahead;  // in the rest shape [m]
};

// By the node that is nearest to the tip.
std::optional<Place> place_of(const StepContext& c, const Body& body, int steps) {
  for (int i = 0; i < static_cast<int>(c.instruments.size()); ++i) {
    if (!c.motion[i].present()) continue;
    const Instrument& instrument = c.instruments[static_cast<std::size_t>(i)];
    const Vec3 tip = c.motion[i].pose().to_world(instrument.primitives[instrument.tip].placement.p);
    int nearest = -1;
    double least = std::numeric_limits<double>::infinity();
    body.model.each_node([&](int n) {
      const double d = (body.state.x[n] - tip).squaredNorm();
      if (body.state.live_tets_of_node[n] == 0 || !(d < least)) return;
      least = d;
      nearest = n;
    });
    Place place;
    place.here = tip;
    if (nearest >= 0 && least < body.regions->regions->radius() * body.regions->regions->radius())
      place.here = body.rest()[nearest];
    Vec3 way = c.motion[i].predictor().in(std::min(steps, most_steps), chord);
    const double most = most_ahead * body.regions->regions->radius();
    if (way.norm() > most) way *= most / way.norm();
    place.ahead = place.here + way;
    return place;
  }
  return {};
}

}  // namespace

void RegionStage::follow(Bodies& bodies, const std::vector<std::vector<int>>& gone) {
  for (std::size_t b = 0; b < bodies.size(); ++b)
    if (bodies[b].regions)
      bodies[b].regions->gone.insert(bodies[b].regions->gone.end(), gone[b].begin(), gone[b].end());
}

int RegionStage::make(Bodies& bodies, const WorldSettings& settings,
                      const std::function<bool(int made)>& enough) {
  int made = 0;
  for (Body& body : bodies) {
    if (!body.regions) continue;
    BodyRegions& of = *body.regions;
    const Vec3 from = of.regions->place(of.present);
    std::vector<int> nearest_first(of.far.size());
    std::iota(nearest_first.begin(), nearest_first.end(), 0);
    std::stable_sort(nearest_first.begin(), nearest_first.end(), [&](int a, int b) {
      return (of.regions->place(a) - from).squaredNorm() < (of.regions->place(b) - from).squaredNorm();
    });
    for (const int region : nearest_first) {
      if (of.far[static_cast<std::size_t>(region)].tissue || !of.at_surface[static_cast<std::size_t>(region)])
        continue;
      if (enough(made) || of.bytes > BodyRegions::most_bytes) return made;
      FarTissue far(body, region, settings);
      bool failed = false;
      try {
        far.make();
      } catch (const std::runtime_error&) {
        failed = true;
      }
      far.give(of, failed);
      ++made;
    }
  }
  return made;
}

void RegionStage::wanted(const StepContext& c, std::vector<ReferenceJob>& jobs) {
  for (std::size_t b = 0; b < c.bodies.size(); ++b) {
    Body& body = c.bodies[b];
    if (!body.regions) continue;
    Progress& p = progress_[b];
    ++p.steps;
    const std::optional<Place> place = place_of(c, body, p.last_steps + 2);
    if (!place) continue;
    BodyRegions& of = *body.regions;
    const NearRegions& regions = *of.regions;
    const double spacing = regions.spacing();
    int entry = of.present, unmade = -1;
    double least = (regions.place(of.present) - place->ahead).norm() - better * spacing;
    double least_unmade = made_within * regions.radius();
    for (int r = 0; r < regions.count(); ++r) {
      const BodyRegions::Far& far = of.far[static_cast<std::size_t>(r)];
      const double distance = (regions.place(r) - place->ahead).norm();
      if (distance < least_unmade &&
          (distance < looked_at * spacing
               ? !of.fresh(r)
               : !far.tissue && !far.empty && of.at_surface[static_cast<std::size_t>(r)])) {
        least_unmade = distance;
        unmade = r;
      }
      if (distance < least && far.tissue) {
        least = distance;
        entry = r;
      }
    }
    const auto of_body = static_cast<int>(b);
    const std::shared_ptr<const CondensedTissue>& tissue = of.far[static_cast<std::size_t>(entry)].tissue;
    const bool anew = tissue && tissue != of.in_use;
    if (!p.entry_under_way && (entry != of.present || anew)) {
      p.entry_under_way = true;
      p.steps = 0;
      const bool elsewhere = body.references != nullptr;
      const Zone zone = select_zone(body, {c.instruments,
                                           c.motion,
                                           c.motion.poses(),
                                           c.settings.alarm_distance,
                                           elsewhere,
                                           p.last_steps,
                                           {},
                                           {},
                                           c.contacts.nodes_of(of_body),
                                           tissue->near_node});
      jobs.push_back({of_body, std::make_unique<RegionEntry>(body, entry, zone.nodes, c.settings), false,
                      JobKind::entry});
    }
    if (!p.making && unmade >= 0) {
      p.making = true;
      jobs.push_back(
          {of_body, std::make_unique<FarTissue>(body, unmade, c.settings), false, JobKind::far_tissue});
    }
  }
}

std::vector<int> RegionStage::take_over(Bodies& bodies) {
  std::vector<int> entered;
  for (ReferenceJob& job : std::exchange(made_, {})) {
    Body& body = bodies[static_cast<std::size_t>(job.body)];
    Progress& p = progress_[static_cast<std::size_t>(job.body)];
    if (job.kind == JobKind::far_tissue) {
      p.making = false;
      static_cast<FarTissue&>(*job.reference).give(*body.regions, job.failed);
      continue;
    }
    p.entry_under_way = false;
    p.last_steps = std::max(1, p.steps);
    if (job.failed) {
      const int region = static_cast<RegionEntry&>(*job.reference).region();
      body.regions->take(region,
                         {nullptr, true, body.regions->gone.size(), body.regions->gone.size(), nullptr});
      continue;
    }
    static_cast<RegionEntry&>(*job.reference).enter(body);
    entered.push_back(job.body);
  }
  return entered;
}

}  // namespace hapticd
