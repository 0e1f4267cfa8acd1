// Has another library's calls of a C function come here: for a shared library that hides its symbols.
//
// A program that defines `recvmsg` is asked by every library before libc is. A library that somebody opens is
// not, so the entry for it in the other library's table of calls (ELF relocations by name) is written over,
// once, for as long as the process lives. Every user of that library in the process then calls `to`. Thread
// safety: one at a time, before the calls begin. Errors: null where the library is not loaded or its table
// has no such entry.
#pragma once

namespace hapticd {

// library: how the file's name begins ("libddsc.so"). Returns what was called before: `to` should go on with
// it.
void* redirect_calls(const char* library, const char* function, void* to) noexcept;

}  // namespace hapticd
