#include "server/record/bag_reader.h"

#include <sqlite3.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "server/record/ros2_messages.h"

namespace hapticd {
namespace {

constexpr double unit_tolerance = 1e-2;
constexpr std::size_t most_messages = 3'700'000, most_topics = 10'000;
constexpr int most_bytes = 1 << 20;  // of a message: a pose has a hundred
const std::string pose_type = "geometry_msgs/msg/PoseStamped";
const std::string transform_type = "geometry_msgs/msg/TransformStamped";
const std::string joy_type = "sensor_msgs/msg/Joy";

using Statement = std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)>;

struct BagTopic {
  sqlite3_int64 id = 0;
  std::string name, type, format;
};

struct BagMessage {
  std::int64_t bag_ns = 0;
  StampedPose pose;
};

struct BagButtons {
  std::int64_t bag_ns;
  std::uint32_t buttons;
};

class Database {
 public:
  explicit Database(const std::filesystem::path& file) : file_(file) {
    // To write only where a recording was cut off and its journal has to be played back.
    check(sqlite3_open_v2(file.c_str(), &db_, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, nullptr));
    harden();
  }
  Database(std::span<const std::uint8_t> bytes, const std::filesystem::path& file) : file_(file) {
    check(sqlite3_open_v2(":memory:", &db_, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, nullptr));
    harden();
    // sqlite reads the bytes where they are, and is told not to write to them.
    check(sqlite3_deserialize(db_, "main", const_cast<unsigned char*>(bytes.data()),
                              static_cast<sqlite3_int64>(bytes.size()),
                              static_cast<sqlite3_int64>(bytes.size()), SQLITE_DESERIALIZE_READONLY));
  }
  ~Database() { sqlite3_close(db_); }
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  const std::filesystem::path& file() const { return file_; }

  std::vector<BagTopic> topics() const {
    require_table("topics");
    require_table("messages");
    const Statement s = prepare("SELECT id, name, type, serialization_format FROM topics");
    std::vector<BagTopic> out;
    while (next(s)) {
      if (out.size() == most_topics) throw InputError(file_, 0, "topics", "more than 10000");
      out.push_back({sqlite3_column_int64(s.get(), 0), text(s, 1), text(s, 2), text(s, 3)});
    }
    return out;
  }

  // f(timestamp, bytes) for each message, by time.
  template <typename F>
  void each_message(const BagTopic& topic, F&& f) const {
    const Statement s =
        prepare("SELECT id, timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp, id");
    sqlite3_bind_int64(s.get(), 1, topic.id);
    while (next(s)) {
      const auto* data = static_cast<const std::uint8_t*>(sqlite3_column_blob(s.get(), 2));
      const auto size = static_cast<std::size_t>(sqlite3_column_bytes(s.get(), 2));
      try {
        f(sqlite3_column_int64(s.get(), 1), std::span(data, data ? size : 0));
      } catch (const CdrError& e) {
        throw InputError(
            file_, 0, topic.name + ", message " + std::to_string(sqlite3_column_int64(s.get(), 0)), e.what());
      }
    }
  }

