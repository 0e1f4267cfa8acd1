#include "physics/simulation/region/body_regions.h"

#include <utility>

namespace hapticd {

std::shared_ptr<BodyRegions> begin_regions(const TissueModel& whole, const NearRegion& first) {
  auto of = std::make_shared<BodyRegions>();
  of->whole = std::make_shared<const TissueModel>(whole);
  of->regions = std::make_shared<NearRegions>(of->whole, first);
  of->far.resize(static_cast<std::size_t>(of->regions->count()));
  of->present = of->regions->nearest(first.centre);
  BodyRegions::Far& here = of->far[static_cast<std::size_t>(of->present)];
  here.tissue = of->regions->make(of->present, {});
  if (!here.tissue) return nullptr;
  of->first = of->in_use = here.tissue;
  return of;
}

std::shared_ptr<BodyRegions> as_at_first(const BodyRegions& regions) {
  auto of = std::make_shared<BodyRegions>(regions);
  const NearRegion first{regions.regions->first(), regions.regions->radius()};
  of->regions = std::make_shared<NearRegions>(of->whole, first);  // a thread may be making with the other
  of->gone.clear();
  for (BodyRegions::Far& far : of->far)
    if (far.made_with > 0)
      far = {};
    else
      far.known = 0;
  of->present = of->regions->nearest(first.centre);
  of->in_use = of->first;
  of->far[static_cast<std::size_t>(of->present)] = {of->first};
  return of;
}

}  // namespace hapticd
