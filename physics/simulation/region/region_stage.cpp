#include "physics/simulation/region/region_stage.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

#include "physics/simulation/region/body_regions.h"
#include "physics/simulation/region/region_entry.h"
#include "physics/simulation/step/zone_selection.h"

namespace hapticd {
namespace {

constexpr double better = 0.25;     // of the spacing: what another region has to be nearer by
constexpr double most_ahead = 0.3;  // of the radius: how far ahead of the instrument a region may be
constexpr double looked_at = 2.5;   // of the spacing: within that, what was made is made anew if need be
constexpr int chord = 4;            // of the way that says where the instrument goes [steps]
constexpr int most_steps = 12;      // that it is looked ahead by

// What is far from one region, made on any thread.
class FarTissue final : public ReferenceFactor {
 public:
  FarTissue(const BodyRegions& of, int region) : regions_(of.regions), region_(region), gone_(of.gone) {}
  void make() override { far_ = regions_->make(region_, gone_); }
  void give(BodyRegions& to) {
    to.far[static_cast<std::size_t>(region_)] = {far_, far_ == nullptr, gone_.size(), gone_.size()};
  }

 private:
  std::shared_ptr<NearRegions> regions_;
  int region_;
  std::vector<int> gone_;
  std::shared_ptr<const CondensedTissue> far_;
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
    double least_unmade = std::numeric_limits<double>::infinity();
    for (int r = 0; r < regions.count(); ++r) {
      const BodyRegions::Far& far = of.far[static_cast<std::size_t>(r)];
      const double distance = (regions.place(r) - place->ahead).norm();
      if (distance < least_unmade &&
          (distance < looked_at * spacing ? !of.fresh(r) : !far.tissue && !far.empty)) {
        least_unmade = distance;
        unmade = r;
      }
      if (distance < least && far.tissue) {
        least = distance;
        entry = r;
      }
    }
    const auto of_body = static_cast<int>(b);
    const bool anew = of.far[static_cast<std::size_t>(entry)].tissue != of.in_use;
    if (!p.entry_under_way && (entry != of.present || anew)) {
      p.entry_under_way = true;
      p.steps = 0;
      const std::vector<int>& near = of.far[static_cast<std::size_t>(entry)].tissue->near_node;
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
                                           near});
      jobs.push_back({of_body, std::make_unique<RegionEntry>(body, entry, zone.nodes, c.settings), false,
                      JobKind::entry});
    }
    if (!p.making && unmade >= 0) {
      p.making = true;
      jobs.push_back({of_body, std::make_unique<FarTissue>(of, unmade), false, JobKind::far_tissue});
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
      if (!job.failed) static_cast<FarTissue&>(*job.reference).give(*body.regions);
      continue;
    }
    p.entry_under_way = false;
    p.last_steps = std::max(1, p.steps);
    if (job.failed) continue;
    static_cast<RegionEntry&>(*job.reference).enter(body);
    entered.push_back(job.body);
  }
  return entered;
}

}  // namespace hapticd
