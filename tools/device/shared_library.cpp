#include "tools/device/shared_library.h"

#include <link.h>

namespace hapticd {

SharedLibrary::SharedLibrary(const std::vector<std::string>& names, const std::string& path) {
  std::string answers;
  for (const std::string& name : path.empty() ? names : std::vector{path}) {
    handle_ = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (handle_) {
      link_map* map = nullptr;
      path_ = dlinfo(handle_, RTLD_DI_LINKMAP, &map) == 0 && map->l_name[0] ? map->l_name : name;
      return;
    }
    const char* answer = dlerror();
    answers += (answers.empty() ? "" : "; ") + std::string(answer ? answer : "not loaded");
  }
  throw MissingLibrary(answers);
}

void SharedLibrary::lacks(const char* name) const {
  throw std::runtime_error(path_ + " has no function " + name + ": is it the maker's library, and new enough?");
}

}  // namespace hapticd
