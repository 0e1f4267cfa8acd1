#include "physics/contact/contact_selection.h"

#include <algorithm>
#include <cstddef>

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

int select_contacts(std::span<ContactCandidate> candidate, int capacity) noexcept {
  const auto begin = candidate.begin(), end = candidate.end();
  const auto half = begin + capacity / 2, full = begin + capacity;
  std::nth_element(begin, half, end, deeper);

  // Rounds: a sample's place among those of its face, the ones already taken first.
  std::sort(begin, half,
            [](const ContactCandidate& a, const ContactCandidate& b) { return a.face < b.face; });
  std::sort(half, end, [](const ContactCandidate& a, const ContactCandidate& b) {
    return a.face != b.face ? a.face < b.face : deeper(a, b);
  });
  auto taken = begin;
  std::uint32_t face = 0, round = 0;
  for (auto c = half; c != end; ++c) {
    if (c == half || c->face != face) {
      face = c->face;
      round = 0;
      while (taken != half && taken->face < face) ++taken;
      for (; taken != half && taken->face == face; ++taken) ++round;
    }
    c->face = round++;  // from here on its round
  }
  std::nth_element(half, full, end, [](const ContactCandidate& a, const ContactCandidate& b) {
    return a.face != b.face ? a.face < b.face : deeper(a, b);
  });
  std::sort(begin, full, in_order);
  return overlapping(candidate.subspan(static_cast<std::size_t>(capacity)));
}

}  // namespace hapticd
