// How many threads OpenBLAS uses in this process. It is one setting for the whole process, so a program makes
// it: first in `main`, before anything is factored; no compliance does it.
//
//   int main() { use_one_blas_thread(); … }
//
// More than one loses on fronts as small as ours, and its workers would fight the haptic thread for its core.
// Those that it made before `main` end: they block no signal, and while METIS orders it has a SIGTERM handler
// of its own, which in a thread that is not its caller's crashes the process or loses the signal.
#pragma once

namespace hapticd {

// Without effect where the reference BLAS was linked, which has one anyway.
void use_one_blas_thread() noexcept;

[[nodiscard]] int blas_threads() noexcept;

}  // namespace hapticd
