// Turns the bytes of a BEHAVIOR lump into a Behavior; every offset and count is checked here, so that nobody
// after it needs to. Stage: loading.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/acs/behavior.h"

namespace comrad::doom::acs {

/// What a lump imports of other lumps.
struct BehaviorLinks {
  struct Variable {
    uint32_t number = 0;
    std::string name;
  };
  std::vector<std::string> libraries;  ///< that it requests (LOAD)
  std::vector<std::string> exported;   ///< names of its map variables, by number
  std::vector<Variable> imported;      ///< variables and arrays of libraries
  std::vector<uint32_t> texts;         ///< map variables and arrays whose first values are texts
};

/// Three containers hold scripts:
///
///   ACS0     "ACS\0", offset of a directory at 4: scripts of 12 bytes (1000 * type + number), then strings.
///            Plain code.
///   ACSE/e   "ACSE" (plain) or "ACSe" (compact), offset of chunks at 4. SPTR entries of 12 bytes.
///   hidden   "ACS\0" with an empty directory; the 8 bytes before it are the chunks' offset and "ACSE" or
///            "ACSe". SPTR entries of 8 bytes.
class BehaviorReader {
 public:
  BehaviorReader(std::span<const uint8_t> lump, const std::string& label) : bytes_(lump), label_(label) {}

  Expected<std::shared_ptr<Behavior>> read();
  const BehaviorLinks& links() const { return links_; }  ///< of what has been read

 private:
  using Bytes = std::span<const uint8_t>;

  Status read_old(Behavior& behavior, uint32_t directory);
  Status read_chunks(Behavior& behavior, uint32_t first, bool wide_scripts);
  Status read_scripts(Behavior& behavior, Bytes chunk, bool wide);
  Status read_script_facts(Behavior& behavior, Bytes chunk, bool flags);
  Status read_functions(Behavior& behavior, Bytes chunk);
  Status read_strings(Behavior& behavior, Bytes chunk, bool encrypted);
  Status read_arrays(Behavior& behavior, Bytes chunk);
  Status read_variables(Behavior& behavior, Bytes chunk);
  void read_array_values(Behavior& behavior, Bytes chunk);
  Status read_local_arrays(Bytes chunk, int32_t first, std::vector<LocalArray>& arrays, int32_t& end);
  /// Names in a chunk of a count and offsets from its start.
  Expected<std::vector<std::string>> read_names(Bytes chunk);
  /// The text at `offset` of `bytes` up to its zero; nothing where it runs out of them.
  static std::optional<std::string> text_at(Bytes bytes, uint64_t offset);
  Status read_links(std::string_view tag, Bytes chunk);
  Error error(uint64_t offset, const std::string& what) const;
  uint64_t offset_of(Bytes chunk) const { return static_cast<uint64_t>(chunk.data() - bytes_.data()); }

  Bytes bytes_;  // without the directory behind which a lump hides
  std::string label_;
  BehaviorLinks links_;
};

}  // namespace comrad::doom::acs
