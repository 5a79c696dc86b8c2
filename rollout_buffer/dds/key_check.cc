#include <dds/dds.h>
#include <dlfcn.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <map>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/dds/key_files.h"
#include "rollout_buffer/dds/keys.h"
#include "rollout_buffer/dds/openssl_handles.h"

namespace comrad::dds {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostFileBytes = 1 << 20;

Error bad(const std::string& path, const std::string& what) {
  return Error{ErrorCode::kBadFormat, path + ": " + what};
}

Expected<time_t> time_of(const ASN1_TIME* time, const std::string& path) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return bad(path, "has dates that cannot be read; make new keys");
  return timegm(&parts);
}

std::string day(time_t at_s) {
  char text[32];
  std::tm parts{};
  gmtime_r(&at_s, &parts);
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", &parts);
  return text;
}

Status check_period(const std::string& path, const char* what, time_t from_s, time_t until_s) {
  const time_t now_s = std::time(nullptr);
  if (now_s < from_s)
    return Error{ErrorCode::kBadInput, path + ": the " + what + " begins " + day(from_s) +
                                           ", which has not come; is this host's clock right?"};
  if (now_s >= until_s)
    return Error{ErrorCode::kBadInput,
                 path + ": the " + what + " ended " + day(until_s) +
                     "; `comrad keys` makes new keys, in a new folder or for this host alone"};
  return {};
}

/// The content of a signed document. Errors: kBadFormat where it is not what the authority signed.
Expected<std::string> open_signed(const std::string& path, const std::string& bytes, X509* authority) {
  BIO* content = nullptr;
  const Pkcs7Ptr document(SMIME_read_PKCS7(memory_of(bytes).get(), &content));
  const BioPtr owned(content);
  if (document == nullptr || content == nullptr)
    return bad(path, "is no signed document (S/MIME): " + openssl_reason());
  const StorePtr store(X509_STORE_new());
  const BioPtr text(BIO_new(BIO_s_mem()));
  X509_STORE_add_cert(store.get(), authority);
  X509_STORE_set_flags(store.get(), X509_V_FLAG_NO_CHECK_TIME);  // dates have a separate message
  if (PKCS7_verify(document.get(), nullptr, store.get(), content, text.get(), PKCS7_TEXT) != 1) {
    openssl_reason();
    return bad(path, std::string("is not what the authority of ") + kAuthorityFile +
                         " signed: it was changed, or belongs to other keys; copy this host's folder again "
                         "from where `comrad keys` made it");
  }
  return text_of(text.get());
}

/// What stands between <name> and </name> for the first time.
std::string element(const std::string& document, const std::string& name) {
  const std::size_t begin = document.find("<" + name + ">"), end = document.find("</" + name + ">");
  if (begin == std::string::npos || end == std::string::npos || end < begin) return "";
  return document.substr(begin + name.size() + 2, end - begin - name.size() - 2);
}

Expected<time_t> xml_time(const std::string& document, const char* name, const std::string& path) {
  std::tm parts{};
  const std::string text = element(document, name);
  const char* end = strptime(text.c_str(), "%Y-%m-%dT%H:%M:%SZ", &parts);
  if (end == nullptr || *end != '\0') return bad(path, std::string("has no date in ") + name);
  return timegm(&parts);
}

std::string field_of(const X509* certificate, int field) {
  char text[128] = "";
  X509_NAME_get_text_by_NID(X509_get_subject_name(certificate), field, text, sizeof text);
  return text;
}

}  // namespace

