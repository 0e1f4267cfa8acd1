// Reads a motion from a rosbag2 recording of sqlite3 storage: a directory with metadata.yaml, or one .db3
// file.
//
//   poses    geometry_msgs/msg/PoseStamped or TransformStamped, of the topic named, or of the only one there
//   is buttons  sensor_msgs/msg/Joy of the topic …/buttons beside it, if there is one (device_bag.h) time the
//   headers' stamps if they rise from each message to the next, else the bag's own timestamps
//
// The first message is at 0 s; the position's unit is the caller's to say. Several files of one recording are
// read one after the other. Quaternions within 1e-2 of unit norm are normalised.
// A database is a stranger's program in part: views, triggers and virtual tables are not followed.
// Errors: InputError naming file, topic and message: no such topic or several to choose from (all are
// listed), another storage, compression or serialisation, what does not decode, is not finite or not unit,
// times that do not rise, fewer than two messages, more than an hour at 1 kHz. Source:
// rosbag2_storage_sqlite3, schemas 1 to 4.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "server/record/trajectory_reader.h"

namespace hapticd {

// Whether a file is to be read by read_bag: a directory, or a name that ends in .db3.
bool is_bag(const std::filesystem::path& file);

// topic: empty if there is but one with poses.
Trajectory read_bag(const std::filesystem::path& bag, const std::string& topic, LengthUnit unit);

// From the bytes of one database; `file` is only named in errors.
Trajectory parse_bag(std::span<const std::uint8_t> database, const std::filesystem::path& file,
                     const std::string& topic, LengthUnit unit);

// The files that a metadata.yaml names, relative to it.
std::vector<std::string> parse_bag_metadata(const std::string& text, const std::filesystem::path& file);

}  // namespace hapticd
