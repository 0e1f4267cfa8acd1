#include "server/dds/dds_security.h"

#include <stdexcept>

#include "server/files/input_error.h"
#include "server/files/paths.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

constexpr const char* how = "config/dds/security/make_keys.sh makes one";

fs::path checked(const fs::path& file, const std::string& begins, const char* what) {
  std::error_code error;
  const bool there = fs::exists(file, error);
  if (error) throw InputError(file, 0, "", std::string("cannot be read: ") + error.message() + ": " + what);
  if (!there) throw InputError(file, 0, "", std::string("no such file: ") + what + " (" + how + ")");
  const std::string text = read_bytes(file);
  if (!text.starts_with(begins)) throw InputError(file, 0, "", std::string("is not ") + what);
  return fs::absolute(file);
}

// Whoever reads it can be this role.
fs::path private_key(const fs::path& file) {
  fs::path key = checked(file, "-----BEGIN ", "this role's private key in PEM");
  std::error_code error;
  if ((fs::status(key, error).permissions() & (fs::perms::others_read | fs::perms::others_write)) !=
      fs::perms::none)
    throw InputError(file, 0, "",
                     "anybody on this machine can read this private key: chmod o= " + file.string() +
                         ", and make another if somebody may have");
  return key;
}

}  // namespace

Security security_files(const fs::path& directory, const std::string& role) {
  const fs::path plugins = HAPTICD_DDS_PLUGINS;
  if (plugins.empty())
    throw std::runtime_error(
        "this build found no DDS Security plugins (libdds_security_auth.so and its two "
        "neighbours; Debian's libddsc0debian has them): configure it again with them");
  std::error_code error;
  const bool there = fs::is_directory(directory, error);
  if (error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory)
    throw InputError(directory, 0, "", "cannot be read: " + error.message());
  if (!there) throw InputError(directory, 0, "", std::string("no such folder of keys: ") + how);
  const std::string pem = "-----BEGIN ", mime = "MIME-Version:";
  const fs::path own = directory / role;
  return {role,
          checked(directory / "ca.pem", pem, "the authority's certificate in PEM"),
          checked(directory / "governance.p7s", mime, "a signed governance document"),
          checked(own / "cert.pem", pem, "this role's certificate in PEM"),
          private_key(own / "key.pem"),
          checked(own / "permissions.p7s", mime, "a signed permissions document"),
          plugins / "libdds_security_auth.so",
          plugins / "libdds_security_ac.so",
          plugins / "libdds_security_crypto.so"};
}

void set_security(dds_qos_t& qos, const Security& s) {
  const auto set = [&qos](const std::string& name, const std::string& value) {
    dds_qset_prop(&qos, ("dds.sec." + name).c_str(), value.c_str());
  };
  const auto plugin = [&](const std::string& kind, const fs::path& library, const std::string& suffix) {
    set(kind + ".library.path", library.string());
    set(kind + ".library.init", "init_" + suffix);
    set(kind + ".library.finalize", "finalize_" + suffix);
  };
  plugin("auth", s.authentication, "authentication");
  plugin("access", s.access_control, "access_control");
  plugin("crypto", s.cryptography, "crypto");
  set("auth.identity_ca", "file:" + s.authority.string());
  set("auth.identity_certificate", "file:" + s.certificate.string());
  set("auth.private_key", "file:" + s.key.string());
  set("access.permissions_ca", "file:" + s.authority.string());
  set("access.governance", "file:" + s.governance.string());
  set("access.permissions", "file:" + s.permissions.string());
}

}  // namespace hapticd
