#include "server/dds/key_dates.h"

#include <openssl/bio.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <time.h>

#include <cmath>
#include <memory>
#include <regex>

#include "server/files/paths.h"

namespace hapticd {

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

std::optional<double> days_left(const Security& security) {
  std::optional<double> least;
  for (const std::optional<double>& days : {days_left_of_certificate(read_bytes(security.authority)),
                                            days_left_of_certificate(read_bytes(security.certificate)),
                                            days_left_of_permissions(read_bytes(security.permissions))})
    if (days) least = least ? std::min(*least, *days) : *days;
  return least;
}

std::string ended_keys(const std::optional<Security>& security) {
  const std::optional<double> days = security ? days_left(*security) : std::nullopt;
  if (!days || *days > 0) return {};
  return "the keys of " + security->role + " in " + security->authority.parent_path().string() +
         " have ended: run make_keys.sh again for new ones (haptic doctor --secure DIR says which)";
}

}  // namespace hapticd
