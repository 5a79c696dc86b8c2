#include "rollout_buffer/dds/keys.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/dds/key_files.h"
#include "rollout_buffer/dds/openssl_handles.h"

namespace comrad::dds {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kSecondsOfADay = 86'400;
constexpr std::size_t kMostNameBytes = 63;

/// When what is made holds, Unix time.
struct Period {
  time_t from_s = 0;
  time_t until_s = 0;
};

struct Authority {
  CertificatePtr certificate;
  KeyPtr key;
};

Error openssl_error(const std::string& what) {
  return Error{ErrorCode::kSystem, "cannot " + what + ": OpenSSL reports: " + openssl_reason()};
}

Status check_request(const KeyRequest& request) {
  if (request.folder.empty()) return Error{ErrorCode::kBadInput, "keys: name a folder for them"};
  if (request.days < 1 || request.days > kMostKeyDays)
    return Error{ErrorCode::kBadInput, fmt::format("keys for {} days: 1 to {}", request.days, kMostKeyDays)};
  for (std::size_t i = 0; i < request.hosts.size(); ++i) {
    const std::string& name = request.hosts[i];
    const bool is_plain = !name.empty() && name.size() <= kMostNameBytes && name[0] != '.' &&
                          name[0] != '-' && std::all_of(name.begin(), name.end(), [](unsigned char c) {
                            return (c < 0x80 && std::isalnum(c)) || c == '-' || c == '_' || c == '.';
                          });
    if (!is_plain)
      return Error{ErrorCode::kBadInput,
                   "host '" + name.substr(0, 80) + "': 1 to 63 letters, digits, - _ and . in a name"};
    if (std::count(request.hosts.begin(), request.hosts.end(), name) > 1)
      return Error{ErrorCode::kBadInput, "host '" + name + "' is named twice"};
  }
  return {};
}

Period period_of(const KeyRequest& request) {
  const int64_t start_s = request.start_s != 0 ? request.start_s : std::time(nullptr) - kSecondsOfADay;
  return {start_s, start_s + request.days * kSecondsOfADay};
}

Status make_folder(const std::string& path) {
  if (mkdir(path.c_str(), 0700) == 0) return {};
  if (errno == EEXIST)
    return Error{ErrorCode::kBadInput, path + " is there already; keys are never replaced"};
  return file_error(path, errno);
}

Expected<std::string> pem_of(const X509* certificate) {
  const BioPtr memory(BIO_new(BIO_s_mem()));
  if (PEM_write_bio_X509(memory.get(), certificate) != 1) return openssl_error("write a certificate");
  return text_of(memory.get());
}

Expected<std::string> pem_of(const EVP_PKEY* key) {
  const BioPtr memory(BIO_new(BIO_s_mem()));
  if (PEM_write_bio_PrivateKey(memory.get(), key, nullptr, nullptr, 0, nullptr, nullptr) != 1)
    return openssl_error("write a private key");
  return text_of(memory.get());
}

bool add_extension(X509* certificate, X509V3_CTX& context, int which, const char* value) {
  X509_EXTENSION* extension = X509V3_EXT_conf_nid(nullptr, &context, which, value);
  const bool is_added = extension != nullptr && X509_add_ext(certificate, extension, -1) == 1;
  X509_EXTENSION_free(extension);
  return is_added;
}

/// A certificate for `key`, signed by `authority`, or by itself where it is one.
Expected<CertificatePtr> certify(EVP_PKEY* key, const std::string& unit, const std::string& name,
                                 const Period& period, const Authority* authority) {
  CertificatePtr made(X509_new());
  uint64_t serial = 0;
  X509_NAME* subject = X509_NAME_new();
  const auto add = [&](const char* field, const std::string& value) {
    return X509_NAME_add_entry_by_txt(subject, field, MBSTRING_ASC,
                                      reinterpret_cast<const unsigned char*>(value.data()),
                                      static_cast<int>(value.size()), -1, 0) == 1;
  };
  bool is_right =
      made != nullptr && subject != nullptr &&
      RAND_bytes(reinterpret_cast<unsigned char*>(&serial), sizeof serial) == 1 &&
      X509_set_version(made.get(), 2) == 1 &&
      ASN1_INTEGER_set_uint64(X509_get_serialNumber(made.get()), serial >> 1) == 1 && add("O", "COMRAD") &&
      add("OU", unit) && add("CN", name) && X509_set_subject_name(made.get(), subject) == 1 &&
      X509_set_issuer_name(
          made.get(), authority == nullptr ? subject : X509_get_subject_name(authority->certificate.get())) ==
          1 &&
      ASN1_TIME_set(X509_getm_notBefore(made.get()), period.from_s) != nullptr &&
      ASN1_TIME_set(X509_getm_notAfter(made.get()), period.until_s) != nullptr &&
      X509_set_pubkey(made.get(), key) == 1;
  X509_NAME_free(subject);
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, authority == nullptr ? made.get() : authority->certificate.get(), made.get(),
                 nullptr, nullptr, 0);
  is_right = is_right &&
             add_extension(made.get(), context, NID_basic_constraints,
                           authority == nullptr ? "critical,CA:TRUE" : "critical,CA:FALSE") &&
             add_extension(made.get(), context, NID_key_usage,
                           authority == nullptr ? "critical,keyCertSign,digitalSignature"
                                                : "critical,digitalSignature,keyAgreement") &&
             X509_sign(made.get(), authority == nullptr ? key : authority->key.get(), EVP_sha256()) > 0;
  if (!is_right) return openssl_error("make a certificate for " + name);
  return made;
}

