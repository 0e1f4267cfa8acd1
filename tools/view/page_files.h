// The page: its files by the path that a browser asks for, read once at the start.
//
// "/" is the index, index.html or one that is named. Nothing is looked up on the disk for a request, so no
// path leads out of the folder. Files of other kinds than a page is made of, hidden ones and links are not
// part of it. Errors: InputError where the folder or its index.html is missing.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

namespace hapticd {

struct PageFile {
  std::string type;  // of the content
  std::string bytes;
};

class PageFiles {
 public:
  explicit PageFiles(const std::filesystem::path& folder, const std::string& index = "index.html");

  // target: as in the request; what follows a '?' is left out, %-sequences are not decoded. Null: no such
  // file.
  const PageFile* find(std::string_view target) const;
  std::size_t count() const noexcept { return files_.size(); }

 private:
  std::map<std::string, PageFile, std::less<>> files_;
  std::string index_;
};

// The folder of the installed page, or of the source's.
std::filesystem::path page_folder();

}  // namespace hapticd
