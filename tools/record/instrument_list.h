// The instruments of a daemon's scene and the devices that move them, as the daemon tells them.
//
// Of a daemon with several worlds, those of the first. Errors: std::runtime_error (DDS).
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "server/dds/dds.h"

namespace hapticd {

struct HeardInstrument {
  std::string name;
  std::uint32_t device_id = 0;
};

class InstrumentList {
 public:
  explicit InstrumentList(const Participant& participant) : reader_(participant) {}

  // Takes what has come; true once all of the newest daemon's instruments are known.
  bool poll();
  // Until all are known or `seconds` are over, or until interrupted (interrupt.h); false: not known.
  bool await(double seconds);
  // In the scene's order; empty: not known.
  std::vector<HeardInstrument> all() const;

 private:
  Reader<hapticd_msg_SceneInstrument> reader_;
  std::map<std::uint32_t, HeardInstrument> heard_;
  std::size_t count_ = 0;  // 0: nothing was heard
};

}  // namespace hapticd
