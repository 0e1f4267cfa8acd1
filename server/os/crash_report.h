// Says where the process crashes, and lets it: signal, thread and the calls that led there, on standard error.
//
// Calls are addresses in files, as addr2line and gdb take them: hapticd(+0x48b87b). What the default action
// would have done follows, a core file included. A thread that has used up its stack cannot say anything.
// Thread safety: once, at start-up. Errors: none.
#pragma once

namespace hapticd {

void report_crashes() noexcept;

}  // namespace hapticd
