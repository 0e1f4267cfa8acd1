#include "tools/soak/soak_record.h"

#include <utility>

namespace hapticd {

constexpr std::size_t most_blocks = 64;

void SoakFigures::merge(const SoakFigures& o) {
  tick.merge(o.tick);
  event.merge(o.event);
  cyclictest_us.merge(o.cyclictest_us);
  ddsperf.merge(o.ddsperf);
  rss_mb = o.rss_mb;
}

void SoakBlocks::add(const SoakFigures& half) {
  begun_.merge(half);
  if (++halves_ < halves_per_block_) return;
  blocks_.push_back(std::exchange(begun_, {}));
  halves_ = 0;
  if (blocks_.size() < most_blocks) return;
  for (std::size_t i = 0; 2 * i < blocks_.size(); ++i) {
    SoakFigures joined = std::move(blocks_[2 * i]);
    joined.merge(blocks_[2 * i + 1]);
    blocks_[i] = std::move(joined);
  }
  blocks_.resize(blocks_.size() / 2);
  halves_per_block_ *= 2;
}

}  // namespace hapticd
