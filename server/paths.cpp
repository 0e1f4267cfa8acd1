#include "server/paths.h"

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "server/input_error.h"

namespace hapticd {

std::filesystem::path config_directory() {
  const char* set = std::getenv("HAPTICD_CONFIG_DIR");
  return set && *set ? std::filesystem::path(set) : std::filesystem::path(HAPTICD_CONFIG_DIR);
}

std::filesystem::path device_path(const std::string& name_or_path, const std::filesystem::path& base) {
  const std::filesystem::path given(name_or_path);
  if (given.has_parent_path() || given.has_extension()) return given.is_absolute() ? given : base / given;
  return config_directory() / "devices" / (name_or_path + ".yaml");
}

std::string read_bytes(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::exists(file, error)) throw InputError(file, 0, "", "no such file");
  if (std::filesystem::is_directory(file, error)) throw InputError(file, 0, "", "is a directory, not a file");
  // /dev/zero has no end.
  if (std::filesystem::is_character_file(file, error) || std::filesystem::is_block_file(file, error))
    throw InputError(file, 0, "", "is a device, not a file");
  std::ifstream in(file, std::ios::binary);
  std::ostringstream bytes;
  if (in.peek() != std::ifstream::traits_type::eof()) bytes << in.rdbuf();
  if (!in.is_open() || in.bad() || bytes.bad()) throw InputError(file, 0, "", "cannot be read");
  return std::move(bytes).str();
}

}  // namespace hapticd
