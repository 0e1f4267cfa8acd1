#include "physics/contact/instrument_pairs.h"

#include <algorithm>

namespace hapticd {
namespace {

std::uint64_t id_of(int i, int k, int j, int l) noexcept {
  const auto wide = [](int x) { return static_cast<std::uint64_t>(x); };
  return wide(0xff) << 56 | wide(i) << 40 | wide(j) << 32 | (wide(k) & 0xffff) << 16 | (wide(l) & 0xffff);
}

}  // namespace

InstrumentPairs::InstrumentPairs(Instruments instruments, const InstrumentPoses& X, double reach) noexcept {
  for (int i = 0; i < instruments.count(); ++i)
    for (int j = i + 1; j < instruments.count(); ++j) {
      if (!X.present[i] || !X.present[j]) continue;
      const auto &a = instruments[i].primitives, &b = instruments[j].primitives;
      for (std::size_t k = 0; k < a.size(); ++k)
        for (std::size_t l = 0; l < b.size(); ++l) {
          if (!near(a[k], X[i], b[l], X[j], reach)) continue;
          const int ka = static_cast<int>(k), lb = static_cast<int>(l);
          const PrimitiveGap gap = gap_between(a[k], X[i], b[l], X[j]);
          if (gap.distance < reach) add({i, ka, j, lb, id_of(i, ka, j, lb), gap});
        }
    }
  std::sort(pair_.begin(), pair_.begin() + count_,
            [](const InstrumentPair& a, const InstrumentPair& b) { return a.id < b.id; });
}

void InstrumentPairs::add(const InstrumentPair& pair) noexcept {
  if (count_ < most_instrument_pairs) {
    pair_[static_cast<std::size_t>(count_++)] = pair;
    return;
  }
  const auto farthest = std::max_element(pair_.begin(), pair_.end(), [](const auto& a, const auto& b) {
    return a.gap.distance < b.gap.distance;
  });
  if (pair.gap.distance < farthest->gap.distance) *farthest = pair;
}

}  // namespace hapticd
