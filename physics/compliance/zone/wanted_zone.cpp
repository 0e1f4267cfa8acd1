#include "physics/compliance/zone/wanted_zone.h"

#include <stdexcept>
#include <string>

namespace hapticd {

void WantedZone::move(std::span<const int> nodes) {
  std::vector<std::uint8_t> wanted(model_.node_count(), 0);
  std::vector<int> zone;
  for (const int n : nodes) {
    if (n < 0 || n >= model_.node_count())
      throw std::invalid_argument("the zone names node " + std::to_string(n));
    if (model_.fixed[n] || wanted[n] || n >= model_.nodes_in_use) continue;
    wanted[n] = 1;
    zone.push_back(n);
  }
  wanted_ = std::move(wanted);
  zone_ = std::move(zone);
  halo_.clear();
}

void WantedZone::move_halo(std::span<const int> nodes) {
  halo_.clear();
  for (const int n : nodes)
    if (!model_.fixed.at(n) && !wanted_[n] && n < model_.nodes_in_use) halo_.push_back(n);
}

void WantedZone::follow_cut(const GrowingOrder& order, int first_new) {
  for (int n = first_new; n < model_.nodes_in_use; ++n) {
    if (model_.fixed[n] || wanted_[n] || !wanted_[order.origin(n)]) continue;
    wanted_[n] = 1;
    zone_.push_back(n);
  }
}

std::vector<int> WantedZone::zone_and_halo() const {
  std::vector<int> nodes = zone_;
  nodes.insert(nodes.end(), halo_.begin(), halo_.end());
  return nodes;
}

}  // namespace hapticd
