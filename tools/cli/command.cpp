#include "tools/cli/command.h"

#include <CLI/CLI.hpp>

namespace hapticd {

void add_force_option(CLI::App& command, bool& force) {
  command.add_flag("--force", force, "write over files that are there already");
}

}  // namespace hapticd
