// Keys for a link that leaves loopback: an authority, an identity for the run and for each host, and signed documents that
// say what each may do (DDS Security 1.1, the form that Cyclone's plugins read). `comrad keys` makes them; a participant
// of the link looks at its own folder before it starts. SECURITY.md in deploy/ is for users.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::dds {

/// Whose identity a key folder holds. What each role may write is in link_topics().
enum class KeyRole { kRun, kHost };

/// A topic of the link as permissions see it. Each role reads what the other one writes.
struct LinkTopic {
  const char* name;
  KeyRole writer;
};
const std::vector<LinkTopic>& link_topics();

/// What to make. All that is made holds from `start_s` on (Unix time, s; 0: from a day ago, so that clocks may differ)
/// for `days`.
struct KeyRequest {
  std::string folder;              ///< "<folder>/authority", "<folder>/run", "<folder>/hosts/<name>"
  std::vector<std::string> hosts;  ///< names of letters, digits, - _ and .
  int days = 365;
  int64_t start_s = 0;
};

constexpr int kMostKeyDays = 3650;

/// Makes authority, run and hosts in a new folder, for its owner alone (folders 0700, files 0600).
/// Errors: kBadInput for a name, for days, or where the folder holds something; kSystem, kNoSpace.
Status make_keys(const KeyRequest& request);
/// Makes identities for more hosts, signed by the authority that is there. Errors: as make_keys(); kBadInput where a
/// host has one; kNotFound without an authority.
Status add_keys(const KeyRequest& request);

/// Writes a new file for its owner alone: a key, a link's id. Errors: as file_error().
Status write_private_file(const std::string& path, const std::string& bytes);

/// The identity in one key folder: <folder>/run or <folder>/hosts/<name>.
struct KeyIdentity {
  std::string name;
  KeyRole role = KeyRole::kHost;
  std::string authority;  ///< the authority's fingerprint, SHA-256, the first 16 hex digits
  int64_t until_s = 0;    ///< Unix time at which the first part of it ends
};

/// Looks at a key folder as the plugins will: files, modes, signatures, dates, and that all parts belong together.
/// Errors: kNotFound, kBadInput, kBadFormat, with the name of the file that is wrong and what to do.
Expected<KeyIdentity> check_keys(const std::string& folder);

/// The <Security> part of Cyclone's configuration for a checked key folder. Errors: kUnsupported where Cyclone's plugins
/// are missing.
Expected<std::string> security_config(const std::string& folder);

/// The folder with Cyclone's security plugins: beside the library that this process runs, or in the private folder of
/// Debian's package there. Errors: kUnsupported saying what to install.
Expected<std::string> security_plugins();

}  // namespace comrad::dds
