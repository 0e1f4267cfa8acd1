// Keys of an authority, made once for all tests of a process, in a directory that is gone with it.
#pragma once

#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "tests/tools/run_command.h"

namespace hapticd {

inline const ScratchDirectory& secure_scratch() {
  static const ScratchDirectory directory;
  return directory;
}

// Another name: of another authority.
inline std::string secure_keys(const std::string& name = "keys") {
  const std::string directory = secure_scratch().file(name);
  if (!std::filesystem::exists(directory)) {
    const CommandResult made =
        run_command(SOURCE_DIR "/config/dds/security/make_keys.sh " + directory + " 30");
    EXPECT_EQ(made.code, 0) << made.output;
  }
  return directory;
}

}  // namespace hapticd
