// Where everything of a multifrontal factorisation lies: made once for each order, so that factoring only
// computes.
//
//   front = [panel | contribution block]: panels are the columns of L and stay; a contribution block (the
//   update F22) lives until its parent has added it, in one of two stacks.
//
// Fronts are visited children first. A front's contribution block is written while its children's are still
// read, so fronts of even and odd depth use stacks of their own, both in one workspace. A child's rows go to
// its parent by chunks of eight of the parent's (front_kernels.h). Shapes: `panel`, `contribution block`
// index `FrontPlan::values` and `workspace` numbers; a panel has `stride` numbers per column, an odd multiple
// of eight, so that neighbouring columns do not meet in the cache.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "physics/compliance/factor/front_kernels.h"
#include "physics/compliance/factor/front_tree.h"
#include "physics/compliance/system_matrix.h"

namespace hapticd {

struct FrontPlan {
  struct Front {
    int first = 0;  // unknowns from here on: three for each node
    int width = 0;
    int size = 0;    // rows: the panel's own, then those below
    int height = 0;  // … rounded up to the kernels' multiple
    std::ptrdiff_t panel = 0;
    std::ptrdiff_t stride = 0;
    std::ptrdiff_t contribution = 0;  // of the row `contribution_origin(width)` and the column `width`
    std::ptrdiff_t contribution_stride = 0;
    int below = 0;  // first of its rows in FrontPlan::below
    // Ends of what belongs to the front; each begins where the front before it ends.
    int below_end = 0;
    int children_end = 0;
    int chunks_end = 0;
    int couplings_end = 0;
  };
  // An edge's block in the panel of the node that goes first.
  struct Coupling {
    int edge = 0;
    bool transposed = false;
    std::ptrdiff_t to = 0;
  };

  std::vector<int> order;  // nodes by place
  std::vector<int> place;  // of a node
  std::vector<Front> fronts;
  std::vector<int> below;  // unknowns
  std::vector<int> children;
  std::vector<FrontChunk> chunks;  // of a front's contribution block, by its parent's rows
  std::vector<Coupling> couplings;
  std::ptrdiff_t values = 0;
  std::ptrdiff_t workspace = 0;
  int widest = 0;
  int tallest = 0;
};

// `live_edges` as in SystemMatrix, empty: all; the last `zone` nodes of the order are the last fronts' last.
FrontPlan plan_fronts(const SystemMatrix& matrix, std::span<const int> order,
                      std::span<const std::uint8_t> live_edges, int zone,
                      ZoneFronts zone_fronts = ZoneFronts::one);

}  // namespace hapticd
