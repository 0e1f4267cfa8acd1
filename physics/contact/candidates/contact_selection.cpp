#include "physics/contact/candidates/contact_selection.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "physics/contact/condensed_problem.h"

namespace hapticd {
namespace {

bool in_order(const ContactCandidate& a, const ContactCandidate& b) noexcept {
  if (a.sample != b.sample) return a.sample < b.sample;
  return a.instrument != b.instrument ? a.instrument < b.instrument : a.primitive < b.primitive;
}

bool deeper(const ContactCandidate& a, const ContactCandidate& b) noexcept {
  return a.gap != b.gap ? a.gap < b.gap : in_order(a, b);
}

int overlapping(std::span<const ContactCandidate> candidate) noexcept {
  return static_cast<int>(
      std::count_if(candidate.begin(), candidate.end(), [](const ContactCandidate& c) { return c.gap < 0; }));
}

}  // namespace

int keep_deepest(std::span<ContactCandidate> candidate, int count) noexcept {
  const auto kept = candidate.begin() + count;
  std::nth_element(candidate.begin(), kept, candidate.end(), deeper);
  std::sort(candidate.begin(), kept, in_order);
  return overlapping(candidate.subspan(static_cast<std::size_t>(count)));
}

int select_new(std::span<ContactCandidate> candidate, int most) noexcept {
  const auto others =
      std::partition(candidate.begin(), candidate.end(), [](const ContactCandidate& c) { return c.known; });
  auto end = candidate.end();
  if (end - others > most) {
    select_contacts({others, end}, most);
    end = others + most;
  }
  std::sort(candidate.begin(), end, in_order);
  return static_cast<int>(end - candidate.begin());
}

int select_contacts(std::span<ContactCandidate> candidate, int capacity) noexcept {
  if (!std::is_sorted(candidate.begin(), candidate.end(), in_order))
    std::sort(candidate.begin(), candidate.end(), in_order);
  // A candidate by what it is chosen by; `at` is its place, and so breaks ties.
  struct Key {
    double gap;
    std::uint32_t round;
    std::uint32_t at;
    bool operator<(const Key& other) const noexcept {
      if (round != other.round) return round < other.round;
      return gap != other.gap ? gap < other.gap : at < other.at;
    }
  };
  std::array<Key, max_patch_samples> key;
  std::array<bool, max_patch_samples> taken{};
  const auto count = candidate.size();
  for (std::size_t i = 0; i < count; ++i) key[i] = {candidate[i].gap, 0, static_cast<std::uint32_t>(i)};
  const auto begin = key.begin(), half = begin + capacity / 2, full = begin + capacity, end = begin + count;
  std::nth_element(begin, half, end);
  for (auto k = begin; k != half; ++k) taken[k->at] = true;

  // Rounds: a sample's place among those of its face by gap, the ones already taken first.
  auto left = half;
  for (std::size_t first = 0, last = 0; first < count; first = last) {
    const auto of_face = left;
    std::uint32_t round = 0;
    for (last = first; last < count && candidate[last].face == candidate[first].face; ++last) {
      if (taken[last])
        ++round;
      else
        *left++ = {candidate[last].gap, 0, static_cast<std::uint32_t>(last)};
    }
    std::sort(of_face, left);
    for (auto k = of_face; k != left; ++k) k->round = round++;
  }
  std::nth_element(half, full, end);
  for (auto k = half; k != full; ++k) taken[k->at] = true;

  int overlapping = 0;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (taken[i])
      candidate[kept++] = candidate[i];
    else
      overlapping += candidate[i].gap < 0;
  }
  return overlapping;
}

}  // namespace hapticd
