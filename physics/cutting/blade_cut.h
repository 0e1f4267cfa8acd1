// One cut of a blade: elements that its swept surface crosses are split, and faces open along it.
//
//   edges that the surface crosses are split where it does; their new nodes are *on* the surface. An end is
//   put on it instead where the crossing is within a quarter of the edge from it, where the edge is shorter
//   than `least_edge`, or where a half would be below the quality bound. Nodes never move: the surface does.
//   Then no element has nodes on both sides of the surface, and a face that has all nodes on it, between
//   elements of different sides, opens.
//
// Splitting edges keeps the mesh conforming in all cases, and each split leaves one edge less to look at.
// The nodes on the surface are remembered: a cut ends anywhere in an element, and the next strip goes on
// from there. Elements with all nodes on the surface go with a neighbour on its positive side, or else with
// the negative one.
// Units: m, rest shape. Cost: what is near the strip. Guarantee: no allocation after construction. Errors:
// CutStatus; with `no_room` nothing opened, and `change` has the edges that were split until then.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "physics/cutting/cut_workspace.h"
#include "physics/cutting/rest_grid.h"
#include "physics/cutting/swept_surface.h"
#include "physics/cutting/topology_change.h"

namespace hapticd {

struct CutLimits {
  double quality = 0.05;     // of a split element (mesh_quality.h); a poorer one is not made poorer
  double snap = 0.25;        // part of an edge within which its end is taken as on the surface
  double least_edge = 0.25;  // part of the first mesh's mean edge below which no edge is split
};

class BladeCut {
 public:
  explicit BladeCut(const TissueModel& model, const CutLimits& limits = {});

  // Forgets the cut so far: what follows is another one.
  void start() noexcept;

  // Extends the cut by this strip. `nothing`: no edge was crossed.
  [[nodiscard]] CutStatus extend(TissueModel& model, TissueState& state, CutWorkspace& work,
                                 const SweptSurface& strip, TopologyChange& change) noexcept;

  bool on_surface(int node) const noexcept { return on_[node] != 0; }

 private:
  using Edge = std::pair<int, int>;

  void find_crossed(const TissueModel& model, const TissueState& state, const SweptSurface& strip) noexcept;
  void snap_ends() noexcept;
  CutStatus split_edges(TissueModel& model, TissueState& state, CutWorkspace& work,
                        TopologyChange& change) noexcept;
  void find_faces(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                  const SweptSurface& strip) noexcept;
  int side_of(const TissueModel& model, const TissueState& state, int tet,
              const SweptSurface& strip) noexcept;
  int side_of_cluster(const TissueModel& model, const TissueState& state, int tet,
                      const SweptSurface& strip) noexcept;
  bool all_on(const TissueModel& model, int tet) const noexcept;
  void put_on(int node) noexcept;

  struct Crossed {
    int a, b;
    double s;
    double length;
  };

  CutLimits limits_;
  RestGrid grid_;
  std::vector<std::uint8_t> on_;       // per node
  std::vector<std::int8_t> side_;      // per element: where a face of it was judged; 0: none was
  std::vector<int> on_nodes_, sided_;  // those that have them, for start()

  // Scratch.
  std::vector<int> near_, faces_, cluster_, star_, new_on_;
  std::vector<Edge> edges_;
  std::vector<Crossed> crossed_;
};

}  // namespace hapticd
