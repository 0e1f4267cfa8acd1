// A subcommand of `haptic`: it declares its options on the application and is run by main if chosen.
//
// Exit codes: 0 it did what it says; 1 it could not; 2 wrong usage or input. `run` returns 0 or 1 and throws
// UsageError or InputError for 2, anything else for 1.
#pragma once

#include <functional>
#include <stdexcept>

namespace CLI {
class App;
}

namespace hapticd {

class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct Command {
  CLI::App* app = nullptr;
  std::function<int()> run;
};

// For OutputRule (server/files/output_file.h).
void add_force_option(CLI::App& command, bool& force);

Command add_replay(CLI::App& application);
Command add_hand(CLI::App& application);
Command add_chart(CLI::App& application);
Command add_mesh(CLI::App& application);
Command add_reset(CLI::App& application);
Command add_reload(CLI::App& application);
Command add_record(CLI::App& application);
Command add_soak(CLI::App& application);
Command add_abuse(CLI::App& application);
Command add_device(CLI::App& application);
Command add_edge(CLI::App& application);
Command add_fleet(CLI::App& application);
Command add_doctor(CLI::App& application);
Command add_stability(CLI::App& application);
Command add_view(CLI::App& application);
Command add_chart_removal(CLI::App& chart);
Command add_chart_cut(CLI::App& chart);
Command add_chart_warping(CLI::App& chart);
Command add_chart_lcp(CLI::App& chart);
Command add_chart_economy(CLI::App& chart);
Command add_chart_tissue(CLI::App& chart);
Command add_chart_force(CLI::App& chart);
Command add_chart_all(CLI::App& chart);
Command add_chart_step(CLI::App& chart);
Command add_chart_pieces(CLI::App& chart);
Command add_chart_merge(CLI::App& chart);

}  // namespace hapticd
