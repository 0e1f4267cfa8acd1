// haptic fleet: all stations of a domain, live: a table, JSON, or a page with a tile for each.
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <thread>

#include "haptic/clock.h"
#include "server/dds/network.h"
#include "server/files/usage.h"
#include "server/os/realtime.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/report.h"
#include "tools/fleet/fleet_reader.h"
#include "tools/fleet/fleet_text.h"
#include "tools/fleet/station_views.h"
#include "tools/view/page_service.h"

namespace hapticd {
namespace {

constexpr std::chrono::milliseconds turn{50};
constexpr std::int64_t second_ns = 1'000'000'000, page_ns = 500'000'000;

struct FleetOptions {
  PageServerSettings server{.address = "127.0.0.1", .port = 8090};
  std::string json, secure, role = "viewer", page_files;
  std::uint32_t domain = 0;
  bool once = false, page = false, force = false;
  double wait = 1.5, duration = 0;
};

// True once in each period, and the first time.
class Every {
 public:
  explicit Every(std::int64_t period_ns) : period_ns_(period_ns) {}
  bool is_due(std::int64_t now_ns) {
    if (last_ns_ != 0 && now_ns - last_ns_ < period_ns_) return false;
    last_ns_ = now_ns;
    return true;
  }

 private:
  std::int64_t period_ns_, last_ns_ = 0;
};

// What every way of showing the fleet has: the stations, and a file that is renewed each second.
struct Watch {
  Watch(const FleetOptions& options, const Participant& participant) : o(options), reader(participant) {}

  std::vector<std::string> poll() {
    std::vector<std::string> changed = reader.poll();
    now_ns = monotonic_ns();
    if (!o.json.empty() && !o.once && file.is_due(now_ns)) write();
    return changed;
  }
  void write() const {
    if (!o.json.empty()) write_json(o.json, to_json(reader.fleet(), o.domain, now_ns));
  }
  const std::map<std::string, Station>& stations() const { return reader.fleet().stations(); }

  const FleetOptions& o;
  FleetReader reader;
  Every file{second_ns};
  std::int64_t now_ns = 0;
};

std::size_t terminal_width() {
  winsize size{};
  return ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 1000;
}

std::string place(const FleetOptions& o) {
  const Network& network = process_network();
  return "domain " + std::to_string(o.domain) +
         (network.interface.empty() ? ", this machine alone" : ", interface " + network.interface) +
         (network.station.empty() ? "" : ", station " + network.station + " alone");
}

std::string head(const Watch& w) {
  const nlohmann::ordered_json counts = to_json(w.reader.fleet(), w.o.domain, w.now_ns)["counts"];
  std::string text =
      std::to_string(w.stations().size()) + (w.stations().size() == 1 ? " station" : " stations");
  for (const auto& [state, count] : counts.items())
    if (count > 0) text += ", " + std::to_string(count.get<int>()) + " " + state;
  if (w.reader.fleet().left_out() > 0)
    text += ", more are left out (" + std::to_string(most_stations) + " stations, " +
            std::to_string(most_devices) + " devices each)";
  return text + "   (" + place(w.o) + ")\n\n";
}

std::string table(const Watch& w, bool terminal) {
  if (w.stations().empty())
    return "No station is heard in " + place(w.o) + ". haptic --interface NAME fleet looks at a network.\n";
  return head(w) + table_of(w.reader.fleet(), w.now_ns, terminal ? terminal_width() : 1000, terminal);
}

int show_once(Watch& w) {
  const std::int64_t until = monotonic_ns() + static_cast<std::int64_t>(1e9 * w.o.wait);
  while (!interrupted() && monotonic_ns() < until) {
    w.poll();
    std::this_thread::sleep_for(turn);
  }
  w.poll();
  std::fputs(table(w, isatty(STDOUT_FILENO) == 1).c_str(), stdout);
  w.write();
  return w.stations().empty() ? 1 : 0;
}

// On a terminal the table, renewed in place; elsewhere a line for each change.
int show_table(Watch& w) {
  const bool terminal = isatty(STDOUT_FILENO) == 1;
  const std::int64_t begun = monotonic_ns();
  Every draw(second_ns);
  while (!interrupted()) {
    const std::vector<std::string> changed = w.poll();
    if (terminal && (draw.is_due(w.now_ns) || !changed.empty()))
      std::printf("\x1b[H\x1b[J%s", table(w, true).c_str());
    for (const std::string& name : changed) {
      const auto s = w.stations().find(name);
      if (terminal || s == w.stations().end()) continue;
      std::string faults;
      for (const StationFault& f : s->second.faults)
        faults += "  " + f.what + (f.detail.empty() ? "" : " " + f.detail);
      std::printf("%s  %s%s\n", name.empty() ? "(no name)" : name.c_str(), word(s->second.state),
                  faults.c_str());
    }
    std::fflush(stdout);
    if (w.o.duration > 0 && 1e-9 * static_cast<double>(w.now_ns - begun) > w.o.duration) break;
    std::this_thread::sleep_for(turn);
  }
  w.write();
  return 0;
}

// A message for each station, at once where something changed; and the names, so that a page knows who is
// gone.
class FleetPage {
 public:
  FleetPage(Watch& watch, StationViews& views) : watch_(watch), views_(views) {}

