// The completion file is written by hand: every subcommand and option must be in what it offers.
#include <gtest/gtest.h>

#include <regex>
#include <set>

#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

// What bash would offer after these words.
std::set<std::string> offered(const std::string& program, const std::string& words) {
  const std::string script =
      "PATH=" BIN_DIR ":$PATH; source " SOURCE_DIR "/tools/packaging/completion.bash; COMP_WORDS=(" + words +
      "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _" + program + "; printf \"%s\\n\" \"${COMPREPLY[@]}\"";
  std::istringstream lines(run_command("bash -c '" + script + "'").output);
  std::set<std::string> out;
  for (std::string line; std::getline(lines, line);) out.insert(line);
  return out;
}

std::set<std::string> subcommands(const std::string& of) {
  const std::string help = run_haptic(of + " --help").output;
  std::set<std::string> out;
  const std::regex name("\n  ([a-z]+) ");
  const std::string list = help.substr(help.find("Subcommands:"));
  for (std::sregex_iterator i(list.begin(), list.end(), name); i != std::sregex_iterator(); ++i)
    out.insert((*i)[1]);
  return out;
}

TEST(Completion, HasEverySubcommand) {
  const std::set<std::string> all = subcommands("");
  EXPECT_GE(all.size(), 7u);
  EXPECT_EQ(offered("haptic", "haptic \"\""), all);
  EXPECT_EQ(offered("haptic", "haptic chart \"\""), subcommands("chart"));
  EXPECT_EQ(offered("haptic", "haptic doc"), std::set<std::string>{"doctor"});
}

TEST(Completion, OptionsAreThoseOfTheHelp) {
  EXPECT_EQ(offered("haptic", "haptic replay --uni"), std::set<std::string>{"--units"});
  EXPECT_EQ(offered("haptic", "haptic chart removal --qui"), std::set<std::string>{"--quick"});
  EXPECT_EQ(offered("hapticd", "hapticd --met"), std::set<std::string>{"--metrics"});
}

}  // namespace
}  // namespace hapticd
