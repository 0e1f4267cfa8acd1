// haptic: what a person does with a running daemon, one subcommand each.
#include <cstdio>
#include <exception>

#include "physics/compliance/blas_threads.h"
#include "server/dds/dds.h"
#include "server/dds/network.h"
#include "server/files/input_error.h"
#include "server/files/usage.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"

namespace {

// Before the command, for all of them alike.
void add_network_options(CLI::App& application, hapticd::Network& network) {
  CLI::Option* interface =
      application
          .add_option("--interface", network.interface,
                      "before the command: the daemon is on this network, a name or an address of this machine there")
          ->check(hapticd::network_name_fault)
          ->type_name("NAME");
  application
      .add_option("--peers", network.peers,
                  "before the command: machines to look for there: HOST,HOST; default: whoever hears its multicast")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(hapticd::network_name_fault)
      ->needs(interface)
      ->type_name("HOST");
  application
      .add_option("--station", network.station,
                  "before the command: the daemon's station, as its --station says")
      ->check(hapticd::network_name_fault)
      ->type_name("NAME");
}

}  // namespace

int main(int argc, char** argv) {
  using namespace hapticd;
  use_one_blas_thread();
  CLI::App application{"Clients of hapticd, the haptic server for soft tissue that is being cut."};
  application.name("haptic");
  application.require_subcommand(1);
  application.set_version_flag("--version", std::string("haptic ") + HAPTICD_VERSION);
  application.set_help_all_flag("--help-all", "Print the help of every subcommand and exit");
  application.footer(
      "Example: haptic replay config/scenes/cataract/stroke.csv --json figures.json\n"
      "Exit codes: 0 done, 1 failed, 2 wrong usage or input.");
  const Command commands[] = {add_replay(application), add_hand(application),   add_chart(application),
                              add_soak(application),   add_abuse(application),  add_mesh(application),
                              add_doctor(application), add_record(application), add_stability(application),
                              add_view(application),   add_device(application), add_reset(application),
                              add_reload(application), add_edge(application),   add_fleet(application)};
  Network network;
  add_network_options(application, network);
  application.add_flag_callback(
      "--open-network", open_network,
      "before the command: use an interface that the DDS profile names without --secure; "
      "whoever is on that network is trusted");
  try {
    application.parse(argc, argv);
    check_numbers(application);
    use_network(network);
  } catch (const CLI::ParseError& error) {
    const std::string fault = error.get_exit_code() == 0 ? "" : usage_fault(application, argc, argv);
    if (fault.empty()) return application.exit(error) == 0 ? 0 : 2;
    std::fprintf(stderr, "haptic: %s\nRun with --help for more information.\n", fault.c_str());
    return 2;
  }
  catch_interrupts();
  try {
    for (const Command& command : commands)
      if (command.app->parsed()) return command.run();
  } catch (const InputError& error) {
    std::fprintf(stderr, "haptic: %s\n", error.what());
    return 2;
  } catch (const UsageError& error) {
    std::fprintf(stderr, "haptic: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "haptic: %s\n", error.what());
  }
  return 1;
}
