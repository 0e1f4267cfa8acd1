#include "server/files/paths.h"

#include <dlfcn.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>

#include "server/files/input_error.h"

namespace hapticd {

namespace {

namespace fs = std::filesystem;

const char* set_by_user() {
  const char* set = std::getenv("HAPTICD_CONFIG_DIR");
  return set && *set ? set : nullptr;
}

// The shared library that this code is part of; empty where it is part of the program itself.
fs::path own_library(const fs::path& program) {
  Dl_info found{};
  if (!dladdr(reinterpret_cast<const void*>(&config_directory), &found) || !found.dli_fname) return {};
  std::error_code error;
  const fs::path file = fs::canonical(found.dli_fname, error);
  return error || file == program ? fs::path() : file;
}

}  // namespace

fs::path config_directory() {
  if (const char* set = set_by_user()) return set;
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  // PREFIX/lib/x86_64-linux-gnu/libhaptic_client.so.0 has it in PREFIX/share.
  fs::path above = own_library(program).parent_path();
  for (int i = 0; i < 3 && above.has_relative_path(); ++i) {
    above = above.parent_path();
    if (const fs::path beside = above / "share/hapticd"; fs::is_directory(beside, error))
      return fs::canonical(beside, error);
  }
  // Without the links in it, so that what lies beside the configuration is found too.
  const fs::path near = fs::canonical(program.parent_path() / "../share/hapticd", error);
  return !error && fs::is_directory(near, error) ? near : fs::path(HAPTICD_CONFIG_DIR);
}

fs::path config_file(const fs::path& relative) {
  std::error_code error;
  const fs::path own = fs::path(HAPTICD_LOCAL_CONFIG_DIR) / relative;
  return !set_by_user() && fs::exists(own, error) ? own : config_directory() / relative;
}

std::filesystem::path device_path(const std::string& name_or_path, const std::filesystem::path& base) {
  const std::filesystem::path given(name_or_path);
  if (given.has_parent_path() || given.has_extension()) return given.is_absolute() ? given : base / given;
  return config_file(fs::path("devices") / (name_or_path + ".yaml"));
}

bool is_file(const std::filesystem::path& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

std::string read_bytes(const std::filesystem::path& file) {
  std::error_code error;
  const bool there = std::filesystem::exists(file, error);
  if (error) throw InputError(file, 0, "", "cannot be read: " + error.message());
  if (!there) throw InputError(file, 0, "", "no such file");
  if (std::filesystem::is_directory(file, error)) throw InputError(file, 0, "", "is a directory, not a file");
  // /dev/zero has no end.
  if (std::filesystem::is_character_file(file, error) || std::filesystem::is_block_file(file, error))
    throw InputError(file, 0, "", "is a device, not a file");
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  if (!in.is_open()) throw InputError(file, 0, "", std::string("cannot be read: ") + std::strerror(errno));
  std::ostringstream bytes;
  if (in.peek() != std::ifstream::traits_type::eof()) bytes << in.rdbuf();
  if (in.bad() || bytes.bad()) throw InputError(file, 0, "", "cannot be read");
  return std::move(bytes).str();
}

}  // namespace hapticd
