// What is wrong with a file a person wrote, and where: `FILE:LINE: KEY: what (and what would be right)`.
//
// Line is 1-based; 0 means the file has no lines (binary) or the fault is not at one. KEY is the path of
// the value in a YAML file (bodies[0].material.young), the section of a mesh file ($Elements), or the
// column of a CSV file. Programs answer it with exit code 2.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <utility>

namespace hapticd {

class InputError : public std::runtime_error {
 public:
  InputError(std::filesystem::path file, int line, std::string key, const std::string& what)
      : std::runtime_error(file.string() + (line > 0 ? ":" + std::to_string(line) : "") + ": " +
                           (key.empty() ? "" : key + ": ") + what),
        file_(std::move(file)),
        line_(line),
        key_(std::move(key)) {}

  const std::filesystem::path& file() const noexcept { return file_; }
  int line() const noexcept { return line_; }
  const std::string& key() const noexcept { return key_; }

 private:
  std::filesystem::path file_;
  int line_;
  std::string key_;
};

}  // namespace hapticd
