// Log-linear histogram of durations: one writer records, any thread reads.
//
//   bin(v) = v                                   for v < 64 ns
//   bin(v) = 64 (e − 5) + (⌊v / 2^(e−6)⌋ − 64)   for 2^e ≤ v < 2^(e+1), e ≥ 6
//
// There are 64 bins per octave: a bin is at most 1/64 = 1.6 % wide and its centre at most 0.8 % off, up to
// 2^34 ns = 17 s. Longer durations land in the last bin, but the maximum stays exact. Negative ones count as
// 0.
// Thread safety: exactly one thread records. Any thread may take a snapshot at any time, consistent up to
// the records in flight (relaxed atomics).
// Guarantee: record is wait-free and allocates nothing: one bit scan and four relaxed stores.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>

namespace hapticd {

inline constexpr int histogram_octaves = 28;  // above the first 64 ns
inline constexpr int histogram_bins = 64 * (histogram_octaves + 1);

inline int histogram_bin(std::int64_t ns) noexcept {
  const auto v = static_cast<std::uint64_t>(std::max<std::int64_t>(ns, 0));
  if (v < 64) return static_cast<int>(v);
  const int e = static_cast<int>(std::bit_width(v)) - 1;
  return std::min(64 * (e - 5) + static_cast<int>((v >> (e - 6)) - 64), histogram_bins - 1);
}

// The middle of a bin [ns].
inline double histogram_centre(int bin) noexcept {
  if (bin < 64) return bin;
  const int e = bin / 64 + 5;
  return std::ldexp(64.5 + bin % 64, e - 6);
}

// A histogram's content as a plain value.
struct HistogramSnapshot {
  std::array<std::uint64_t, histogram_bins> bin{};
  std::uint64_t count = 0;
  std::int64_t min = 0;  // [ns], exact
  std::int64_t max = 0;  // [ns], exact
  double sum = 0;        // [ns]

  double mean() const noexcept { return count ? sum / static_cast<double>(count) : 0; }

  // The p-th percentile, 0 ≤ p ≤ 100, by nearest rank [ns]; 0 when empty.
  double percentile(double p) const noexcept {
    if (count == 0) return 0;
    const double wanted = std::ceil(p / 100.0 * static_cast<double>(count) - 1e-9);
    const auto rank = static_cast<std::uint64_t>(std::clamp(wanted, 1.0, static_cast<double>(count)));
    if (rank == count) return static_cast<double>(max);
    std::uint64_t below = 0;
    int i = 0;
    while (i < histogram_bins - 1 && (below += bin[static_cast<std::size_t>(i)]) < rank) ++i;
    return std::clamp(histogram_centre(i), static_cast<double>(min), static_cast<double>(max));
  }

  void merge(const HistogramSnapshot& other) noexcept {
    if (other.count == 0) return;
    for (std::size_t i = 0; i < bin.size(); ++i) bin[i] += other.bin[i];
    min = count ? std::min(min, other.min) : other.min;
    max = count ? std::max(max, other.max) : other.max;
    count += other.count;
    sum += other.sum;
  }
};

class Histogram {
 public:
  void record(std::int64_t ns) noexcept {
    ns = std::max<std::int64_t>(ns, 0);
    add(bin_[static_cast<std::size_t>(histogram_bin(ns))], std::uint64_t{1});
    add(sum_, ns);
    if (ns < min_.load(std::memory_order_relaxed)) min_.store(ns, std::memory_order_relaxed);
    if (ns > max_.load(std::memory_order_relaxed)) max_.store(ns, std::memory_order_relaxed);
  }

  HistogramSnapshot snapshot() const noexcept {
    HistogramSnapshot s;
    for (std::size_t i = 0; i < s.bin.size(); ++i)
      s.count += s.bin[i] = bin_[i].load(std::memory_order_relaxed);
    if (s.count == 0) return s;
    s.min = min_.load(std::memory_order_relaxed);
    s.max = std::max(max_.load(std::memory_order_relaxed), s.min);
    s.sum = static_cast<double>(sum_.load(std::memory_order_relaxed));
    return s;
  }

 private:
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

  // A single writer needs no read-modify-write.
  template <typename T>
  static void add(std::atomic<T>& a, T n) noexcept {
    a.store(a.load(std::memory_order_relaxed) + n, std::memory_order_relaxed);
  }

  std::array<std::atomic<std::uint64_t>, histogram_bins> bin_{};
  std::atomic<std::int64_t> sum_{0};
  std::atomic<std::int64_t> min_{INT64_MAX};
  std::atomic<std::int64_t> max_{0};
};

}  // namespace hapticd
