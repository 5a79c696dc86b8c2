// Reads WAD files: the directory, lumps by name (the last of a name wins), the lumps of a map and those
// between two markers. Every offset is checked once, on opening; what comes out afterwards cannot reach
// outside the file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::wad {

/// A line of the directory; the name in upper case.
struct Lump {
  std::string name;
  uint32_t offset_bytes = 0, size_bytes = 0;
};

/// The lumps of one map, by index into the directory.
struct MapLumps {
  std::size_t marker = 0;
  std::optional<std::size_t> textmap;   ///< there: a UDMF map
  std::optional<std::size_t> behavior;  ///< compiled scripts; the last lump of that name, as below
  std::optional<std::size_t> scripts, dialogue;
  std::optional<std::size_t> things, linedefs, sidedefs, vertexes, sectors;  ///< of a binary map
  std::size_t end = 0;  ///< one past the last lump of the map
};

/// One WAD in memory; copies share the bytes.
class WadFile {
 public:
  /// Maps the file at `path`; messages about what is in it name `label` where that is not empty. Errors: kNotFound,
  /// kSystem, kBadFormat with the offending lump.
  static Expected<WadFile> open(const std::string& path, const std::string& label = {});
  /// Takes bytes that are in memory already; `label` stands for the path in messages. Errors: kBadFormat.
  static Expected<WadFile> from_bytes(std::vector<uint8_t> bytes, std::string label);

  const std::string& path() const { return path_; }
  bool is_iwad() const { return is_iwad_; }
  std::size_t lump_count() const { return lumps_.size(); }
  const Lump& lump(std::size_t index) const { return lumps_[index]; }
  std::span<const uint8_t> bytes(std::size_t index) const;
  std::string_view text(std::size_t index) const;

  /// The last lump of that name (any case).
  std::optional<std::size_t> find(std::string_view name) const;
  /// Lumps between markers such as S_START and S_END, in file order, markers left out. Doubled first letters
  /// (SS_START) count as the same marker; several ranges are joined; an open range is none.
  std::vector<std::size_t> lumps_between(std::string_view start, std::string_view end) const;
  /// Names of all maps, in file order.
  std::vector<std::string> map_names() const;
  /// The map of that name, the last if there are several. Errors: kNotFound (with the maps there
  /// are), kBadFormat.
  Expected<MapLumps> find_map(std::string_view name) const;

 private:
  struct Storage;
  static Expected<WadFile> parse(std::shared_ptr<const Storage> storage, std::string path);
  bool is_map_marker(std::size_t index) const;

  std::shared_ptr<const Storage> storage_;
  std::string path_;
  bool is_iwad_ = false;
  std::vector<Lump> lumps_;
  std::unordered_map<std::string, std::size_t> last_of_name_;
};

}  // namespace comrad::wad
