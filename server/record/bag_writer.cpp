#include "server/record/bag_writer.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <system_error>
#include <utility>

#include "server/files/input_error.h"

namespace hapticd {
namespace {

// DELETE is the one journal that leaves a single file behind; a commit a second can afford its syncs.
constexpr const char* schema =
    "PRAGMA journal_mode=DELETE; PRAGMA synchronous=NORMAL;"
    "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY,ros_distro TEXT NOT NULL);"
    "INSERT INTO schema VALUES(3,'humble');"
    "CREATE TABLE metadata(id INTEGER PRIMARY KEY,metadata_version INTEGER NOT NULL,metadata TEXT NOT NULL);"
    "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,"
    "serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL);"
    "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL,"
    "data BLOB NOT NULL);"
    "CREATE INDEX timestamp_idx ON messages (timestamp ASC);";

// What the mirror's writers offer (ros2_mirror.h): keep last 1, reliable, volatile, no deadline, no lifespan,
// a lease without end; numbers are rmw's.
constexpr const char* qos =
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 2\n"
    "  deadline:\n    sec: 9223372036\n    nsec: 854775807\n"
    "  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n"
    "  liveliness: 1\n  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n"
    "  avoid_ros_namespace_conventions: false";

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '\n') {
      out += "\\n";
    } else {
      if (c == '"' || c == '\\') out += '\\';
      out += c;
    }
  }
  return out + '"';
}

std::string last_name(const std::filesystem::path& directory) {
  std::filesystem::path p = std::filesystem::absolute(directory).lexically_normal();
  if (p.filename().empty()) p = p.parent_path();
  return p.filename().string();
}

std::string storage_of(const std::filesystem::path& directory) { return last_name(directory) + "_0.db3"; }

}  // namespace

void require_no_bag(const std::filesystem::path& directory) {
  std::error_code error;
  for (const std::filesystem::path& there : {directory / "metadata.yaml", directory / storage_of(directory)})
    if (std::filesystem::exists(there, error))
      throw InputError(there, 0, "", "is there already: a recording needs a directory of its own");
}

BagWriter::BagWriter(const std::filesystem::path& directory)
    : directory_(directory), file_(storage_of(directory)) {
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  if (error) throw InputError(directory, 0, "", "cannot be made: " + error.message());
  require_no_bag(directory);
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
  if (sqlite3_open_v2((directory / file_).c_str(), &db_, flags, nullptr) != SQLITE_OK) {
    const std::string why = sqlite3_errmsg(db_);
    sqlite3_close(db_);
    throw InputError(directory / file_, 0, "", "cannot be made: " + why);
  }
  sqlite3_extended_result_codes(db_, 1);
  if (run(schema) &&
      sqlite3_prepare_v2(db_, "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", -1,
                         &insert_, nullptr) != SQLITE_OK)
    fail();
  if (!failed() && !write_metadata())
    failure_ = (directory / "metadata.yaml").string() + " cannot be written";
}

BagWriter::~BagWriter() { close(); }

bool BagWriter::run(const char* sql) noexcept {
  if (sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) == SQLITE_OK) return true;
  fail();
  return false;
}

void BagWriter::fail() noexcept {
  const int error = sqlite3_system_errno(db_);
  failure_ = (directory_ / file_).string() + ": " + sqlite3_errmsg(db_);
  if (error != 0 && sqlite3_errcode(db_) != SQLITE_FULL)
    failure_ += ", " + std::generic_category().message(error);
  lost_ += pending_;
  pending_ = 0;
  for (Topic& t : topics_) t.pending = 0;
  // Most errors have rolled back by themselves; where not, what is committed must not wait for this one.
  if (!sqlite3_get_autocommit(db_)) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
  open_ = false;
}

