// The tests' main: as the programs', one BLAS thread before anything is factored.
#include <gtest/gtest.h>

#include "physics/compliance/blas_threads.h"

int main(int argc, char** argv) {
  hapticd::use_one_blas_thread();
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
