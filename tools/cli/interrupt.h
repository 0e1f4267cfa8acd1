// Ctrl-C and SIGTERM as a flag, so that a command can let go of the device before it ends.
#pragma once

namespace hapticd {

// From now on SIGINT and SIGTERM only set the flag; a second one ends the process at once.
void catch_interrupts();
bool interrupted() noexcept;

}  // namespace hapticd