int BagWriter::add_topic(const std::string& name, const std::string& type) {
  topics_.push_back({name, type});
  const int id = static_cast<int>(topics_.size());
  if (failed()) return id;
  sqlite3_stmt* s = nullptr;
  bool done =
      sqlite3_prepare_v2(db_, "INSERT INTO topics VALUES (?, ?, ?, 'cdr', ?)", -1, &s, nullptr) == SQLITE_OK;
  if (done) {
    sqlite3_bind_int(s, 1, id);
    sqlite3_bind_text(s, 2, name.c_str(), -1, SQLITE_STATIC);
    sqlite3_bind_text(s, 3, type.c_str(), -1, SQLITE_STATIC);
    sqlite3_bind_text(s, 4, qos, -1, SQLITE_STATIC);
    done = sqlite3_step(s) == SQLITE_DONE;
  }
  if (!done) fail();
  sqlite3_finalize(s);
  if (!failed()) write_metadata();
  return id;
}

void BagWriter::write(int topic, std::int64_t time_ns, std::span<const std::uint8_t> cdr) noexcept {
  if (failed()) {
    ++lost_;
    return;
  }
  if (!open_) {
    if (!run("BEGIN")) {
      ++lost_;
      return;
    }
    open_ = true;
  }
  sqlite3_bind_int(insert_, 1, topic);
  sqlite3_bind_int64(insert_, 2, time_ns);
  sqlite3_bind_blob(insert_, 3, cdr.data(), static_cast<int>(cdr.size()), SQLITE_STATIC);
  const bool done = sqlite3_step(insert_) == SQLITE_DONE;
  if (done) {
    const bool first = kept_ + pending_ == 0;
    pending_first_ns_ = first ? time_ns : std::min(pending_first_ns_, time_ns);
    pending_last_ns_ = first ? time_ns : std::max(pending_last_ns_, time_ns);
    ++pending_;
    ++topics_[static_cast<std::size_t>(topic - 1)].pending;
  } else {
    ++lost_;
    fail();
  }
  sqlite3_reset(insert_);
  sqlite3_clear_bindings(insert_);
}

void BagWriter::commit() noexcept {
  if (failed() || !open_ || !run("COMMIT")) return;
  open_ = false;
  kept_ += pending_;
  pending_ = 0;
  for (Topic& t : topics_) t.kept += std::exchange(t.pending, 0);
  first_ns_ = pending_first_ns_;
  last_ns_ = pending_last_ns_;
  if (!write_metadata()) failure_ = (directory_ / "metadata.yaml").string() + " cannot be written";
}

void BagWriter::close() noexcept {
  if (!db_) return;
  commit();
  sqlite3_finalize(insert_);
  sqlite3_close(db_);
  insert_ = nullptr;
  db_ = nullptr;
}

std::string BagWriter::metadata() const {
  const auto number = [](auto n) { return std::to_string(n); };
  const std::string duration = "nanoseconds: " + number(last_ns_ - first_ns_) + "\n",
                    start = "nanoseconds_since_epoch: " + number(first_ns_) + "\n",
                    count = "message_count: " + number(kept_) + "\n";
  std::string text =
      "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  duration:\n    " +
      duration + "  starting_time:\n    " + start + "  " + count + "  topics_with_message_count:\n";
  for (const Topic& t : topics_)
    text += "    - topic_metadata:\n        name: " + t.name + "\n        type: " + t.type +
            "\n        serialization_format: cdr\n        offered_qos_profiles: " + quoted(qos) +
            "\n      message_count: " + number(t.kept) + "\n";
  if (topics_.empty()) text.insert(text.size() - 1, " []");
  return text + "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - " +
         quoted(file_) + "\n  files:\n    - path: " + quoted(file_) + "\n      starting_time:\n        " +
         start + "      duration:\n        " + duration + "      " + count;
}

// Whole or not at all.
bool BagWriter::write_metadata() const noexcept {
  try {
    const std::filesystem::path file = directory_ / "metadata.yaml",
                                beside = directory_ / "metadata.yaml.part";
    std::ofstream out(beside);
    out << metadata();
    out.close();
    std::error_code error;
    if (out) std::filesystem::rename(beside, file, error);
    if (!out || error) {
      std::filesystem::remove(beside, error);
      return false;
    }
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

}  // namespace hapticd
