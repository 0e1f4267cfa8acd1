// haptic chart: measurements of the methods themselves, without a daemon.
#include <CLI/CLI.hpp>
#include <vector>

#include "tools/cli/command.h"

namespace hapticd {

Command add_chart(CLI::App& application) {
  CLI::App* chart = application.add_subcommand("chart", "Measures the methods themselves; needs no daemon.");
  chart->require_subcommand(1);
  chart->footer("Example: haptic chart removal --quick");
  const std::vector<Command> charts = {
      add_chart_removal(*chart), add_chart_cut(*chart),     add_chart_warping(*chart), add_chart_lcp(*chart),
      add_chart_tissue(*chart),  add_chart_economy(*chart), add_chart_force(*chart),   add_chart_step(*chart),
      add_chart_pieces(*chart),  add_chart_all(*chart),     add_chart_merge(*chart)};
  return {chart, [charts] {
            for (const Command& c : charts)
              if (c.app->parsed()) return c.run();
            return 1;
          }};
}

}  // namespace hapticd
