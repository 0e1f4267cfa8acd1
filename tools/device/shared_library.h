// A maker's library, found at run time.
//
// Errors: MissingLibrary, naming what was looked for and what the loader answered; std::runtime_error naming
// the first function that the library lacks. Thread safety: one thread. A library stays loaded until the process ends, because
// makers' libraries leave threads behind.
#pragma once

#include <dlfcn.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace hapticd {

// Nothing is installed, or nothing runs, for a kind of device.
class MissingLibrary : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class SharedLibrary {
 public:
  // The first of `names` that loads; `path` alone where it is not empty.
  SharedLibrary(const std::vector<std::string>& names, const std::string& path);

  const std::string& path() const noexcept { return path_; }

  // A function by its name; false where the library has none.
  template <typename Function>
  bool find(const char* name, Function*& function) const noexcept {
    function = reinterpret_cast<Function*>(dlsym(handle_, name));
    return function != nullptr;
  }
  template <typename Function>
  void need(const char* name, Function*& function) const {
    if (!find(name, function)) lacks(name);
  }

 private:
  [[noreturn]] void lacks(const char* name) const;

  void* handle_ = nullptr;
  std::string path_;
};

}  // namespace hapticd
