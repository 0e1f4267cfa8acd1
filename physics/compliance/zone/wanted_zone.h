// The zone and the halo wanted of the next reference factor.
//
// Only free nodes in use are in it, each once; a new node of a cut joins the zone that it came from. Errors:
// std::invalid_argument for a node that the model has not.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/compliance/growing_order.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

class WantedZone {
 public:
  explicit WantedZone(const TissueModel& model) : model_(model), wanted_(model.node_count(), 0) {}

  void move(std::span<const int> nodes);  // and there is no halo
  void move_halo(std::span<const int> nodes);
  void follow_cut(const GrowingOrder& order, int first_new);

  bool has(int node) const noexcept { return wanted_[node] != 0; }
  int zone_size() const noexcept { return static_cast<int>(zone_.size()); }
  std::vector<int> zone_and_halo() const;

 private:
  const TissueModel& model_;
  std::vector<int> zone_, halo_;
  std::vector<std::uint8_t> wanted_;  // per node: of the zone
};

}  // namespace hapticd
