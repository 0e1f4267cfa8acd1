// What is said of contacts that did not fit.
#include "tools/client/dropped_contacts.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

TEST(DroppedContacts, TheirShareIsOfTheTicksThatHadToChoose) {
  DroppedContacts d;
  Table table;
  for (int i = 0; i < 6; ++i) d.note(10, 0);
  d.tabulate(table);
  EXPECT_TRUE(table.empty());
  d.note(60, 20);
  d.note(60, 60);
  d.note(0, 0);
  d.note(0, 0);
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

}  // namespace
}  // namespace hapticd
