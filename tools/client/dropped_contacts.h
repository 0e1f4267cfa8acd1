// How much was left out where there was more than the capacity takes (status_contacts_dropped).
//
// Of each tick the contacts that were solved, and the overlapping ones that were not. Which are left out:
// physics/contact/candidates/contact_selection.h. Of the problems the tissue within reach that had no place
// in them, as surface samples (physics/simulation/patch.h): nothing is felt of it until the next problem.
// Errors: none.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "tools/cli/report.h"

namespace hapticd {

class DroppedContacts {
 public:
  // left_out: the tick has status_contacts_dropped.
  void note(std::int64_t solved, std::int64_t dropped, bool left_out) {
    ++ticks_;
    ticks_of_samples_ += left_out && dropped == 0;
    solved_ += dropped > 0 ? solved : 0;
    dropped_ += dropped;
    ticks_dropping_ += dropped > 0;
    if (dropped > most_) {
      most_ = dropped;
      beside_most_ = solved;
    }
  }

  void note_samples(std::int64_t kept, std::int64_t dropped) {
    if (dropped <= samples_most_) return;
    samples_most_ = dropped;
    samples_beside_ = kept;
  }

  // {"ticks_share", "of_their_contacts_share", "most", "solved_beside"} of contacts, and of the tissue's
  // samples
  // {"samples_ticks_share": ticks in which they alone did not fit, "samples_most", "samples_beside"}.
  nlohmann::ordered_json to_json() const {
    return {{"ticks_share", rounded(of_ticks(), 5)},
            {"of_their_contacts_share", rounded(of_contacts(), 5)},
            {"most", most_},
            {"solved_beside", beside_most_},
            {"samples_ticks_share", rounded(share(ticks_of_samples_, ticks_), 5)},
            {"samples_most", samples_most_},
            {"samples_beside", samples_beside_}};
  }
  // Where there are any.
  void tabulate(Table& table, const std::string& whose = "") const {
    if (samples_most_ > 0 || ticks_of_samples_ > 0)
      table.emplace_back(whose + "tissue beyond capacity",
                         "at most " + fixed(100 * share(samples_most_, samples_most_ + samples_beside_), 1) +
                             " % of what was within reach (" + std::to_string(samples_most_) + " of " +
                             std::to_string(samples_most_ + samples_beside_) +
                             " samples, the farthest), in " +
                             fixed(100 * share(ticks_of_samples_, ticks_), 2) + " % of the ticks");
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
  std::int64_t ticks_of_samples_ = 0, samples_most_ = 0, samples_beside_ = 0;
};

}  // namespace hapticd
