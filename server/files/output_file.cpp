#include "server/files/output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "server/files/input_error.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

// A name that is nobody else's: FILE.part might be.
std::string temporary_beside(const std::string& path) {
  return path + "." + std::to_string(getpid()) + ".part";
}

constexpr const char* remedy = "; --force writes over it";

std::string beginning_of(const fs::path& file) {
  constexpr std::size_t enough = 1 << 16;
  std::string text(enough, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(text.data(), static_cast<std::streamsize>(enough));
  text.resize(static_cast<std::size_t>(in.gcount()));
  return text;
}

// The tools' figures say their command first; a daemon's are sorted by name, and have its rate.
bool is_figures(const std::string& text) {
  return text.starts_with("{\n") && (text.find("\n  \"command\": \"") != std::string::npos ||
                                     text.find("\n  \"haptic_rate_hz\": ") != std::string::npos);
}

bool is_there(const fs::path& file) {
  std::error_code error;
  return !file.empty() && fs::exists(fs::symlink_status(file, error));
}

// Renaming over a device or a pipe would take it away.
void require_regular(const std::string& option, const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (fs::exists(status) && !fs::is_regular_file(status))
    throw InputError(file, 0, option, "is there and is not a file");
}

// A place where nothing can be written is refused before the run, not at its end: whether write_file would
// find one: in the file's folder, or in the nearest one above it that is there.
// `named` is what the person named.
void require_place(const std::string& option, const fs::path& file, const fs::path& named) {
  if (file.empty()) return;
  std::error_code error;
  fs::path folder = fs::absolute(file, error).parent_path();
  while (!fs::exists(folder, error) && folder.has_relative_path()) folder = folder.parent_path();
  if (!fs::is_directory(folder, error)) throw InputError(named, 0, option, folder.string() + " is no folder");
  const std::string trial = temporary_beside((folder / file.filename()).string());
  const int descriptor = open(trial.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (descriptor < 0)
    throw InputError(named, 0, option, "cannot be written: " + folder.string() + ": " + std::strerror(errno));
  close(descriptor);
  unlink(trial.c_str());
}

void require_place(const std::string& option, const fs::path& file) { require_place(option, file, file); }

// Takes what is to be done with each entry; a folder that is not there has none.
void for_each_file(const std::string& option, const fs::path& folder, auto&& f) {
  OutputRule(false).require_folder(option, folder);
  if (!is_there(folder)) return;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) f(entry.path());
}

}  // namespace

void OutputRule::require_new(const std::string& option, const fs::path& file) const {
  std::error_code error;
  if (!is_there(file)) return require_place(option, file);
  if (fs::is_directory(file, error)) throw InputError(file, 0, option, "is a folder");
  const fs::file_status status = fs::status(file, error);
  if (fs::exists(status) && !fs::is_regular_file(status)) return;
  if (!force_) throw InputError(file, 0, option, std::string("is there already") + remedy);
}

void OutputRule::require_figures(const std::string& option, const fs::path& file) const {
  require_regular(option, file);
  require_place(option, file);
  if (!is_there(file) || force_) return;
  const std::string text = beginning_of(file);
  if (!text.empty() && !is_figures(text))
    throw InputError(file, 0, option,
                     std::string("is there already, and holds no figures of an earlier run") + remedy);
}

void OutputRule::require_table(const std::string& option, const fs::path& file,
                               const std::string& header) const {
  require_regular(option, file);
  require_place(option, file);
  if (!is_there(file) || force_) return;
  const std::string text = beginning_of(file);
  if (!text.empty() && !text.starts_with(header))
    throw InputError(file, 0, option,
                     std::string("is there already, and is no such table of an earlier run") + remedy);
}

void OutputRule::require_folder(const std::string& option, const fs::path& folder) const {
  if (folder.empty()) return;
  std::error_code error;
  if (is_there(folder) && !fs::is_directory(folder, error))
    throw InputError(folder, 0, option, "is there and is not a folder");
  require_place(option, folder / "file", folder);
}

void OutputRule::require_figures_folder(const std::string& option, const fs::path& folder,
                                        const std::string& figures, const std::string& stem) const {
  bool ours = false;
  fs::path other;
  for_each_file(option, folder, [&](const fs::path& file) {
    const std::string name = file.filename().string();
    if (name == figures && is_figures(beginning_of(file)))
      ours = true;
    else if (name == figures || name.starts_with(stem + ".") || name.starts_with(stem + "_"))
      other = file;
  });
  if (!ours && !force_ && !other.empty())
    throw InputError(other, 0, option,
                     "is there already, and the folder has no " + figures + " of an earlier run" + remedy);
}

void OutputRule::require_folder_without(const std::string& option, const fs::path& folder,
                                        const std::string& ending) const {
  for_each_file(option, folder, [&](const fs::path& file) {
    if (!force_ && file.filename().string().ends_with(ending))
      throw InputError(file, 0, option,
                       "is there already: name another folder, or --force writes over what is in this one");
  });
}

void OutputRule::require_snapshots_folder(const std::string& option, const fs::path& folder) const {
  for_each_file(option, folder, [&](const fs::path& file) {
    const std::string name = file.filename().string();
    for (const std::string when : {"before", "after"}) {
      if (force_ || !name.ends_with("_" + when + ".vtk")) continue;
      const std::string text = beginning_of(file);
      if (text.substr(0, text.find("\nASCII\n")).ends_with(" " + when + ", metres")) continue;
      throw InputError(file, 0, option,
                       std::string("is there already, and is no snapshot of an earlier run") + remedy);
    }
  });
}

std::string as_file_name(std::string name) {
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-') c = '_';
  return name;
}

std::vector<fs::path> one_file_each(const fs::path& file, const std::vector<std::string>& names) {
  std::vector<fs::path> files;
  std::vector<std::string> taken;
  // Of a folder's name, too, the slash at the end is no part.
  const fs::path first = file.has_filename() ? file : file.parent_path();
  for (const std::string& name : names) {
    if (files.empty()) {
      files.push_back(file);
      continue;
    }
    std::string part = as_file_name(name);
    if (std::find(taken.begin(), taken.end(), part) != taken.end())
      part += "_" + std::to_string(files.size());
    taken.push_back(part);
    fs::path other = first;
    files.push_back(other.replace_filename(first.stem().string() + "." + part + first.extension().string()));
  }
  return files;
}

void write_file(const std::string& path, const std::string& content) {
  std::error_code error;
  if (const fs::path folder = fs::path(path).parent_path(); !folder.empty())
    fs::create_directories(folder, error);
  const std::string beside = temporary_beside(path);
  // Made here and now: a link of that name, which somebody else laid there, is not followed.
  unlink(beside.c_str());
  const int descriptor = open(beside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  bool written = descriptor >= 0;
  if (written) {
    for (std::size_t at = 0; written && at < content.size();) {
      const ssize_t n = write(descriptor, content.data() + at, content.size() - at);
      if (n > 0)
        at += static_cast<std::size_t>(n);
      else if (errno != EINTR)
        written = false;
    }
    written = close(descriptor) == 0 && written;
    if (written) fs::rename(beside, path, error);
    if (!written || error) unlink(beside.c_str());
  }
  if (!written || error) throw std::runtime_error(path + ": cannot be written");
}

}  // namespace hapticd
