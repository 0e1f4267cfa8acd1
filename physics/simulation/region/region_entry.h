// How a body that is simulated in one near region comes to be simulated in another.
//
//   prepared on any thread   K_qq of the nodes q that are not simulated yet; and the region's compliance with
//   a
//                            reference factor, where none was made before or too much went since
//   entered between steps    K_qq u_q = f_q − K_qo u_o;   the same without f for v
//
// What was condensed stood where its boundary took it, linear and static: so q begins there. What is left
// behind goes back to the mesh's shape. Velocities are scaled where the change would make energy, which it
// does by as much as far tissue is not linear. Units: SI. Errors: `make` throws std::runtime_error.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>
#include <memory>
#include <vector>

#include "physics/simulation/body.h"
#include "physics/simulation/region/body_regions.h"
#include "physics/simulation/world_settings.h"

namespace hapticd {

// The region's compliance at the mesh's shape, of the near tetrahedra that are alive. zone: nodes of the
// body, nearest first.
std::shared_ptr<PreparedRegion> prepare_region(const TissueModel& whole, const CondensedTissue& far,
                                               std::vector<int> alive, std::span<const int> zone,
                                               const WorldSettings& settings);

class RegionEntry final : public ReferenceFactor {
 public:
  // zone: nodes that the compliance is to have at hand, nearest first; h: of the step. Pre: the region's far
  // tissue is made.
  RegionEntry(Body& body, int region, std::vector<int> zone, const WorldSettings& settings);

  void make() override;

  int region() const noexcept { return region_; }

  // Between steps, once, after `make`. Post: the body has a factor of this region after the next update.
  void enter(Body& body);

 private:
  void condense_new_nodes();

  int region_;
  std::shared_ptr<const TissueModel> whole_;
  std::shared_ptr<const CondensedTissue> far_;
  std::vector<int> tet_;        // near, alive when this was asked for
  std::vector<Mat3> rotation_;  // of each of them
  std::vector<double> left_;
  std::vector<std::uint8_t> new_;  // per near node: it is not simulated yet
  std::vector<int> zone_;
  const WorldSettings settings_;

  std::unique_ptr<Submodel> part_;
  std::shared_ptr<PreparedRegion> prepared_;
  std::vector<int> new_node_, old_node_;  // of the body
  Eigen::LLT<MatX> K_qq_;
  Eigen::SparseMatrix<double> K_qo_;
  VecX f_q_;
};

}  // namespace hapticd
