// Collects lumps and writes them as one PWAD: header, data, directory. Little-endian on every machine.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "doomgen/layout/hexen_writer.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

/// Adds lumps in order; names are upper-case, 1..8 characters.
class WadWriter {
 public:
  /// Adds a lump; an empty one is a marker.
  /// Errors: kBadInput for a name that a directory cannot hold.
  Status add(std::string_view name, std::string_view bytes);
  /// Adds a UDMF map: marker, TEXTMAP, BEHAVIOR and SCRIPTS (if there are any), ENDMAP.
  Status add_udmf_map(std::string_view map_name, std::string_view textmap, std::string_view behavior = {},
                      std::string_view scripts = {});
  /// Adds a Hexen map: marker, the binary lumps in their order (nodes empty), BEHAVIOR (one without scripts
  /// where `behavior` is empty: it marks the format), SCRIPTS.
  Status add_hexen_map(std::string_view map_name, const HexenLumps& lumps, std::string_view behavior = {},
                       std::string_view scripts = {});

  /// The bytes of the file.
  /// Errors: kNoSpace when it would pass 2 GB, which the format cannot address.
  Expected<std::string> bytes() const;

 private:
  struct Lump {
    std::string name, bytes;
  };
  std::vector<Lump> lumps_;
};

/// FNV-1a 64 over a file's bytes: the identity of a layout.
uint64_t content_hash(std::string_view bytes);

}  // namespace comrad::doomgen
