// haptic_device: drives one haptic device, or lists what there is. `haptic device` becomes this program.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>

#include "server/files/input_error.h"
#include "server/files/output_file.h"
#include "server/files/paths.h"
#include "server/scene/device_reader.h"
#include "tools/device/device_kinds.h"
#include "tools/device/device_options.h"
#include "tools/device/guarded_device.h"
#include "tools/device/shared_library.h"

namespace hapticd {
namespace {

using nlohmann::ordered_json;

void write_figures(const DeviceRunOptions& options, const ordered_json& figures) {
  if (!options.json.empty()) write_file(options.json, figures.dump(2) + "\n");
}

int list(const DeviceRunOptions& options) {
  ordered_json figures;
  for (const DeviceKind& kind : device_kinds()) {
    const KindHere here = look_for(kind, options.place);
    std::printf("%s: %s\n", kind.name, kind.devices);
    if (here.library.empty() || !here.missing.empty())
      std::printf("  not here   %s\n  get it     %s\n", here.missing.c_str(), kind.source);
    else
      std::printf("  found      %s\n", here.library.c_str());
    for (const std::string& device : here.devices) std::printf("  connected  %s\n", device.c_str());
    if (!here.none.empty()) std::printf("  no device  %s\n", here.none.c_str());
    std::printf("  limits     %s\n", here.limits.c_str());
    std::fflush(stdout);
    figures["kinds"].push_back({{"kind", kind.name},
                                {"found", here.library},
                                {"missing", here.missing},
                                {"devices", here.devices},
                                {"no_device", here.none},
                                {"limits", here.limits}});
  }
  write_figures(options, figures);
  return 0;
}

const char* words(DriverReport::End end) {
  return end == DriverReport::End::signal     ? "signal"
         : end == DriverReport::End::duration ? "duration"
                                              : "device lost";
}

int run(const DeviceRunOptions& options) {
  const DeviceKind& kind = device_kind(options.kind);
  DriverOptions driver;
  driver.domain = options.domain;
  driver.device_id = options.id;
  driver.keys = options.secure;
  driver.duration = options.duration;
  driver.open_network = options.open_network;
  driver.station = options.station;
  std::unique_ptr<VendorDevice> device;
  if (!options.limits.empty()) read_device(device_path(options.limits, std::filesystem::current_path()));
  try {
    device = open_device(kind, options.place);
  } catch (const MissingLibrary& error) {
    throw std::runtime_error(std::string(error.what()) + "\nget it: " + kind.source);
  }
  const std::string name = device->name();
  driver.device = options.limits.empty() ? limits_of(kind, name) : options.limits;
  const DeviceFile file = read_device(device_path(driver.device, std::filesystem::current_path()));
  std::printf("%s\nid %u in domain %u, limits of %s: %.3g N; Ctrl-C ends\n", name.c_str(), options.id, options.domain,
              file.name.c_str(), file.limits.max_force);
  std::fflush(stdout);

  std::string fault;
  GuardReport guard;
  DriverReport report;
  {
    GuardedDevice guarded(*device, {options.dead_man});
    report = run_driver(guarded, driver);
    fault = guarded.fault();
    guard = guarded.report();
  }
  // The motors are off. A library that does not come back from closing must not keep the process.
  std::signal(SIGALRM, SIG_DFL);
  alarm(3);
  device.reset();
  alarm(0);

  std::printf("%llu states sent, %llu answered, %.1f ms without a force at most\n",
              static_cast<unsigned long long>(report.sent), static_cast<unsigned long long>(report.answered),
              report.longest_silence_ms);
  const auto pauses = [](std::uint64_t n, const char* why) {
    if (n > 0) std::printf("force held at zero %llu times: %s\n", static_cast<unsigned long long>(n), why);
  };
  pauses(guard.stale, "the device's poses came too late");
  pauses(guard.hung, "a call of the maker's library took too long");
  pauses(guard.switched_off, "the device or its library switched the motors off");
  if (report.strange_forces > 0) std::printf("a second daemon wrote forces for this device: none was felt\n");
  write_figures(options, {{"device", name},
                          {"sent", report.sent},
                          {"answered", report.answered},
                          {"longest_silence_ms", report.longest_silence_ms},
                          {"held_stale", guard.stale},
                          {"held_hung", guard.hung},
                          {"held_switched_off", guard.switched_off},
                          {"end", words(report.end)},
                          {"fault", fault}});
  if (report.end == DriverReport::End::device_lost) throw std::runtime_error("the device is lost: " + fault);
  if (report.answered == 0) throw std::runtime_error("no daemon answered in " + report.place);
  return 0;
}

}  // namespace
}  // namespace hapticd

int main(int argc, char** argv) {
  using namespace hapticd;
  CLI::App application{"Drivers of haptic devices, for hapticd."};
  application.name("haptic");
  application.require_subcommand(1);
  DeviceRunOptions options;
  application.add_flag("--open-network", options.open_network,
                       "before the command: use an interface that the DDS profile names without --secure");
  application.add_option("--station", options.station, "before the command: the daemon's station")->type_name("NAME");
  const DeviceApp device = add_device_options(application, options);
  try {
    application.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return application.exit(error) == 0 ? 0 : 2;
  }
  try {
    OutputRule(options.force).require_figures("--json", options.json);
    return device.list->parsed() ? list(options) : run(options);
  } catch (const InputError& error) {
    std::fprintf(stderr, "haptic device: %s\n", error.what());
    return 2;
  } catch (const std::invalid_argument& error) {
    std::fprintf(stderr, "haptic device: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "haptic device: %s\n", error.what());
  }
  return 1;
}
