// The part of `haptic doctor` that is about keys: all there, not ending, not for everybody's eyes.
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "server/dds/dds_security.h"
#include "server/dds/key_dates.h"
#include "server/files/paths.h"
#include "tools/doctor/doctor.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

constexpr double soon_days = 30;
constexpr const char* make = "make_keys.sh (in dds/security of the configuration)";

Finding expiry(const std::string& name, const fs::path& file, const std::optional<double>& days,
               const std::string& again) {
  if (!days) return {name, Health::fail, file.string() + ": does not say until when it is valid", again};
  const std::string when = std::to_string(static_cast<long>(std::floor(std::abs(*days)))) + " days";
  if (*days < 0) return {name, Health::fail, file.string() + ": ended " + when + " ago", again};
  if (*days < soon_days) return {name, Health::warn, file.string() + ": ends in " + when, again};
  return {name, Health::pass, file.string() + ": valid for " + when, ""};
}

Finding privacy(const std::string& name, const fs::path& key) {
  struct stat s {};
  if (stat(key.c_str(), &s) != 0)
    return {name, Health::fail, key.string() + ": cannot be looked at", "chmod u+rx its folder"};
  char mode[8];
  std::snprintf(mode, sizeof mode, "%03o", static_cast<unsigned>(s.st_mode & 0777));
  if (s.st_mode & 077)
    return {name, Health::fail, key.string() + ": mode " + mode + ", others may read or write it",
            "chmod 600 " + key.string()};
  return {name, Health::pass, key.string() + ": mode " + mode, ""};
}

}  // namespace

std::vector<Finding> check_security(const fs::path& keys) {
  std::vector<Finding> out;
  std::error_code error;
  int roles = 0;
  for (const char* role : security_roles) {
    if (!fs::is_directory(keys / role, error)) continue;
    ++roles;
    const std::string name = std::string("keys of ") + role;
    const Finding key = privacy(name, keys / role / "key.pem");
    if (key.health == Health::fail && fs::exists(keys / role / "key.pem", error)) {
      out.push_back(key);  // which no program takes
      continue;
    }
    try {
      const Security s = security_files(keys, role);
      out.push_back(expiry(name, s.certificate, days_left_of_certificate(read_bytes(s.certificate)),
                           std::string("delete its folder and run ") + make + " again"));
      out.push_back(expiry(name, s.permissions, days_left_of_permissions(read_bytes(s.permissions)),
                           std::string("run ") + make + " again: it signs anew"));
      out.push_back(key);
    } catch (const std::exception& e) {
      out.push_back({name, Health::fail, e.what(), std::string("run ") + make + " again"});
    }
  }
  if (roles == 0)
    out.push_back(
        {"keys", Health::fail, keys.string() + ": no role's folder is there", std::string("run ") + make});
  if (fs::exists(keys / "ca.pem", error)) {
    out.push_back(expiry("authority", keys / "ca.pem", days_left_of_certificate(read_bytes(keys / "ca.pem")),
                         "make a new folder of keys"));
  }
  if (fs::exists(keys / "ca.key", error)) {
    out.push_back(privacy("authority", keys / "ca.key"));
    if (out.back().health == Health::pass)
      out.back() = {"authority", Health::warn,
                    (keys / "ca.key").string() + ": whoever reads it can admit anybody",
                    "keep it on a machine that serves nobody"};
  }
  return out;
}

}  // namespace hapticd
