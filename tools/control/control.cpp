// haptic reset, haptic reload: what a person asks of a running daemon (server/dds/command.h).
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/dds/command.h"
#include "server/dds/network.h"
#include "tools/cli/command.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

struct ControlOptions {
  std::string secure, role = "operator", json;
  std::uint32_t domain = 0;
  double wait = 0;
  bool force = false;
};

int run(const ControlOptions& o, ServerCommand command, const char* name) {
  OutputRule(o.force).require_figures("--json", o.json);
  std::optional<Security> security;
  if (!o.secure.empty()) security = security_files(o.secure, o.role);
  const Domain domain(o.domain, viewer_dds_profile());
  const Participant participant(domain, security);
  const CommandReply reply = ask_server(participant, command, o.wait);
  if (!reply.heard)
    throw std::runtime_error("no daemon answered in " + dds_place(o.domain, "loopback") + " within " +
                             std::to_string(static_cast<int>(o.wait)) + " s");
  if (!o.json.empty())
    write_json(o.json, {{"command", name}, {"done", reply.done}, {"message", reply.message}});
  std::fprintf(reply.done ? stdout : stderr, "%s%s\n", reply.done ? "" : "haptic: ", reply.message.c_str());
  return reply.done ? 0 : 1;
}

Command add(CLI::App& application, const char* name, const char* what, double wait, ServerCommand command,
            const char* footer) {
  auto o = std::make_shared<ControlOptions>();
  o->wait = wait;
  CLI::App* app = application.add_subcommand(name, what);
  app->add_option("--wait", o->wait, "how long to wait for the answer [s]")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app->add_option("--domain", o->domain, "DDS domain of the daemon")
      ->check(CLI::Range(0, 230))
      ->capture_default_str();
  app->add_option("--secure", o->secure, "keys for a daemon that runs with --secure")->type_name("DIR");
  app->add_option("--role", o->role, "whose keys of those")->capture_default_str();
  app->add_option("--json", o->json, "write the answer to this file")->type_name("FILE");
  add_force_option(*app, o->force);
  app->footer(footer);
  return {app, [o, command, name] { return run(*o, command, name); }};
}

}  // namespace

Command add_reset(CLI::App& application) {
  return add(application, "reset",
             "A running daemon's scene from its start: removed tissue is back, cuts are closed.", 5,
             ServerCommand::reset,
             "Example: haptic reset --domain 7\n"
             "Devices are at zero meanwhile; their forces rise in 100 ms when the scene is there again.");
}

Command add_reload(CLI::App& application) {
  return add(
      application, "reload",
      "A running daemon reads its scene's file again, as at SIGHUP; a faulty file changes nothing.", 60,
      ServerCommand::reload,
      "Example: haptic reload --domain 7\n"
      "Limits and scales are gone over to while they are felt. For any other change the simulation begins\n"
      "again with the devices at zero meanwhile. What only a restart of the daemon can take is named.");
}

}  // namespace hapticd
