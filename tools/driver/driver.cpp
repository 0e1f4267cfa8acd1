#include "tools/driver/driver.h"

#include "server/os/realtime.h"
#include "tools/client_library/exchange.h"
#include "tools/driver/ending.h"

namespace hapticd {
namespace {

// Zero is the last thing written, however the run ends.
class ZeroAtEnd {
 public:
  ZeroAtEnd(HapticDevice& device, Ending& ending) : device_(device), ending_(ending) {}
  ~ZeroAtEnd() {
    try {
      device_.write({});
    } catch (...) {  // the first exception is the one to tell
    }
    ending_.at_zero();
  }
  ZeroAtEnd(const ZeroAtEnd&) = delete;
  ZeroAtEnd& operator=(const ZeroAtEnd&) = delete;

 private:
  HapticDevice& device_;
  Ending& ending_;
};

}  // namespace

DriverReport run_driver(HapticDevice& device, const DriverOptions& options) {
  // Before the device is touched: what is wrong with the options is said without a force, not even zero.
  Exchange exchange({options.device, options.domain, options.device_id, options.keys, options.open_network,
                     options.station});
  Ending ending(device);
  DriverReport report;
  report.place = exchange.place();
  const ZeroAtEnd zero(device, ending);
  if (options.realtime)
    if (const Grant grant = use_fifo(client_priority); !grant.granted) report.realtime_refused = grant.detail;
  const std::int64_t end =
      options.duration > 0 ? client_now_ns() + static_cast<std::int64_t>(1e9 * options.duration) : INT64_MAX;
  for (;;) {
    exchange.next_slot();
    Reading reading;
    if (ending.asked())
      report.end = DriverReport::End::signal;
    else if (client_now_ns() >= end)
      report.end = DriverReport::End::duration;
    else if (!device.read(reading))
      report.end = DriverReport::End::device_lost;
    else {
      exchange.exchange(reading, [&device](const Feel& feel) { device.write(feel); });
      continue;
    }
    const ExchangeCounts counts = exchange.counts();
    report.sent = counts.sent;
    report.answered = counts.answered;
    report.silences = counts.silences;
    report.longest_silence_ms = counts.longest_silence_ms;
    report.strange_forces = counts.strange_forces;
    return report;
  }
}

}  // namespace hapticd
