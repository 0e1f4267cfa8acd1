#include "server/mesh/mesh_reader_cursor.h"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <cstring>

namespace hapticd {
namespace {

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\v' || c == '\f'; }

std::string quoted(std::string_view token) {
  std::string text = "'";
  for (char c : token.substr(0, 24)) text += c >= ' ' && c <= '~' ? c : '?';
  return text + (token.size() > 24 ? "…'" : "'");
}

}  // namespace

void MeshCursor::skip_space() {
  for (; at_ < bytes_.size() && is_space(bytes_[at_]); ++at_)
    if (bytes_[at_] == '\n') ++line_;
}

bool MeshCursor::at_end() {
  skip_space();
  return at_ == bytes_.size();
}

std::string_view MeshCursor::word() {
  skip_space();
  token_ = place();
  if (at_ == bytes_.size()) throw error("the file ends too early");
  const std::size_t begin = at_;
  while (at_ < bytes_.size() && !is_space(bytes_[at_])) ++at_;
  return std::string_view(bytes_).substr(begin, at_ - begin);
}

std::string_view MeshCursor::peek() {
  const std::string_view token = word();
  at_ = token_.byte;
  return token;
}

std::string_view MeshCursor::rest_of_line() {
  token_ = place();
  const std::size_t begin = at_, end = std::min(bytes_.find('\n', at_), bytes_.size());
  at_ = std::min(end + 1, bytes_.size());
  if (end < bytes_.size()) ++line_;
  std::string_view line = std::string_view(bytes_).substr(begin, end - begin);
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

double MeshCursor::number() {
  const std::string_view token = word();
  double value = 0;
  const auto [end, problem] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (problem == std::errc::result_out_of_range && end == token.data() + token.size())
    return std::strtod(std::string(token).c_str(), nullptr);  // 0 or infinite, as it may be
  if (problem != std::errc() || end != token.data() + token.size())
    throw error(quoted(token) + " is not a number");
  return value;
}

std::int64_t MeshCursor::integer() {
  const std::string_view token = word();
  std::int64_t value = 0;
  const auto [end, problem] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (problem != std::errc() || end != token.data() + token.size())
    throw error(quoted(token) + " is not a whole number");
  return value;
}

std::uint64_t MeshCursor::count() {
  const std::int64_t value = integer();
  if (value < 0) throw error(std::to_string(value) + " is not a number of things (it is negative)");
  return static_cast<std::uint64_t>(value);
}

template <typename T>
T MeshCursor::raw() {
  token_ = place();
  if (bytes_.size() - at_ < sizeof(T)) throw error("the file ends too early");
  T value;
  std::memcpy(&value, bytes_.data() + at_, sizeof(T));
  at_ += sizeof(T);
  return value;
}

std::int64_t MeshCursor::read_int() {
  if (binary_) return raw<std::int32_t>();
  const std::int64_t value = integer();
  if (value != static_cast<std::int32_t>(value)) throw error(std::to_string(value) + " is out of range");
  return value;
}

std::uint64_t MeshCursor::read_size() { return binary_ ? raw<std::uint64_t>() : count(); }
double MeshCursor::read_double() { return binary_ ? raw<double>() : number(); }

void MeshCursor::skip_values(std::uint64_t n) {
  if (!binary_) {
    for (std::uint64_t i = 0; i < n; ++i) word();
    return;
  }
  token_ = place();
  if (n > (bytes_.size() - at_) / sizeof(double)) throw error("the file ends too early");
  at_ += n * sizeof(double);
}

bool MeshCursor::skip_to_line(std::string_view text) {
  token_ = place();
  const std::size_t found = bytes_.find("\n" + std::string(text), at_ > 0 ? at_ - 1 : 0);
  if (found == std::string::npos) return false;
  const std::size_t end = found + 1 + text.size();
  if (end > at_) line_ += static_cast<int>(std::count(bytes_.begin() + at_, bytes_.begin() + end, '\n'));
  at_ = end;
  return true;
}

}  // namespace hapticd
