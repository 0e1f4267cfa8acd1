#include "physics/simulation/region/body_regions.h"

#include <utility>

#include "physics/tissue/surface.h"

namespace hapticd {
namespace {

constexpr std::size_t bytes_of_factor = 5;  // about, per entry of a square

std::size_t bytes_of(const BodyRegions::Far& far) {
  if (!far.tissue) return 0;
  const std::size_t rows = 3 * far.tissue->near_node.size();
  return sizeof(double) * static_cast<std::size_t>(far.tissue->stiffness->size()) +
         sizeof(int) * far.tissue->place.size() + far.tissue->tet.size() +
         (far.prepared ? bytes_of_factor * rows * rows : 0);
}

}  // namespace

std::shared_ptr<BodyRegions> begin_regions(const TissueModel& whole, const NearRegion& first) {
  auto of = std::make_shared<BodyRegions>();
  of->whole = std::make_shared<const TissueModel>(whole);
  of->regions = std::make_shared<NearRegions>(of->whole, first);
  of->far.resize(static_cast<std::size_t>(of->regions->count()));
  of->present = of->regions->nearest(first.centre);
  BodyRegions::Far& here = of->far[static_cast<std::size_t>(of->present)];
  here.tissue = of->regions->make(of->present, {});
  if (!here.tissue) return nullptr;
  of->at_surface.assign(of->far.size(), 0);
  const BoundarySurface surface(whole.mesh);
  for (const SurfaceFace& face : surface.faces())
    for (const int n : face.nodes)
      of->at_surface[static_cast<std::size_t>(of->regions->nearest(whole.mesh.nodes[n]))] = 1;
  of->bytes = bytes_of(here);
  of->first = of->in_use = here.tissue;
  return of;
}

void BodyRegions::take(int region, Far made) {
  const auto put = [&](int at, Far of) {
    bytes -= bytes_of(far[static_cast<std::size_t>(at)]);
    far[static_cast<std::size_t>(at)] = std::move(of);
    bytes += bytes_of(far[static_cast<std::size_t>(at)]);
  };
  put(region, std::move(made));
  while (bytes > most_bytes) {
    int farthest = -1;
    double most = 0;
    for (int r = 0; r < regions->count(); ++r) {
      const double distance = (regions->place(r) - regions->place(present)).norm();
      if (!far[static_cast<std::size_t>(r)].tissue || r == region || !(distance > most)) continue;
      farthest = r;
      most = distance;
    }
    if (farthest < 0) return;
    put(farthest, {});
  }
}

std::shared_ptr<BodyRegions> as_at_first(const BodyRegions& regions) {
  auto of = std::make_shared<BodyRegions>(regions);
  const NearRegion first{regions.regions->first(), regions.regions->radius()};
  of->regions = std::make_shared<NearRegions>(of->whole, first);  // a thread may be making with the other
  of->gone.clear();
  for (BodyRegions::Far& far : of->far) {
    far.prepared.reset();  // it may be in use there
    far.known = 0;
    if (far.made_with > 0) far = {};
  }
  of->present = of->regions->nearest(first.centre);
  of->in_use = of->first;
  of->far[static_cast<std::size_t>(of->present)] = {of->first};
  of->bytes = 0;
  for (const BodyRegions::Far& far : of->far) of->bytes += bytes_of(far);
  return of;
}

}  // namespace hapticd
