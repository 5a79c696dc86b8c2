// Names in a key folder.
#pragma once

namespace comrad::dds {

constexpr const char* kAuthorityFile = "authority.pem";
constexpr const char* kAuthorityKeyFile = "authority.key";
constexpr const char* kIdentityFile = "identity.pem";
constexpr const char* kKeyFile = "identity.key";
constexpr const char* kGovernanceFile = "governance.p7s";
constexpr const char* kPermissionsFile = "permissions.p7s";

// Organizational unit of an identity: its role.
constexpr const char* kRunUnit = "run";
constexpr const char* kHostUnit = "host";

}  // namespace comrad::dds