  std::vector<SharedMessage> poll() {
    std::vector<SharedMessage> out;
    const std::vector<std::string> changed = watch_.poll();
    const bool all = every_.is_due(watch_.now_ns);
    nlohmann::ordered_json names = nlohmann::json::array();
    for (const auto& [name, s] : watch_.stations()) {
      names.push_back(name);
      if (!all && std::find(changed.begin(), changed.end(), name) == changed.end()) continue;
      nlohmann::ordered_json j = to_json(s, watch_.now_ns);
      j["kind"] = "station";
      out.push_back(page_text("station/" + name, j.dump()));
    }
    if (all || names != names_) {
      names_ = names;
      out.push_back(page_text(
          "fleet", nlohmann::json{{"kind", "fleet"}, {"place", place(watch_.o)}, {"names", names}}.dump()));
    }
    for (const StationViews::Answer& a : views_.poll()) out.push_back(told(a));
    for (const StationViews::Answer& a : std::exchange(asked_, {})) out.push_back(told(a));
    return out;
  }

  // {"open": station}
  void hear(const std::string& text) {
    const nlohmann::json said = nlohmann::json::parse(text, nullptr, false);
    if (!said.is_object() || !said.contains("open") || !said["open"].is_string()) return;
    const std::string station = said["open"];
    if (watch_.stations().contains(station)) asked_.push_back(views_.open(station));
  }

 private:
  static SharedMessage told(const StationViews::Answer& a) {
    return page_text(
        "view/" + a.station,
        nlohmann::json{{"kind", "view"}, {"station", a.station}, {"port", a.port}, {"fault", a.fault}}
            .dump());
  }

  Watch& watch_;
  StationViews& views_;
  Every every_{page_ns};
  nlohmann::ordered_json names_;
  std::vector<StationViews::Answer> asked_;
};

int show_page(Watch& w, bool open) {
  StationViews views({w.o.server.address, w.o.secure, w.o.role, w.o.domain, open});
  FleetPage page(w, views);
  const std::filesystem::path folder =
      w.o.page_files.empty() ? page_folder() : std::filesystem::path(w.o.page_files);
  serve_page(
      {.server = w.o.server,
       .command = "haptic fleet",
       .exposed = "sees all stations",
       .duration = w.o.duration,
       .turn = turn},
      PageFiles(folder, "fleet/index.html"), [&](bool) { return page.poll(); },
      [&](std::uint64_t, const std::string& text) { page.hear(text); });
  w.write();
  return 0;
}

int run_fleet(const FleetOptions& o) {
  OutputRule(o.force).require_figures("--json", o.json);
  std::optional<Security> security;
  if (!o.secure.empty()) security = security_files(o.secure, o.role);
  stand_back();  // before there are threads
  const Domain domain(o.domain, viewer_dds_profile());
  const Participant participant(domain, security);
  Watch watch(o, participant);
  if (o.once) return show_once(watch);
  return o.page ? show_page(watch, is_network_open()) : show_table(watch);
}

}  // namespace

Command add_fleet(CLI::App& application) {
  auto o = std::make_shared<FleetOptions>();
  CLI::App* app = application.add_subcommand(
      "fleet", "Shows all stations on a network, live: a table, JSON, or a page with a tile for each.");
  CLI::Option* once = app->add_flag(
      "--once", o->once, "listen for --wait seconds, print the table, end; 1 where nobody is heard");
  app->add_option("--wait", o->wait, "with --once: how long to listen [s]")
      ->check(not_negative)
      ->needs(once)
      ->capture_default_str();
  app->add_option("--json", o->json, "write what the stations say to this file, renewed each second")
      ->type_name("FILE");
  CLI::Option* page =
      app->add_flag("--page", o->page, "a page in the browser instead of the table")->excludes(once);
  app->add_option("--port", o->server.port, "of the page; 0: any free one")
      ->needs(page)
      ->capture_default_str();
  app->add_option(
         "--listen", o->server.address,
         "address of the page; others than loopback show the stations to whoever reaches this machine, "
         "without password or TLS")
      ->type_name("ADDRESS")
      ->needs(page)
      ->capture_default_str();
  app->add_option("--page-files", o->page_files, "the page's files, if not the installed ones")
      ->type_name("DIR")
      ->needs(page);
  app->add_option("--domain", o->domain, "DDS domain of the stations")
      ->check(CLI::Range(0u, 230u))
      ->capture_default_str();
  app->add_option("--secure", o->secure, "keys for daemons that run with --secure")->type_name("DIR");
  app->add_option("--role", o->role, "whose keys of those")
      ->check(CLI::IsMember({"viewer", "operator"}))
      ->capture_default_str();
  app->add_option("--duration", o->duration, "stop after so many seconds; 0: at Ctrl-C")
      ->check(not_negative)
      ->excludes(once)
      ->capture_default_str();
  add_force_option(*app, o->force);
  app->footer(
      "It hears every station of the domain; haptic --station NAME fleet hears that one alone. Stations do "
      "not wait for "
      "it or answer it.\n"
      "Example: haptic fleet\n"
      "Example: haptic --interface eth0 --open-network fleet --page\n"
      "Example: haptic fleet --once --json stations.json");
  return {app, [o] { return run_fleet(*o); }};
}

}  // namespace hapticd
