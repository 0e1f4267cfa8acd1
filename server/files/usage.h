// What a command line got wrong, with the nearest word that would be right.
//
//   --domian 3   →  --domian: unknown option (did you mean '--domain'?)
//   reply FILE   →  reply: unknown command (did you mean 'replay'?)
//
// `check_numbers` refuses NaN and infinity in every option that takes numbers, which CLI11's ranges let
// through. Thread safety: start-up.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace hapticd {

// Of a parse that failed; empty where the error's own words are better.
std::string usage_fault(const CLI::App& app, int argc, const char* const* argv);

// For `check`: a number that is not below zero, or above it. In words, which CLI11's ranges to 1.8e308 are
// not.
extern const CLI::Validator not_negative, positive;

// Of the commands that were parsed. Throws CLI::ValidationError naming the option.
void check_numbers(const CLI::App& app);

}  // namespace hapticd
