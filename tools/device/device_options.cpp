#include "tools/device/device_options.h"

#include <CLI/CLI.hpp>

namespace hapticd {
namespace {

void add_place(CLI::App& app, DevicePlace& place) {
  app.add_option("--library", place.library, "the maker's library, where the loader does not find it");
  app.add_option("--service", place.service, "PORT or HOST:PORT of Haply's Inverse service (127.0.0.1:10001)");
}

void add_figures(CLI::App& app, DeviceRunOptions& options) {
  app.add_option("--json", options.json, "write the figures to this file");
  app.add_flag("--force", options.force, "write over files that are there already");
}

}  // namespace

DeviceApp add_device_options(CLI::App& application, DeviceRunOptions& options) {
  DeviceApp out;
  out.app = application.add_subcommand("device", "drives a haptic device that you own");
  out.app->require_subcommand(1);
  out.app->footer(
      "Makers' libraries are found at run time; none is needed to build or to install this.\n"
      "Example: haptic device list\nExample: haptic device run openhaptics --scene-id 0");
  out.list = out.app->add_subcommand("list", "what is installed and connected, kind by kind");
  add_place(*out.list, options.place);
  add_figures(*out.list, options);
  out.list->footer("Devices are opened with their motors off, and closed.\nExample: haptic device list");

  out.run = out.app->add_subcommand("run", "drives one device until Ctrl-C");
  std::string kinds;
  for (const DeviceKind& kind : device_kinds()) kinds += std::string(kinds.empty() ? "" : ", ") + kind.name;
  out.run->add_option("KIND", options.kind, kinds)->required();
  out.run->add_option("--scene-id", options.id, "id of the scene's device that this one is")->capture_default_str();
  out.run->add_option("--domain", options.domain, "DDS domain of the daemon")->capture_default_str();
  out.run->add_option("--device", options.place.device,
                      "which of several: the number of `device list`, the maker's name of it (openhaptics), its id "
                      "(inverse3)");
  out.run->add_option("--limits", options.limits,
                      "the device's limits: a name of config/devices, or a file (what `device list` says)");
  out.run->add_option("--dead-man", options.dead_man, "no force unless this button is held; 1 is the first")
      ->check(CLI::Range(0, 32));
  add_place(*out.run, options.place);
  out.run->add_option("--secure", options.secure,
                      "keys for a daemon that runs with --secure: DIR from config/dds/security/make_keys.sh");
  out.run->add_option("--duration", options.duration, "end after so many seconds; 0: until Ctrl-C")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  add_figures(*out.run, options);
  out.run->footer(
      "Buttons: the maker's first is phaco, the second aspiration.\n"
      "Example: haptic device run force-dimension --scene-id 0 --dead-man 1");
  return out;
}

}  // namespace hapticd