/// A document with the authority's signature, as S/MIME.
Expected<std::string> signed_by(const Authority& authority, const std::string& document) {
  const BioPtr in = memory_of(document), again = memory_of(document), out(BIO_new(BIO_s_mem()));
  constexpr int kFlags = PKCS7_TEXT | PKCS7_DETACHED;
  const Pkcs7Ptr made(
      PKCS7_sign(authority.certificate.get(), authority.key.get(), nullptr, in.get(), kFlags));
  if (made == nullptr || SMIME_write_PKCS7(out.get(), made.get(), again.get(), kFlags) != 1)
    return openssl_error("sign a document");
  return text_of(out.get());
}

constexpr const char* kDocumentHead =
    R"(<?xml version="1.0" encoding="UTF-8"?>)"
    "\n"
    R"(<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation=)";
constexpr const char* kAllDomains = "<domains><id_range><min>0</min><max>230</max></id_range></domains>\n";

/// What holds for all that meet. Unknown peers stay invisible; every message of ours is encrypted, with its
/// authenticity, once: as a submessage, where discovery, heartbeats and data alike pass through.
std::string governance() {
  return std::string(kDocumentHead) +
         R"("http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
<domain_access_rules><domain_rule>
)" + kAllDomains +
         R"(<allow_unauthenticated_participants>false</allow_unauthenticated_participants>
<enable_join_access_control>true</enable_join_access_control>
<discovery_protection_kind>ENCRYPT</discovery_protection_kind>
<liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
<rtps_protection_kind>NONE</rtps_protection_kind>
<topic_access_rules><topic_rule>
<topic_expression>*</topic_expression>
<enable_discovery_protection>true</enable_discovery_protection>
<enable_liveliness_protection>true</enable_liveliness_protection>
<enable_read_access_control>true</enable_read_access_control>
<enable_write_access_control>true</enable_write_access_control>
<metadata_protection_kind>ENCRYPT</metadata_protection_kind>
<data_protection_kind>NONE</data_protection_kind>
</topic_rule></topic_access_rules>
</domain_rule></domain_access_rules>
</dds>
)";
}

std::string time_text(time_t at_s) {
  char text[32];
  std::tm parts{};
  gmtime_r(&at_s, &parts);
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

std::string permissions(const std::string& subject, KeyRole role, const Period& period) {
  std::string publish, subscribe;
  for (const LinkTopic& topic : link_topics())
    (topic.writer == role ? publish : subscribe) += std::string("<topic>") + topic.name + "</topic>";
  const std::string partitions =
      "<partitions><partition>comrad-link-*</partition><partition>comrad-door-*</partition></partitions>";
  return std::string(kDocumentHead) +
         R"("http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
<permissions><grant name="link">
<subject_name>)" +
         subject + "</subject_name>\n<validity><not_before>" + time_text(period.from_s) +
         "</not_before><not_after>" + time_text(period.until_s) + "</not_after></validity>\n<allow_rule>\n" +
         kAllDomains + "<publish><topics>" + publish + "</topics>" + partitions +
         "</publish>\n<subscribe><topics>" + subscribe + "</topics>" + partitions +
         "</subscribe>\n</allow_rule>\n<default>DENY</default>\n</grant></permissions>\n</dds>\n";
}

KeyPtr fresh_key() { return KeyPtr(EVP_EC_gen("P-256")); }

Status write_identity(const std::string& folder, const std::string& name, KeyRole role, const Period& period,
                      const Authority& authority) {
  const KeyPtr key = fresh_key();
  if (key == nullptr) return openssl_error("make a key");
  COMRAD_TRY_ASSIGN(
      const CertificatePtr certificate,
      certify(key.get(), role == KeyRole::kRun ? kRunUnit : kHostUnit, name, period, &authority));
  COMRAD_TRY_ASSIGN(const std::string identity_pem, pem_of(certificate.get()));
  COMRAD_TRY_ASSIGN(const std::string key_pem, pem_of(key.get()));
  COMRAD_TRY_ASSIGN(const std::string authority_pem, pem_of(authority.certificate.get()));
  COMRAD_TRY_ASSIGN(const std::string rules, signed_by(authority, governance()));
  COMRAD_TRY_ASSIGN(const std::string rights,
                    signed_by(authority, permissions(subject_of(certificate.get()), role, period)));
  COMRAD_TRY(make_folder(folder));
  COMRAD_TRY(write_private_file(folder + "/" + kAuthorityFile, authority_pem));
  COMRAD_TRY(write_private_file(folder + "/" + kIdentityFile, identity_pem));
  COMRAD_TRY(write_private_file(folder + "/" + kKeyFile, key_pem));
  COMRAD_TRY(write_private_file(folder + "/" + kGovernanceFile, rules));
  return write_private_file(folder + "/" + kPermissionsFile, rights);
}

