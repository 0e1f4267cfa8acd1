// How far a ratio of percentiles strays by which slices of a run there happened to be.
//
//   the middle nine tenths of P(ours*) / P(theirs*); ours*, theirs*: as many slices, drawn with replacement
//
// (Efron's percentile bootstrap; of whole slices, since what a host takes comes in bursts.) The draws are the
// same each time. Errors: none; nothing where a side has fewer than two slices, or every draw of theirs is 0.
#pragma once

#include <optional>
#include <vector>

#include "tools/soak/tally.h"

namespace hapticd {

struct Interval {
  double low = 0, high = 0;
};

std::optional<Interval> bootstrap_ratio(const std::vector<Tally>& ours, const std::vector<Tally>& theirs,
                                        double percent);

}  // namespace hapticd
