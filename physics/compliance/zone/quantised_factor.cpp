#include "physics/compliance/zone/quantised_factor.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {

namespace {

double largest_of(const double* x, int count) {
  double most[tile_rows] = {};
  int i = 0;
  for (; i + tile_rows <= count; i += tile_rows)
    for (int l = 0; l < tile_rows; ++l) most[l] = std::abs(x[i + l]) > most[l] ? std::abs(x[i + l]) : most[l];
  for (; i < count; ++i) most[0] = std::max(most[0], std::abs(x[i]));
  return *std::max_element(most, most + tile_rows);
}

// Sixteen rows to each tile, `stride` numbers apart; returns the unit.
float round_column(const double* x, int rows, std::int16_t* tile, int stride) {
  constexpr double largest = std::numeric_limits<std::int16_t>::max();
  const double most = largest_of(x, rows);
  const double unit = most > 0 ? most / largest : 1, per_unit = 1 / unit;
  const auto nearest = [per_unit](double v) {
    return static_cast<std::int16_t>(static_cast<int>(v * per_unit + (v < 0 ? -0.5 : 0.5)));
  };
  int i = 0;
  for (; i + tile_rows <= rows; i += tile_rows, tile += stride)
    for (int l = 0; l < tile_rows; ++l) tile[l] = nearest(x[i + l]);
  if (i == rows) return static_cast<float>(unit);
  for (int l = 0; l < tile_rows; ++l) tile[l] = i + l < rows ? nearest(x[i + l]) : std::int16_t{0};
  return static_cast<float>(unit);
}

// Columns `first` to `first + columns` of a panel; returns where the next group begins.
std::byte* round_group(const double* panel, int stride, int height, int first, int columns, std::byte* to) {
  const auto at = [&](int i, int j) -> const double& {
    return panel[first + i + static_cast<std::ptrdiff_t>(first + j) * stride];
  };
  const int rows = height - first - columns;  // below
  auto* group = new (to) QuantisedGroup{};
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
  for (int c = 0; c < columns; ++c)
    group->unit[c] = round_column(&at(columns, c), rows, tiles + c * tile_rows, columns * tile_rows);
  return to + group_bytes(columns, rows);
}

template <class Visit>
void each_group(const LeadingPanel& p, const Visit& visit) {
  for (int j = 0; j < p.width; j += group_columns) visit(j, std::min(group_columns, p.width - j));
}

}  // namespace

QuantisedFactor::QuantisedFactor(std::span<const LeadingPanel> panels, const int* rows, const double* values,
                                 PageMemory memory, const QuantisedKernels& kernels)
    : panels_(panels), kernels_(&kernels), memory_(std::move(memory)) {
  find_runs(rows);
  std::size_t bytes = 0;
  int tallest = 0;
  for (const LeadingPanel& p : panels) {
    each_group(p, [&](int j, int columns) { bytes += group_bytes(columns, p.height - j - columns); });
    tallest = std::max(tallest, p.height);
  }
  if (bytes / sizeof(double) + 1 > memory_.size() || !memory_.data())
    memory_.reserve((bytes + bytes / 16) / sizeof(double) + 1);  // with some to spare for the next
  auto* to = reinterpret_cast<std::byte*>(memory_.data());
  for (const LeadingPanel& p : panels) {
    last_ = to;
    each_group(p, [&](int j, int columns) {
      to = round_group(values + p.value, p.stride, p.height, j, columns, to);
    });
  }
  end_ = to;
  own_.assign(static_cast<std::size_t>(tallest) + tile_rows, 0.0F);
}

void QuantisedFactor::find_runs(const int* rows) {
  for (const LeadingPanel& p : panels_) {
    const int* row = rows + p.row;
    for (int i = p.width; i < p.height; ++i)
      if (i > p.width && row[i] == row[i - 1] + 1)
        ++runs_.back().count;
      else
        runs_.push_back({row[i], 1});
    runs_end_.push_back(runs_.size());
  }
}

const std::byte* QuantisedFactor::forward(std::size_t panel, const std::byte* at, VecX& x) noexcept {
  const LeadingPanel& p = panels_[panel];
  float* own = own_.data();
  for (int j = 0; j < p.width; ++j) own[j] = static_cast<float>(x[p.first + j]);
  std::fill(own + p.width, own + p.height + tile_rows, 0.0F);
  at = kernels_->forward(at, p.width, p.height, own);
  for (int j = 0; j < p.width; ++j) x[p.first + j] = own[j];
  const float* from = own + p.width;
  for (std::size_t r = first_run(panel); r < runs_end_[panel]; ++r) {
    double* to = &x[runs_[r].row];
    for (int k = 0; k < runs_[r].count; ++k) to[k] += static_cast<double>(from[k]);
    from += runs_[r].count;
  }
  return at;
}

const std::byte* QuantisedFactor::backward(std::size_t panel, const std::byte* end, VecX& x) noexcept {
  const LeadingPanel& p = panels_[panel];
  float* own = own_.data();
  for (int j = 0; j < p.width; ++j) own[j] = static_cast<float>(x[p.first + j]);
  float* to = own + p.width;
  for (std::size_t r = first_run(panel); r < runs_end_[panel]; ++r) {
    const double* from = &x[runs_[r].row];
    for (int k = 0; k < runs_[r].count; ++k) to[k] = static_cast<float>(from[k]);
    to += runs_[r].count;
  }
  std::fill_n(to, tile_rows, 0.0F);
  end = kernels_->backward(end, p.width, p.height, own);
  for (int j = 0; j < p.width; ++j) x[p.first + j] = own[j];
  return end;
}

void QuantisedFactor::forward(VecX& x) noexcept {
  const auto* at = reinterpret_cast<const std::byte*>(memory_.data());
  for (std::size_t s = 0; s < panels_.size(); ++s) at = forward(s, at, x);
}

void QuantisedFactor::backward(VecX& x) noexcept {
  const std::byte* end = end_;
  for (std::size_t s = panels_.size(); s-- > 0;) end = backward(s, end, x);
}

void QuantisedFactor::forward_last(VecX& x) noexcept {
  if (!panels_.empty()) forward(panels_.size() - 1, last_, x);
}

void QuantisedFactor::backward_last(VecX& x) noexcept {
  if (!panels_.empty()) backward(panels_.size() - 1, end_, x);
}

}  // namespace hapticd
