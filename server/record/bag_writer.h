// A rosbag2 recording: DIR/metadata.yaml and DIR/<DIR's name>_0.db3, as `ros2 bag record -s sqlite3` leaves
// them.
//
//   topics(id, name, type, serialization_format "cdr", offered_qos_profiles)
//   messages(id, topic_id, timestamp [ns since 1970], data [CDR])        schema 3, metadata version 5
//
// Messages are kept in transactions that `commit` ends: what was committed survives a killed process, and a
// full disk, whole. After the first write that fails nothing more is tried: the recording stops with what was
// committed before, `failure` says why, and every later message and those of the open transaction are `lost`.
// Thread safety: one thread. Errors: the constructor throws InputError where the directory holds a recording
// already or cannot be made; all else is a state.
// Source: rosbag2_storage_sqlite3 (ROS 2 Humble).
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

struct sqlite3;
struct sqlite3_stmt;

namespace hapticd {

// Throws InputError where the directory holds a recording already.
void require_no_bag(const std::filesystem::path& directory);

class BagWriter {
 public:
  explicit BagWriter(const std::filesystem::path& directory);
  ~BagWriter();
  BagWriter(const BagWriter&) = delete;
  BagWriter& operator=(const BagWriter&) = delete;

  // Before the first message: name as ROS 2 has it ("/haptic/0/pose"), type as in
  // "geometry_msgs/msg/PoseStamped".
  int add_topic(const std::string& name, const std::string& type);
  void write(int topic, std::int64_t time_ns, std::span<const std::uint8_t> cdr) noexcept;
  // Ends the transaction and brings metadata.yaml up to date.
  void commit() noexcept;
  void close() noexcept;

  bool failed() const noexcept { return !failure_.empty(); }
  const std::string& failure() const noexcept { return failure_; }
  std::uint64_t kept() const noexcept { return kept_; }  // messages committed
  std::uint64_t lost() const noexcept {
    return lost_;
  }  // messages given to write that are not, and never will be

 private:
  struct Topic {
    std::string name, type;
    std::uint64_t kept = 0, pending = 0;
  };

  bool run(const char* sql) noexcept;
  void fail() noexcept;
  std::string metadata() const;
  bool write_metadata() const noexcept;

  std::filesystem::path directory_;
  std::string file_;  // of the database, within the directory
  sqlite3* db_ = nullptr;
  sqlite3_stmt* insert_ = nullptr;
  std::vector<Topic> topics_;
  bool open_ = false;  // a transaction
  std::uint64_t pending_ = 0, kept_ = 0, lost_ = 0;
  std::int64_t first_ns_ = 0, last_ns_ = 0;                  // of what is committed
  std::int64_t pending_first_ns_ = 0, pending_last_ns_ = 0;  // … with what is not yet
  std::string failure_;
};

}  // namespace hapticd
