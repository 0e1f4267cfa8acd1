// How far a figure strays by which blocks of a run there happened to be: Efron's bootstrap, of whole blocks,
// since what a host takes comes in bursts, and of ours and the public tool's together, since it takes it of
// both.
//
// The draws are the same each time. Errors: none; no draw of fewer than two blocks.
#pragma once

#include <optional>
#include <random>
#include <vector>

namespace hapticd {

struct Interval {
  double low = 0, high = 0;
};

// The middle nine tenths; nothing of no value.
std::optional<Interval> middle_nine_tenths(std::vector<double> values);

// Calls `use` with `draws` sums of as many blocks as there are, drawn with replacement.
template <typename Block, typename Use>
void redraw(const std::vector<Block>& blocks, int draws, Use&& use) {
  if (blocks.size() < 2) return;
  std::mt19937_64 random(1);
  for (int i = 0; i < draws; ++i) {
    Block sum{};
    for (std::size_t n = 0; n < blocks.size(); ++n) sum.merge(blocks[random() % blocks.size()]);
    use(sum);
  }
}

}  // namespace hapticd
