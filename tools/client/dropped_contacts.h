// How much was left out where more contacts were open than the capacity takes (status_contacts_dropped).
//
// Of each tick the contacts that were solved, and the overlapping ones that were not. Which are left out:
// physics/contact/contact_selection.h. Errors: none.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "tools/cli/report.h"

namespace hapticd {

class DroppedContacts {
 public:
  void note(std::int64_t solved, std::int64_t dropped) {
    ++ticks_;
    solved_ += dropped > 0 ? solved : 0;
    dropped_ += dropped;
    ticks_dropping_ += dropped > 0;
    if (dropped > most_) {
      most_ = dropped;
      beside_most_ = solved;
    }
  }

  // {"ticks_share", "of_their_contacts_share", "most", "solved_beside"}
  nlohmann::ordered_json to_json() const {
    return {{"ticks_share", rounded(of_ticks(), 5)},
            {"of_their_contacts_share", rounded(of_contacts(), 5)},
            {"most", most_},
            {"solved_beside", beside_most_}};
  }
  // Where there are any.
  void tabulate(Table& table, const std::string& whose = "") const {
    if (dropped_ == 0) return;
    table.emplace_back(whose + "contacts beyond capacity",
                       fixed(100 * of_contacts(), 1) + " % of them, in " + fixed(100 * of_ticks(), 2) +
                           " % of the ticks; at most " + std::to_string(most_) + " beside " +
                           std::to_string(beside_most_) + " that were solved");
  }

 private:
  static double share(std::int64_t part, std::int64_t whole) {
    return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0;
  }
  double of_ticks() const { return share(ticks_dropping_, ticks_); }
  double of_contacts() const { return share(dropped_, solved_ + dropped_); }

  std::int64_t ticks_ = 0, ticks_dropping_ = 0, solved_ = 0, dropped_ = 0, most_ = 0, beside_most_ = 0;
};

}  // namespace hapticd
