#include "physics/compliance/rounded_panels.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {

namespace {

// Columns `first` to `first + columns` of a panel; returns where the next group begins.
std::byte* round_group(const double* panel, int stride, int height, int first, int columns, std::byte* to) {
  const auto at = [&](int i, int j) {
    return panel[first + i + static_cast<std::ptrdiff_t>(first + j) * stride];
  };
  const int rows = height - first - columns;  // below
  auto* group = new (to) RoundedGroup{};
  for (int c = 0; c < columns; ++c) {
    double x[group_columns];
    for (int i = c; i < columns; ++i) {
      x[i] = i == c ? 1 : 0;
      for (int j = c; j < i; ++j) x[i] -= at(i, j) * x[j];
      x[i] /= at(i, i);
      group->inverse[c][i] = static_cast<float>(x[i]);
    }
  }
  auto* tiles = reinterpret_cast<std::int16_t*>(group + 1);
  for (int c = 0; c < columns; ++c) {
    constexpr double largest = std::numeric_limits<std::int16_t>::max();
    double most = 0;
    for (int i = 0; i < rows; ++i) most = std::max(most, std::abs(at(columns + i, c)));
    const double unit = most > 0 ? most / largest : 1;
    group->unit[c] = static_cast<float>(unit);
    const double per_unit = 1 / unit;
    for (int i = 0; i < tiles_of(rows) * tile_rows; ++i) {
      const std::ptrdiff_t tile = i / tile_rows;
      tiles[(tile * columns + c) * tile_rows + i % tile_rows] =
          static_cast<std::int16_t>(i < rows ? std::lrint(at(columns + i, c) * per_unit) : 0);
    }
  }
  return to + group_bytes(columns, rows);
}

template <class Visit>
void each_group(const RestPanel& p, const Visit& visit) {
  for (int j = 0; j < p.width; j += group_columns) visit(j, std::min(group_columns, p.width - j));
}

}  // namespace

RoundedPanels::RoundedPanels(std::span<const RestPanel> panels, const int* rows, const double* values,
                             const RoundedKernels& kernels)
    : panels_(panels), rows_(rows), kernels_(&kernels) {
  std::size_t bytes = 0;
  int tallest = 0;
  for (const RestPanel& p : panels) {
    each_group(p, [&](int j, int columns) { bytes += group_bytes(columns, p.height - j - columns); });
    tallest = std::max(tallest, p.height);
  }
  memory_.reserve(bytes / sizeof(double) + 1);
  auto* to = reinterpret_cast<std::byte*>(memory_.data());
  for (const RestPanel& p : panels)
    each_group(p, [&](int j, int columns) {
      to = round_group(values + p.value, p.stride, p.height, j, columns, to);
    });
  end_ = to;
  own_.assign(static_cast<std::size_t>(tallest) + tile_rows, 0.0F);
}

void RoundedPanels::forward(VecX& x) noexcept {
  const auto* at = reinterpret_cast<const std::byte*>(memory_.data());
  float* own = own_.data();
  for (const RestPanel& p : panels_) {
    for (int j = 0; j < p.width; ++j) own[j] = static_cast<float>(x[p.first + j]);
    std::fill(own + p.width, own + p.height + tile_rows, 0.0F);
    at = kernels_->forward(at, p.width, p.height, own);
    for (int j = 0; j < p.width; ++j) x[p.first + j] = own[j];
    const int* row = rows_ + p.row;
    for (int i = p.width; i < p.height; ++i) x[row[i]] += static_cast<double>(own[i]);
  }
}

void RoundedPanels::backward(VecX& x) noexcept {
  const std::byte* end = end_;
  float* own = own_.data();
  for (auto p = panels_.rbegin(); p != panels_.rend(); ++p) {
    const int* row = rows_ + p->row;
    for (int j = 0; j < p->width; ++j) own[j] = static_cast<float>(x[p->first + j]);
    for (int i = p->width; i < p->height; ++i) own[i] = static_cast<float>(x[row[i]]);
    std::fill_n(own + p->height, tile_rows, 0.0F);
    end = kernels_->backward(end, p->width, p->height, own);
    for (int j = 0; j < p->width; ++j) x[p->first + j] = own[j];
  }
}

}  // namespace hapticd
