#include "physics/contact/candidates/contact_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

std::vector<ContactCandidate> random_candidates(Random& random, int faces, int per_face) {
  std::vector<ContactCandidate> all;
  for (int f = 0; f < faces; ++f)
    for (int k = 0; k < per_face; ++k)
      all.push_back(
          {uniform(random, -1, 0.2), static_cast<int>(all.size()), static_cast<std::uint32_t>(f), 0, 0});
  return all;
}

std::set<int> chosen(std::vector<ContactCandidate> candidates, int capacity, int* dropped = nullptr) {
  const int d = select_contacts(candidates, capacity);
  if (dropped) *dropped = d;
  std::set<int> result;
  for (int i = 0; i < capacity; ++i) result.insert(candidates[static_cast<std::size_t>(i)].sample);
  return result;
}

TEST(ContactSelection, HandChosen) {
  // Two faces: 0 has the three deepest. Capacity 4: its two deepest, then the deepest of face 1 (a first
  // round), then face 1's next (second round) before face 0's third (third round).
  const std::vector<ContactCandidate> c = {{-5, 0, 0, 0, 0}, {-4, 1, 0, 0, 0},   {-3, 2, 0, 0, 0},
                                           {-1, 3, 1, 0, 0}, {-0.5, 4, 1, 0, 0}, {0.1, 5, 1, 0, 0}};
  int dropped = 0;
  EXPECT_EQ(chosen(c, 4, &dropped), (std::set<int>{0, 1, 3, 4}));
  EXPECT_EQ(dropped, 1);  // −3; the gap of 0.1 does not overlap
}

TEST(ContactSelection, TheDeepestHalfIsThereAndTheRestIsSpread) {
  Random random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const int faces = 5 + trial % 40, per_face = 2 + trial % 7, n = faces * per_face;
    const int capacity = std::min(n - 1, 8 + trial % 60);
    const std::vector<ContactCandidate> all = random_candidates(random, faces, per_face);
    int dropped = 0;
    const std::set<int> set = chosen(all, capacity, &dropped);
    ASSERT_EQ(static_cast<int>(set.size()), capacity);
    std::vector<ContactCandidate> sorted = all;
    std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.gap < b.gap; });
    std::map<std::uint32_t, int> of_face;
    for (int i = 0; i < capacity / 2; ++i) {
      EXPECT_TRUE(set.contains(sorted[static_cast<std::size_t>(i)].sample));
      ++of_face[sorted[static_cast<std::size_t>(i)].face];
    }
    // No face gives two more than another that still has some to give.
    std::map<std::uint32_t, int> added, left;
    for (const ContactCandidate& c : all) ++(set.contains(c.sample) ? added[c.face] : left[c.face]);
    for (const auto& [poor, remaining] : left)
      for (const auto& [rich, count] : added)
        if (remaining > 0 && count > of_face[rich]) {
          EXPECT_LE(count, added[poor] + 1);
        }
    int overlapping = 0;
    for (const ContactCandidate& c : all) overlapping += c.gap < 0 && !set.contains(c.sample);
    EXPECT_EQ(dropped, overlapping);
  }
}

TEST(ContactSelection, TheOrderOfDiscoveryDoesNotMatter) {
  Random random(2);
  const std::vector<ContactCandidate> all = random_candidates(random, 20, 6);
  const std::set<int> set = chosen(all, 40);
  for (int trial = 0; trial < 50; ++trial) {
    std::vector<ContactCandidate> other = all;
    std::shuffle(other.begin(), other.end(), random);
    EXPECT_EQ(chosen(other, 40), set);
  }
}

TEST(ContactSelection, OfNewOnesTheChosenComeBesideAllThatAreKnown) {
  Random random(9);
  for (int trial = 0; trial < 50; ++trial) {
    std::vector<ContactCandidate> all = random_candidates(random, 20, 6), others;
    for (ContactCandidate& c : all) {
      c.known = uniform(random, 0, 1) < 0.4;
      if (!c.known) others.push_back(c);
    }
    std::set<int> expected = chosen(others, 24);
    for (const ContactCandidate& c : all)
      if (c.known) expected.insert(c.sample);
    const auto few = others.size() <= 24 ? all.size() : expected.size();
    std::shuffle(all.begin(), all.end(), random);
    const int count = select_new(all, 24);
    ASSERT_EQ(static_cast<std::size_t>(count), few);
    for (int i = 0; i < count; ++i) {
      EXPECT_TRUE(expected.contains(all[static_cast<std::size_t>(i)].sample));
      if (i > 0) {
        EXPECT_LT(all[static_cast<std::size_t>(i - 1)].sample, all[static_cast<std::size_t>(i)].sample);
      }
    }
    EXPECT_EQ(select_new(std::span(all).first(static_cast<std::size_t>(count)), 120), count) << "all of them";
  }
}

}  // namespace
}  // namespace hapticd