Status write_hosts(const KeyRequest& request, const Period& period, const Authority& authority) {
  for (const std::string& host : request.hosts)
    COMRAD_TRY(write_identity(request.folder + "/hosts/" + host, host, KeyRole::kHost, period, authority));
  return {};
}

}  // namespace

Status write_private_file(const std::string& path, const std::string& bytes) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (file < 0) return file_error(path, errno);
  const Status written = write_all(file, bytes, path);
  close(file);
  return written;
}

Status make_keys(const KeyRequest& request) {
  COMRAD_TRY(check_request(request));
  std::error_code code;
  if (fs::exists(request.folder, code) &&
      !(fs::is_directory(request.folder, code) && fs::is_empty(request.folder, code)))
    return Error{ErrorCode::kBadInput,
                 request.folder +
                     " holds something already, and keys are never replaced; name a new "
                     "folder, or add hosts to these keys with `comrad keys add`"};
  fs::create_directories(fs::absolute(request.folder).parent_path(), code);
  if (mkdir(request.folder.c_str(), 0700) != 0 && errno != EEXIST) return file_error(request.folder, errno);
  if (chmod(request.folder.c_str(), 0700) != 0) return file_error(request.folder, errno);
  uint32_t number = 0;
  Authority authority{nullptr, fresh_key()};
  if (authority.key == nullptr || RAND_bytes(reinterpret_cast<unsigned char*>(&number), sizeof number) != 1)
    return openssl_error("make a key");
  const Period period = period_of(request);
  COMRAD_TRY_ASSIGN(authority.certificate, certify(authority.key.get(), "authority",
                                                   fmt::format("authority {}", number), period, nullptr));
  COMRAD_TRY_ASSIGN(const std::string certificate_pem, pem_of(authority.certificate.get()));
  COMRAD_TRY_ASSIGN(const std::string key_pem, pem_of(authority.key.get()));
  COMRAD_TRY(make_folder(request.folder + "/authority"));
  COMRAD_TRY(write_private_file(request.folder + "/authority/" + kAuthorityFile, certificate_pem));
  COMRAD_TRY(write_private_file(request.folder + "/authority/" + kAuthorityKeyFile, key_pem));
  COMRAD_TRY(write_identity(request.folder + "/run", "run", KeyRole::kRun, period, authority));
  COMRAD_TRY(make_folder(request.folder + "/hosts"));
  return write_hosts(request, period, authority);
}

Status add_keys(const KeyRequest& request) {
  COMRAD_TRY(check_request(request));
  if (request.hosts.empty()) return Error{ErrorCode::kBadInput, "keys: name the hosts to add with --hosts"};
  const std::string place = request.folder + "/authority/";
  const std::optional<std::string> certificate = read_file(place + kAuthorityFile),
                                   key = read_file(place + kAuthorityKeyFile);
  if (!certificate || !key)
    return Error{ErrorCode::kNotFound, place + " has no " + kAuthorityFile + " and " + kAuthorityKeyFile +
                                           "; `comrad keys make " + request.folder + "` makes an authority"};
  const Authority authority{certificate_of(*certificate), key_of(*key)};
  if (authority.certificate == nullptr || authority.key == nullptr ||
      X509_check_private_key(authority.certificate.get(), authority.key.get()) != 1)
    return Error{ErrorCode::kBadFormat, place + ": certificate and key do not belong together (" +
                                            openssl_reason() + "); make new keys in a new folder"};
  std::error_code code;
  for (const std::string& host : request.hosts)
    if (fs::exists(request.folder + "/hosts/" + host, code))
      return Error{ErrorCode::kBadInput,
                   request.folder + "/hosts/" + host +
                       " is there already, and keys are never replaced; remove that folder "
                       "first to give the host a new identity"};
  // What it signs ends with it.
  Period period = period_of(request);
  std::tm end{};
  if (ASN1_TIME_to_tm(X509_get0_notAfter(authority.certificate.get()), &end) != 1)
    return openssl_error("read the authority's dates");
  period.until_s = std::min(period.until_s, timegm(&end));
  if (period.until_s <= std::max(period.from_s, std::time(nullptr)))
    return Error{ErrorCode::kBadInput, place + kAuthorityFile + " ended " + time_text(timegm(&end)) +
                                           "; make new keys in a new folder"};
  return write_hosts(request, period, authority);
}

}  // namespace comrad::dds