 private:
  void check(int code) {
    if (code == SQLITE_OK) return;
    const std::string why = db_ ? sqlite3_errmsg(db_) : "out of memory";
    sqlite3_close(std::exchange(db_, nullptr));
    throw InputError(file_, 0, "", "cannot be opened as an sqlite3 database: " + why);
  }
  void harden() {
    for (const int off : {SQLITE_DBCONFIG_ENABLE_TRIGGER, SQLITE_DBCONFIG_ENABLE_VIEW,
                          SQLITE_DBCONFIG_TRUSTED_SCHEMA, SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION})
      sqlite3_db_config(db_, off, 0, nullptr);
    sqlite3_db_config(db_, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    sqlite3_limit(db_, SQLITE_LIMIT_LENGTH, most_bytes);
    sqlite3_exec(db_, "PRAGMA temp_store=MEMORY; PRAGMA mmap_size=0; PRAGMA cell_size_check=ON", nullptr,
                 nullptr, nullptr);
  }
  InputError error(const std::string& what) const {
    return {file_, 0, "", what + ": " + sqlite3_errmsg(db_)};
  }
  Statement prepare(const char* sql) const {
    sqlite3_stmt* s = nullptr;
    if (sqlite3_prepare_v2(db_, sql, -1, &s, nullptr) != SQLITE_OK)
      throw error("is no rosbag2 recording of sqlite3 storage");
    return {s, &sqlite3_finalize};
  }
  bool next(const Statement& s) const {
    const int code = sqlite3_step(s.get());
    if (code != SQLITE_ROW && code != SQLITE_DONE) throw error("cannot be read");
    return code == SQLITE_ROW;
  }
  static std::string text(const Statement& s, int column) {
    const auto* t = sqlite3_column_text(s.get(), column);
    return t ? reinterpret_cast<const char*>(t) : "";
  }
  // A view may be anything, and cost anything.
  void require_table(const char* name) const {
    const Statement s = prepare("SELECT sql FROM sqlite_schema WHERE type = 'table' AND name = ?");
    sqlite3_bind_text(s.get(), 1, name, -1, SQLITE_STATIC);
    if (!next(s) || !text(s, 0).starts_with("CREATE TABLE"))
      throw InputError(file_, 0, "", std::string("is no rosbag2 recording: it has no table ") + name);
  }

  std::filesystem::path file_;
  sqlite3* db_ = nullptr;
};

bool has_poses(const BagTopic& t) { return t.type == pose_type || t.type == transform_type; }

BagTopic choose(const Database& db, const std::vector<BagTopic>& topics, const std::string& wanted) {
  std::string there;
  std::vector<BagTopic> fit;
  for (const BagTopic& t : topics) {
    if (!has_poses(t) || (!wanted.empty() && t.name != wanted)) {
      if (!wanted.empty() && t.name == wanted)
        throw InputError(db.file(), 0, wanted,
                         "has " + t.type + ", not " + pose_type + " or " + transform_type);
    } else {
      fit.push_back(t);
    }
    if (has_poses(t) && there.size() < 1000) there += (there.empty() ? "" : ", ") + t.name;
  }
  if (there.empty())
    throw InputError(db.file(), 0, "", "has no topic of type " + pose_type + " or " + transform_type);
  if (fit.empty()) throw InputError(db.file(), 0, wanted, "is not there (with poses: " + there + ")");
  if (fit.size() > 1)
    throw InputError(db.file(), 0, "", "has several topics with poses, --topic says which: " + there);
  if (fit[0].format != "cdr")
    throw InputError(db.file(), 0, fit[0].name, "is serialised as '" + fit[0].format + "', not as cdr");
  return fit[0];
}

class Motion {
 public:
  explicit Motion(std::string topic) : topic_(std::move(topic)) {}

  void add(const Database& db) {
    const std::vector<BagTopic> topics = db.topics();
    const BagTopic topic = choose(db, topics, topic_);
    topic_ = topic.name;  // the same in all files
    const auto get = topic.type == pose_type ? get_pose : get_transform;
    db.each_message(topic, [&](std::int64_t ns, std::span<const std::uint8_t> data) {
      if (messages_.size() == most_messages)
        throw InputError(db.file(), 0, topic.name, "more than an hour at 1 kHz");
      messages_.push_back({ns, checked(get(data))});
    });
    const std::string beside = topic.name.substr(0, topic.name.rfind('/') + 1) + "buttons";
    for (const BagTopic& t : topics)
      if (t.name == beside && t.type == joy_type && t.format == "cdr")
        db.each_message(t, [&](std::int64_t ns, std::span<const std::uint8_t> data) {
          if (buttons_.size() < most_messages) buttons_.push_back({ns, get_joy(data).buttons});
        });
  }

  Trajectory finish(const std::filesystem::path& file, LengthUnit unit) {
    if (messages_.size() < 2)
      throw InputError(file, 0, topic_,
                       "only " + std::to_string(messages_.size()) + " messages: a motion needs two at least");
    const auto by_stamp = [](const BagMessage& m) { return m.pose.stamp.ns; };
    const auto by_bag = [](const BagMessage& m) { return m.bag_ns; };
    if (rises(by_stamp)) return trajectory(by_stamp, unit);
    if (rises(by_bag)) return trajectory(by_bag, unit);
    throw InputError(file, 0, topic_, "the time does not rise, neither in the headers nor in the bag");
  }

