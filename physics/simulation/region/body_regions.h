// Near regions of a body that is simulated only where an instrument is (compliance/near_regions.h).
//
// The body's model and state (tissue.h) have the region it is in; here are all of its tissue and what of it
// is condensed for the other regions, as far as that is made. Units: m.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "physics/compliance/compliance.h"
#include "physics/compliance/near_regions.h"

namespace hapticd {

// A compliance of a region's near tissue, with a reference factor where its method has one, made before the
// region is entered.
struct PreparedRegion {
  std::unique_ptr<Compliance> compliance;
  std::vector<int> alive;  // near tetrahedra that it takes for alive
};

struct BodyRegions {
  // Of one region.
  struct Far {
    std::shared_ptr<const CondensedTissue> tissue;  // null: not made
    bool empty = false;                             // nothing is near, or nothing far: it cannot be entered
    std::size_t made_with = 0;                      // how many of `gone` it was made without
    std::size_t known = 0;  // … and how many since were looked at: none is far from it
    std::shared_ptr<PreparedRegion> prepared = {};  // null: not made, or in use
  };

  std::shared_ptr<const TissueModel> whole;       // nothing of it is condensed, nothing of it gone
  std::shared_ptr<NearRegions> regions;           // one thread at a time makes
  std::vector<Far> far;                           // per region
  int present = 0;                                // region that is simulated …
  std::shared_ptr<const CondensedTissue> in_use;  // … and what was made for it then
  std::vector<std::uint8_t> at_surface;  // regions that are the nearest to a node of the first surface
  std::shared_ptr<const CondensedTissue> first;  // of the first region, with nothing gone
  std::vector<int> gone;                         // tetrahedra that went, in order

  std::size_t bytes = 0;  // of what is made
  static constexpr std::size_t most_bytes = std::size_t{3} << 29;

  // What was made of a region. What is farthest from the present one goes where the memory ends.
  void take(int region, Far made);

  // What is far from the region has lost nothing since it was made.
  bool fresh(int region) {
    Far& of = far[static_cast<std::size_t>(region)];
    for (; of.known < gone.size(); ++of.known)
      if (of.tissue && of.tissue->tet[static_cast<std::size_t>(gone[of.known])]) return false;
    return of.tissue != nullptr || of.empty;
  }
};

// The first region's far tissue is made here. Null: nothing of the body is far from it.
std::shared_ptr<BodyRegions> begin_regions(const TissueModel& whole, const NearRegion& first);

// The same body with nothing gone: what was made of it without the loss of anything is kept.
std::shared_ptr<BodyRegions> as_at_first(const BodyRegions& regions);

}  // namespace hapticd
