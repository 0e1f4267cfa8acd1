#include "server/files/usage.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "server/files/yaml_keys.h"

namespace hapticd {
namespace {

std::vector<std::string> long_options(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options())
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  return names;
}

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

std::string unknown(const std::string& word, const std::string& what, const std::vector<std::string>& known) {
  const std::string hint = did_you_mean(word, known);
  return word + ": unknown " + what + " (" + (hint.empty() ? "known: " + listed(known) : hint) + ")";
}

bool takes_numbers(const CLI::Option& option) {
  const std::string type = option.get_type_name();  // FLOAT, or X,Y,Z
  return type.find("FLOAT") != std::string::npos || type.find(',') != std::string::npos;
}

// The fault of a text that is no finite number for which `is_right` holds.
template <typename IsRight>
CLI::Validator number(const char* words, const char* name, IsRight is_right) {
  return CLI::Validator(
      [words, is_right](std::string& text) {
        char* end = nullptr;
        const double x = std::strtod(text.c_str(), &end);
        const bool is_number = !text.empty() && *end == '\0' && std::isfinite(x);
        return is_number && is_right(x) ? std::string() : "'" + text + "' is no number " + words;
      },
      name);
}

}  // namespace

const CLI::Validator not_negative = number("of at least 0", "NONNEGATIVE", [](double x) { return x >= 0; });
const CLI::Validator positive = number("above 0", "POSITIVE", [](double x) { return x > 0; });

std::string usage_fault(const CLI::App& app, int argc, const char* const* argv) {
  const CLI::App* at = &app;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i], name = word.substr(0, word.find('='));
    if (word == "--") break;
    if (word.starts_with("--")) {
      const CLI::Option* option = at->get_option_no_throw(name);
      if (!option) return unknown(name, "option", long_options(*at));
      // Its values are no commands.
      if (name == word && option->get_items_expected_min() > 0) i += option->get_items_expected_min();
      continue;
    }
    const std::vector<const CLI::App*> commands = commands_of(*at);
    if (commands.empty() || word.starts_with('-')) continue;
    const auto next = std::find_if(commands.begin(), commands.end(),
                                   [&](const CLI::App* command) { return command->get_name() == word; });
    if (next == commands.end()) {
      std::vector<std::string> names;
      for (const CLI::App* command : commands) names.push_back(command->get_name());
      return unknown(word, "command", names);
    }
    at = *next;
  }
  return {};
}

void check_numbers(const CLI::App& app) {
  for (const CLI::Option* option : app.get_options()) {
    if (option->count() == 0 || !takes_numbers(*option)) continue;
    for (const std::string& text : option->results())
      if (!std::isfinite(std::strtod(text.c_str(), nullptr)))
        throw CLI::ValidationError(option->get_name(), "'" + text + "' is no finite number");
  }
  for (const CLI::App* command : app.get_subcommands()) check_numbers(*command);
}

}  // namespace hapticd
