#include "tools/soak/bootstrap.h"

#include <algorithm>

namespace hapticd {

std::optional<Interval> middle_nine_tenths(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  return Interval{at(0.05), at(0.95)};
}

}  // namespace hapticd