 private:
  static StampedPose checked(StampedPose m) {
    if (!m.pose.p.allFinite()) throw CdrError("the position is not finite");
    if (!(std::abs(m.pose.q.norm() - 1) <= unit_tolerance))
      throw CdrError("not a unit quaternion: its norm is " + std::to_string(m.pose.q.norm()));
    m.pose.q.normalize();
    return m;
  }
  template <typename Time>
  bool rises(Time time) const {
    for (std::size_t i = 1; i < messages_.size(); ++i)
      if (time(messages_[i]) <= time(messages_[i - 1])) return false;
    return true;
  }
  template <typename Time>
  Trajectory trajectory(Time time, LengthUnit unit) const {
    std::vector<TrajectorySample> samples;
    std::size_t pressed = 0;  // buttons before this one are past
    for (const BagMessage& m : messages_) {
      while (pressed < buttons_.size() && buttons_[pressed].bag_ns <= m.bag_ns) ++pressed;
      TrajectorySample s;
      // Rising, so the difference is right even where the two are half the range apart.
      s.t = static_cast<double>(static_cast<std::uint64_t>(time(m)) -
                                static_cast<std::uint64_t>(time(messages_[0]))) /
            1e9;
      s.pose = m.pose.pose;
      s.pose.p *= metres(unit);
      s.buttons = pressed > 0 ? buttons_[pressed - 1].buttons : 0;
      // Two stamps that differ by less than a double can tell, centuries from the first.
      if (samples.empty() || s.t > samples.back().t) samples.push_back(s);
    }
    return make_trajectory(std::move(samples));
  }

  std::string topic_;
  std::vector<BagMessage> messages_;
  std::vector<BagButtons> buttons_;
};

std::vector<std::filesystem::path> databases(const std::filesystem::path& bag) {
  std::error_code error;
  if (!std::filesystem::is_directory(bag, error)) return {bag};
  std::vector<std::filesystem::path> out;
  const std::filesystem::path metadata = bag / "metadata.yaml";
  if (std::filesystem::exists(metadata, error)) {
    for (const std::string& name : parse_bag_metadata(read_bytes(metadata), metadata))
      out.push_back(bag / name);
  } else {
    for (const auto& entry : std::filesystem::directory_iterator(bag, error))
      if (entry.path().extension() == ".db3") out.push_back(entry.path());
    std::sort(out.begin(), out.end());
  }
  if (out.empty()) throw InputError(bag, 0, "", "holds no recording: neither metadata.yaml nor a .db3 file");
  return out;
}

}  // namespace

bool is_bag(const std::filesystem::path& file) {
  std::error_code error;
  return file.extension() == ".db3" || std::filesystem::is_directory(file, error);
}

std::vector<std::string> parse_bag_metadata(const std::string& text, const std::filesystem::path& file) {
  try {
    const YAML::Node root = YAML::Load(text)["rosbag2_bagfile_information"];
    if (!root.IsMap()) throw InputError(file, 1, "rosbag2_bagfile_information", "is missing");
    const auto storage = root["storage_identifier"].as<std::string>("");
    if (storage != "sqlite3")
      throw InputError(file, 0, "storage_identifier", "'" + storage + "' is not read, only sqlite3");
    if (const auto mode = root["compression_mode"].as<std::string>(""); !mode.empty() && mode != "NONE")
      throw InputError(file, 0, "compression_mode", "'" + mode + "': decompress it first (ros2 bag convert)");
    return root["relative_file_paths"].as<std::vector<std::string>>();
  } catch (const YAML::Exception& e) {
    throw InputError(file, e.mark.line + 1, "", "is no metadata of a recording: " + e.msg);
  }
}

Trajectory read_bag(const std::filesystem::path& bag, const std::string& topic, LengthUnit unit) {
  Motion motion(topic);
  for (const std::filesystem::path& file : databases(bag)) {
    if (!is_file(file)) throw InputError(file, 0, "", "no such file");
    motion.add(Database(file));
  }
  return motion.finish(bag, unit);
}

Trajectory parse_bag(std::span<const std::uint8_t> database, const std::filesystem::path& file,
                     const std::string& topic, LengthUnit unit) {
  Motion motion(topic);
  motion.add(Database(database, file));
  return motion.finish(file, unit);
}

}  // namespace hapticd
