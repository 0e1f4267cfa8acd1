#include "tools/view/page_files.h"

#include "server/files/input_error.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

// Empty: not part of a page.
std::string type_of(const fs::path& file) {
  static const std::map<std::string, std::string> types = {{".html", "text/html; charset=utf-8"},
                                                           {".css", "text/css; charset=utf-8"},
                                                           {".js", "text/javascript; charset=utf-8"},
                                                           {".svg", "image/svg+xml"},
                                                           {".LICENSE", "text/plain; charset=utf-8"}};
  const auto found = types.find(file.extension().string());
  return found == types.end() ? std::string() : found->second;
}

}  // namespace

PageFiles::PageFiles(const fs::path& folder, const std::string& index) : index_("/" + index) {
  std::error_code error;
  for (fs::recursive_directory_iterator i(folder, error), end; !error && i != end; i.increment(error)) {
    const fs::path& file = i->path();
    const std::string type = type_of(file);
    if (i->is_symlink() || !i->is_regular_file() || type.empty() || file.filename().string().starts_with('.'))
      continue;
    files_["/" + file.lexically_relative(folder).generic_string()] = {type, read_bytes(file)};
  }
  if (!files_.contains(index_))
    throw InputError(folder / index, 0, "", "the page's files are not there: is hapticd installed whole?");
}

const PageFile* PageFiles::find(std::string_view target) const {
  target = target.substr(0, target.find_first_of("?#"));
  const auto found = files_.find(target == "/" ? std::string_view(index_) : target);
  return found == files_.end() ? nullptr : &found->second;
}

fs::path page_folder() {
  std::error_code error;
  const fs::path installed = config_directory() / "view";
  return fs::is_directory(installed, error) ? installed : config_directory() / "../tools/view/page";
}

}  // namespace hapticd