Expected<KeyIdentity> check_keys(const std::string& folder) {
  std::error_code code;
  if (!fs::is_directory(folder, code))
    return Error{ErrorCode::kNotFound, "no key folder at '" + folder + "'; `comrad keys make` makes keys"};
  if (!fs::exists(folder + "/" + kIdentityFile, code) && fs::exists(folder + "/run", code))
    return Error{ErrorCode::kBadInput, folder + " holds the keys of all; name one identity: " + folder +
                                           "/run for the host that serves, " + folder +
                                           "/hosts/<name> for one that joins"};
  std::map<std::string, std::string> bytes;
  for (const char* name : {kAuthorityFile, kIdentityFile, kKeyFile, kGovernanceFile, kPermissionsFile}) {
    const std::string path = folder + "/" + name;
    Expected<std::string> read = read_short_file(path, kMostFileBytes);
    if (!read)
      return Error{read.error().code, read.error().message + "; a key folder has " + kAuthorityFile + ", " +
                                          kIdentityFile + ", " + kKeyFile + ", " + kGovernanceFile + " and " +
                                          kPermissionsFile + ", as `comrad keys` makes them"};
    bytes[name] = std::move(read).value();
  }
  const auto path_of = [&](const char* name) { return folder + "/" + name; };

  struct stat status {};
  if (stat(path_of(kKeyFile).c_str(), &status) != 0) return file_error(path_of(kKeyFile), errno);
  if ((status.st_mode & 077) != 0)
    return Error{ErrorCode::kBadInput,
                 path_of(kKeyFile) +
                     ": other users of this host may read it; `chmod 600` it, and make new "
                     "keys if another user could have"};

  const CertificatePtr authority = certificate_of(bytes[kAuthorityFile]);
  if (authority == nullptr)
    return bad(path_of(kAuthorityFile), "is no certificate (PEM): " + openssl_reason());
  const CertificatePtr identity = certificate_of(bytes[kIdentityFile]);
  if (identity == nullptr) return bad(path_of(kIdentityFile), "is no certificate (PEM): " + openssl_reason());
  const KeyPtr key = key_of(bytes[kKeyFile]);
  if (key == nullptr)
    return bad(path_of(kKeyFile), "is no private key without a password (PEM): " + openssl_reason());
  if (X509_check_private_key(identity.get(), key.get()) != 1) {
    openssl_reason();
    return bad(path_of(kKeyFile), std::string("does not belong to ") + kIdentityFile);
  }
  if (X509_verify(identity.get(), X509_get0_pubkey(authority.get())) != 1) {
    openssl_reason();
    return bad(path_of(kIdentityFile), std::string("was not signed by the authority of ") + kAuthorityFile);
  }

  COMRAD_TRY(open_signed(path_of(kGovernanceFile), bytes[kGovernanceFile], authority.get()));
  COMRAD_TRY_ASSIGN(const std::string rights,
                    open_signed(path_of(kPermissionsFile), bytes[kPermissionsFile], authority.get()));
  const std::string permissions_path = path_of(kPermissionsFile);
  if (element(rights, "subject_name") != subject_of(identity.get()))
    return bad(permissions_path, "was made for " + element(rights, "subject_name").substr(0, 200) +
                                     ", not for " + subject_of(identity.get()));
  COMRAD_TRY_ASSIGN(const time_t rights_from_s, xml_time(rights, "not_before", permissions_path));
  COMRAD_TRY_ASSIGN(const time_t rights_until_s, xml_time(rights, "not_after", permissions_path));
  COMRAD_TRY(check_period(permissions_path, "permission", rights_from_s, rights_until_s));

  KeyIdentity found;
  found.name = field_of(identity.get(), NID_commonName);
  found.until_s = rights_until_s;
  for (const auto& [name, certificate] :
       {std::pair(kIdentityFile, identity.get()), {kAuthorityFile, authority.get()}}) {
    COMRAD_TRY_ASSIGN(const time_t from_s, time_of(X509_get0_notBefore(certificate), path_of(name)));
    COMRAD_TRY_ASSIGN(const time_t until_s, time_of(X509_get0_notAfter(certificate), path_of(name)));
    COMRAD_TRY(check_period(path_of(name), "certificate", from_s, until_s));
    found.until_s = std::min<int64_t>(found.until_s, until_s);
  }
  const std::string unit = field_of(identity.get(), NID_organizationalUnitName);
  if (unit != kRunUnit && unit != kHostUnit)
    return bad(path_of(kIdentityFile),
               "names neither run nor host in its unit; create it with `comrad keys`");
  found.role = unit == kRunUnit ? KeyRole::kRun : KeyRole::kHost;
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  if (X509_digest(authority.get(), EVP_sha256(), digest, &size) == 1)
    for (unsigned int i = 0; i < 8 && i < size; ++i) {
      constexpr char kDigits[] = "0123456789abcdef";
      found.authority += {kDigits[digest[i] >> 4], kDigits[digest[i] & 15]};
    }
  return found;
}

Expected<std::string> security_plugins() {
  // Where Cyclone itself was loaded from; a plugin belongs to the library of the same build.
  Dl_info library{};
  std::string beside;
  if (dladdr(reinterpret_cast<void*>(&dds_create_participant), &library) != 0 &&
      library.dli_fname != nullptr) {
    std::error_code code;
    beside = fs::canonical(library.dli_fname, code).parent_path().string();
  }
  std::string looked;
  for (const char* below : {"/libddsc0debian", "/cyclonedds", ""}) {
    const std::string folder = beside + below;
    bool has_all = true;
    for (const char* name : {"auth", "ac", "crypto"})
      has_all &= access((folder + "/libdds_security_" + name + ".so").c_str(), R_OK) == 0;
    if (has_all) return folder;
    looked += (looked.empty() ? "" : ", ") + folder;
  }
  return Error{ErrorCode::kUnsupported,
               "Cyclone DDS has no security plugins (libdds_security_auth.so, _ac.so, _crypto.so) in " +
                   looked +
                   "; Debian's package libddsc0debian brings them, in Debian 13 libddsc0t64 (apt install "
                   "--reinstall), a Cyclone of your own is built with -DENABLE_SECURITY=ON"};
}

Expected<std::string> security_config(const std::string& folder) {
  COMRAD_TRY_ASSIGN(const std::string plugins, security_plugins());
  std::error_code code;
  const std::string place = fs::canonical(folder, code).string();
  if (code) return file_error(folder, code.value());
  for (const std::string& path : {place, plugins})
    if (path.find_first_of("<>&\"'$,\n") != std::string::npos)
      return Error{ErrorCode::kBadInput,
                   "key folder '" + path +
                       "': Cyclone's configuration cannot hold a path with one of <>&\"'$ or a "
                       "comma; move it"};
  const auto library = [&](const std::string& file, const std::string& function) {
    return "<Library path=\"" + plugins + "/libdds_security_" + file + ".so\" initFunction=\"init_" +
           function + "\" finalizeFunction=\"finalize_" + function + "\"/>";
  };
  const auto part = [&](const std::string& name, const char* file) {
    return "<" + name + ">file:" + place + "/" + file + "</" + name + ">";
  };
  return "<Security><Authentication>" + library("auth", "authentication") +
         part("IdentityCA", kAuthorityFile) + part("IdentityCertificate", kIdentityFile) +
         part("PrivateKey", kKeyFile) + "</Authentication><AccessControl>" + library("ac", "access_control") +
         part("PermissionsCA", kAuthorityFile) + part("Governance", kGovernanceFile) +
         part("Permissions", kPermissionsFile) + "</AccessControl><Cryptographic>" +
         library("crypto", "crypto") + "</Cryptographic></Security>";
}

}  // namespace comrad::dds
