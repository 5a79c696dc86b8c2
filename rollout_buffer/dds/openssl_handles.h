// OpenSSL's objects, freed with their handle, and its files. For the sources of this folder.
#pragma once

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/x509.h>

#include <memory>
#include <optional>
#include <string>

namespace comrad::dds {

template <auto free_function>
struct OpensslFree {
  template <typename T>
  void operator()(T* object) const {
    free_function(object);
  }
};
using BioPtr = std::unique_ptr<BIO, OpensslFree<&BIO_free_all>>;
using KeyPtr = std::unique_ptr<EVP_PKEY, OpensslFree<&EVP_PKEY_free>>;
using CertificatePtr = std::unique_ptr<X509, OpensslFree<&X509_free>>;
using Pkcs7Ptr = std::unique_ptr<PKCS7, OpensslFree<&PKCS7_free>>;
using StorePtr = std::unique_ptr<X509_STORE, OpensslFree<&X509_STORE_free>>;

inline std::string openssl_reason() {
  char text[256] = "unknown";
  if (const unsigned long code = ERR_peek_last_error(); code != 0)
    ERR_error_string_n(code, text, sizeof text);
  ERR_clear_error();
  return text;
}

inline BioPtr memory_of(const std::string& bytes) {
  return BioPtr(BIO_new_mem_buf(bytes.data(), static_cast<int>(bytes.size())));
}
inline std::string text_of(BIO* memory) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(memory, &data);
  return size > 0 ? std::string(data, static_cast<std::size_t>(size)) : std::string();
}

/// A PEM with a password would prompt for it on the terminal; here it just fails.
inline int no_password(char*, int, int, void*) { return -1; }

inline CertificatePtr certificate_of(const std::string& pem) {
  return CertificatePtr(PEM_read_bio_X509(memory_of(pem).get(), nullptr, &no_password, nullptr));
}
inline KeyPtr key_of(const std::string& pem) {
  return KeyPtr(PEM_read_bio_PrivateKey(memory_of(pem).get(), nullptr, &no_password, nullptr));
}

/// "O=COMRAD,OU=host,CN=alpha", as the permissions name a certificate's subject.
inline std::string subject_of(const X509* certificate) {
  const BioPtr memory(BIO_new(BIO_s_mem()));
  X509_NAME_print_ex(memory.get(), X509_get_subject_name(certificate), 0,
                     (XN_FLAG_ONELINE & ~XN_FLAG_SEP_CPLUS_SPC & ~XN_FLAG_SPC_EQ) | XN_FLAG_SEP_COMMA_PLUS);
  return text_of(memory.get());
}

}  // namespace comrad::dds
