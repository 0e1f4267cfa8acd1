#include "tools/record/instrument_list.h"

#include <chrono>
#include <thread>

#include "haptic/clock.h"
#include "tools/cli/interrupt.h"

namespace hapticd {

bool InstrumentList::poll() {
  reader_.take_each([this](const hapticd_msg_SceneInstrument& m, const dds_sample_info_t&) {
    if (m.instruments != count_) heard_.clear();
    count_ = m.instruments;
    heard_[m.instrument] = {m.name ? m.name : "", m.device_id};
  });
  return count_ > 0 && heard_.size() == count_;
}

bool InstrumentList::await(double seconds) {
  const std::int64_t until = monotonic_ns() + static_cast<std::int64_t>(1e9 * seconds);
  while (!poll()) {
    if (interrupted() || monotonic_ns() > until) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return true;
}

std::vector<HeardInstrument> InstrumentList::all() const {
  std::vector<HeardInstrument> list;
  if (heard_.size() == count_)
    for (const auto& [index, instrument] : heard_) list.push_back(instrument);
  return list;
}

}  // namespace hapticd
