// The part of `haptic doctor` that is about keys: all there, not ending, not for everybody's eyes.
#include <openssl/bio.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <regex>

#include "server/dds/dds_security.h"
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

std::optional<double> days_left_of_certificate(const std::string& pem) {
  const std::unique_ptr<BIO, decltype(&BIO_free)> bio(
      BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())), &BIO_free);
  const std::unique_ptr<X509, decltype(&X509_free)> certificate(
      PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr), &X509_free);
  int days = 0, seconds = 0;
  if (!certificate || !ASN1_TIME_diff(&days, &seconds, nullptr, X509_get0_notAfter(certificate.get())))
    return std::nullopt;
  return days + seconds / 86400.0;
}

std::optional<double> days_left_of_permissions(const std::string& text) {
  static const std::regex ends(R"(<not_after>\s*([^<\s]+)\s*</not_after>)");
  std::optional<double> least;
  for (auto i = std::sregex_iterator(text.begin(), text.end(), ends); i != std::sregex_iterator(); ++i) {
    tm parts{};
    if (!strptime((*i)[1].str().c_str(), "%Y-%m-%dT%H:%M:%S", &parts)) return std::nullopt;
    const double days = std::difftime(timegm(&parts), time(nullptr)) / 86400.0;
    least = least ? std::min(*least, days) : days;
  }
  return least;
}

std::vector<Finding> check_security(const fs::path& keys) {
  std::vector<Finding> out;
  std::error_code error;
  int roles = 0;
  for (const char* role : security_roles) {
    if (!fs::is_directory(keys / role, error)) continue;
    ++roles;
    const std::string name = std::string("keys of ") + role;
    try {
      const Security s = security_files(keys, role);
      out.push_back(expiry(name, s.certificate, days_left_of_certificate(read_bytes(s.certificate)),
                           std::string("delete its folder and run ") + make + " again"));
      out.push_back(expiry(name, s.permissions, days_left_of_permissions(read_bytes(s.permissions)),
                           std::string("run ") + make + " again: it signs anew"));
      out.push_back(privacy(name, s.key));
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
