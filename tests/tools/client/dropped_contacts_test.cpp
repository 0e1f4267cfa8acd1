// What is said of contacts that did not fit.
#include "tools/client/dropped_contacts.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

TEST(DroppedContacts, TheirShareIsOfTheTicksThatHadToChoose) {
  DroppedContacts d;
  Table table;
  for (int i = 0; i < 6; ++i) d.note(10, 0, false);
  d.tabulate(table);
  EXPECT_TRUE(table.empty());
  d.note(60, 20, true);
  d.note(60, 60, true);
  d.note(0, 0, false);
  d.note(0, 0, false);
  const auto j = d.to_json();
  EXPECT_EQ(j.at("ticks_share"), 0.2);
  EXPECT_EQ(j.at("of_their_contacts_share"), 0.4);
  EXPECT_EQ(j.at("most"), 60);
  EXPECT_EQ(j.at("solved_beside"), 60);
  d.tabulate(table, "chopper: ");
  ASSERT_EQ(table.size(), 1u);
  EXPECT_EQ(table.front().first, "chopper: contacts beyond capacity");
  EXPECT_EQ(table.front().second,
            "40.0 % of them, in 20.00 % of the ticks; at most 60 beside 60 that were solved");
}

// More tissue within reach than a problem holds, and no contact too many.
TEST(DroppedContacts, TissueBeyondTheProblemIsSaidByItself) {
  DroppedContacts d;
  Table table;
  for (int i = 0; i < 4; ++i) d.note(40, 0, i == 0);
  d.note_samples(300, 0);
  d.note_samples(300, 100);
  d.note_samples(350, 20);
  d.tabulate(table);
  ASSERT_EQ(table.size(), 1u);
  EXPECT_EQ(table.front().first, "tissue beyond capacity");
  EXPECT_EQ(table.front().second,
            "at most 25.0 % of what was within reach (100 of 400 samples, the farthest), in 25.00 % of the "
            "ticks");
  const auto j = d.to_json();
  EXPECT_EQ(j.at("ticks_share"), 0);
  EXPECT_EQ(j.at("samples_ticks_share"), 0.25);
  EXPECT_EQ(j.at("samples_most"), 100);
  EXPECT_EQ(j.at("samples_beside"), 300);
}

}  // namespace
}  // namespace hapticd
