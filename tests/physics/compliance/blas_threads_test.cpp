#include "physics/compliance/blas_threads.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <iterator>

#include "tests/physics/compliance/oracle.h"

#ifdef HAPTICD_OPENBLAS
extern "C" void openblas_set_num_threads(int threads);
#endif

namespace hapticd {
namespace {

TEST(BlasThreads, ThisProgramHasOne) { EXPECT_EQ(blas_threads(), 1); }

// One that waits would take a signal that the program's own threads block.
TEST(BlasThreads, NoneIsLeftThatTheProgramDidNotMake) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the sanitizer has one of its own";
#endif
  use_one_blas_thread();
  const std::filesystem::directory_iterator tasks("/proc/self/task");
  EXPECT_EQ(std::distance(begin(tasks), end(tasks)), 1);
}

// A setting of the whole process is the program's: no factory and no factorisation changes it.
TEST(BlasThreads, AreNotSetByAnyCompliance) {
#ifdef HAPTICD_OPENBLAS
  openblas_set_num_threads(2);
  const int before = blas_threads();  // 1 on a machine with one core
  const TissueModel model = oracle::box(2);
  for (const auto method : {ComplianceMethod::exact, ComplianceMethod::zone, ComplianceMethod::lazy,
                            ComplianceMethod::updown, ComplianceMethod::dense}) {
    make_compliance(method, model, oracle::h)->update(rest_state(model));
    EXPECT_EQ(blas_threads(), before);
  }
  use_one_blas_thread();
  EXPECT_EQ(blas_threads(), 1);
#else
  GTEST_SKIP() << "the reference BLAS has one thread";
#endif
}

}  // namespace
}  // namespace hapticd
