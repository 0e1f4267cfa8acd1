// The haptic tick in contact, part by part, of the daemon in virtual time (server/schedule/virtual_daemon.h).
//
// The lens of the published size, co-rotational, `exact`, under a travelling tip (travelling_tip.h), friction
// 0.1, geometry renewed; twenty ticks a step, all in one thread, so that nothing waits. No deadline: what a
// tick takes is what it takes. Contacts are samples within the margin, of friction each: three rows of W;
// active are those with a force. The daemon's own tick begins with fewer rows (HapticOptions::ticks_ahead);
// here all of them are, so that the cost is that of so many contacts. Of several hands each has a tip of its
// own across the lens from the other's, never nearer than 2.4 mm, and one tick solves for all. Units in the
// names.
#pragma once

#include <array>
#include <functional>

#include "physics/part_times.h"

namespace hapticd {

using ContactParts = std::array<double, static_cast<std::size_t>(ContactPart::count)>;

struct TickFigures {
  int hands = 1;
  int patch_nodes = 0, contacts = 0, active = 0;  // medians
  int least_contacts = 0;                         // of a hand's, the least over the hands
  int ticks = 0, capped = 0;
  double us_median = 0, us_p99 = 0, us_max = 0, us_mean = 0;
  double cpu_us_median = 0, cpu_us_p99 = 0;  // of the thread, where the machine has other work
  ContactParts parts_us{};                   // means; `rest` has what is around the contact solve too
};

struct TickSettings {
  int hands = 1;  // or 2
  double alarm_distance = 0.8e-3;
  double sample_spacing = 0.18e-3;  // for thirty contacts or so
  int steps = 400;
};

const char* name_of(ContactPart part) noexcept;

TickFigures chart_tick(const TickSettings& settings, const std::function<bool(double)>& progress);

}  // namespace hapticd
