// What a soak measured, of one device: in all, minute by minute, and in blocks that can be drawn again.
//
// A block is half a cycle: a slice in mode `tick`, one of cyclictest, and one in mode `event` or of ddsperf,
// so that what the machine did meanwhile fell on both. Beyond 64 blocks neighbours are joined two by two:
// memory stays bounded however long the run.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/soak/neighbours.h"
#include "tools/soak/public_tools.h"
#include "tools/soak/soak_slice.h"

namespace hapticd {

// Everything of some part of the run.
struct SoakFigures {
  ServerFigures tick, event;
  Tally cyclictest_us;  // with the wake-ups that late ones hid
  PingFigures ddsperf;
  double rss_mb = 0;  // of all daemons, at the end of the part
  void merge(const SoakFigures& other);
};

class SoakBlocks {
 public:
  void add(const SoakFigures& half);
  const std::vector<SoakFigures>& all() const { return blocks_; }  // whole ones

 private:
  std::vector<SoakFigures> blocks_;
  SoakFigures begun_;
  int halves_ = 0, halves_per_block_ = 1;
};

// A whole run.
struct SoakRecord {
  std::string scene, mode;        // mode: tick, event, both or attached
  double duration = 0, load = 0;  // [s], [%]
  bool own = true;                // the daemons are: what only they know is known
  SoakFigures all;
  SoakBlocks blocks;
  std::vector<SoakFigures> minutes;
  double first_rss_mb = 0;                // after the first cycle
  double busy = 0, steal = 0;             // shares of all cores
  std::vector<nlohmann::json> summaries;  // the daemons' last
  std::vector<Neighbour> neighbours;      // on the haptic loop's core
};

}  // namespace hapticd
