#include "doomgen/wad/wad_reader.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "doomgen/wad/map_records.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::wad {
namespace {

template <typename Record>
Record read_record(std::span<const uint8_t> bytes, std::size_t offset) {
  Record record;
  std::memcpy(&record, bytes.data() + offset, sizeof(Record));
  return record;
}

/// "S_START" also stands for "SS_START".
bool is_marker(std::string_view lump_name, std::string_view marker) {
  return lump_name == marker || (!marker.empty() && lump_name.size() == marker.size() + 1 &&
                                 lump_name.front() == marker.front() && lump_name.substr(1) == marker);
}

/// Lumps that belong to the map marker above them, in the formats that have no end marker.
bool is_binary_map_lump(std::string_view name) {
  static constexpr std::array<std::string_view, 17> kNames = {
      "THINGS",   "LINEDEFS", "SIDEDEFS", "VERTEXES", "SEGS",    "SSECTORS", "NODES",    "SECTORS", "REJECT",
      "BLOCKMAP", "BEHAVIOR", "SCRIPTS",  "DIALOGUE", "GL_VERT", "GL_SEGS",  "GL_SSECT", "GL_NODES"};
  return std::find(kNames.begin(), kNames.end(), name) != kNames.end();
}

}  // namespace

/// The bytes, mapped or owned.
struct WadFile::Storage {
  std::vector<uint8_t> owned;
  void* mapping = nullptr;
  std::size_t mapping_bytes = 0;

  Storage() = default;
  Storage(const Storage&) = delete;
  Storage& operator=(const Storage&) = delete;
  ~Storage() {
    if (mapping != nullptr) munmap(mapping, mapping_bytes);
  }
  std::span<const uint8_t> view() const {
    if (mapping != nullptr) return {static_cast<const uint8_t*>(mapping), mapping_bytes};
    return owned;
  }
};

Expected<WadFile> WadFile::open(const std::string& path, const std::string& label) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return file_error(path + ": cannot open the WAD", errno);
  struct stat status {};
  if (fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
    ::close(descriptor);
    return Error{ErrorCode::kBadInput, path + ": not a regular file, so no WAD"};
  }
  auto storage = std::make_shared<Storage>();
  if (status.st_size > 0) {
    void* mapping =
        mmap(nullptr, static_cast<std::size_t>(status.st_size), PROT_READ, MAP_PRIVATE, descriptor, 0);
    if (mapping == MAP_FAILED) {
      const Error failed = file_error(path + ": cannot map the WAD", errno);
      ::close(descriptor);
      return failed;
    }
    storage->mapping = mapping;
    storage->mapping_bytes = static_cast<std::size_t>(status.st_size);
  }
  ::close(descriptor);
  return parse(std::move(storage), label.empty() ? path : label);
}

Expected<WadFile> WadFile::from_bytes(std::vector<uint8_t> bytes, std::string label) {
  auto storage = std::make_shared<Storage>();
  storage->owned = std::move(bytes);
  return parse(std::move(storage), std::move(label));
}

Expected<WadFile> WadFile::parse(std::shared_ptr<const Storage> storage, std::string path) {
  const std::span<const uint8_t> bytes = storage->view();
  const auto bad = [&path](const std::string& what) {
    return Error{ErrorCode::kBadFormat, path + ": " + what};
  };
  if (bytes.size() < sizeof(WadHeaderRecord))
    return bad(fmt::format("shorter than a WAD header ({} of 12 bytes)", bytes.size()));
  const auto header = read_record<WadHeaderRecord>(bytes, 0);
  const std::string_view magic(header.magic.data(), header.magic.size());
  if (magic != "IWAD" && magic != "PWAD") return bad("does not begin with IWAD or PWAD, so it is no WAD");
  const int64_t count = header.lump_count, directory = header.directory_offset_bytes;
  if (count < 0 || directory < 0 ||
      directory + count * static_cast<int64_t>(sizeof(DirectoryRecord)) > static_cast<int64_t>(bytes.size()))
    return bad(fmt::format(
        "the directory of {} lumps at byte {} reaches past the end of the file ({} bytes): truncated?", count,
        directory, bytes.size()));

  WadFile wad;
  wad.is_iwad_ = magic == "IWAD";
  wad.lumps_.reserve(static_cast<std::size_t>(count));
  for (std::size_t index = 0; index < static_cast<std::size_t>(count); ++index) {
    const auto record = read_record<DirectoryRecord>(
        bytes, static_cast<std::size_t>(directory) + index * sizeof(DirectoryRecord));
    const auto* const end = std::find(record.name.begin(), record.name.end(), '\0');
    Lump lump;
    lump.name =
        upper_case(std::string_view(record.name.data(), static_cast<std::size_t>(end - record.name.begin())));
    // Markers may have any offset.
    if (record.size_bytes != 0) {
      const int64_t offset = record.offset_bytes, size = record.size_bytes;
      if (offset < 0 || size < 0 || offset + size > static_cast<int64_t>(bytes.size()))
        return bad(fmt::format(
            "lump {} '{}' ({} bytes at byte {}) reaches past the end of the file ({} bytes): truncated?",
            index, lump.name, size, offset, bytes.size()));
      lump.offset_bytes = static_cast<uint32_t>(offset);
      lump.size_bytes = static_cast<uint32_t>(size);
    }
    wad.last_of_name_[lump.name] = index;
    wad.lumps_.push_back(std::move(lump));
  }
  wad.storage_ = std::move(storage);
  wad.path_ = std::move(path);
  return wad;
}

std::span<const uint8_t> WadFile::bytes(std::size_t index) const {
  return storage_->view().subspan(lumps_[index].offset_bytes, lumps_[index].size_bytes);
}

std::string_view WadFile::text(std::size_t index) const {
  const std::span<const uint8_t> view = bytes(index);
  return {reinterpret_cast<const char*>(view.data()), view.size()};
}

std::optional<std::size_t> WadFile::find(std::string_view name) const {
  const auto found = last_of_name_.find(upper_case(name));
  if (found == last_of_name_.end()) return std::nullopt;
  return found->second;
}

std::vector<std::size_t> WadFile::lumps_between(std::string_view start, std::string_view end) const {
  std::vector<std::size_t> result, open;
  bool inside = false;
  for (std::size_t index = 0; index < lumps_.size(); ++index) {
    const std::string& name = lumps_[index].name;
    if (is_marker(name, start)) {
      inside = true;
      open.clear();
    } else if (is_marker(name, end)) {
      result.insert(result.end(), open.begin(), open.end());
      open.clear();
      inside = false;
    } else if (inside && lumps_[index].size_bytes > 0) {
      open.push_back(index);
    }
  }
  return result;
}

bool WadFile::is_map_marker(std::size_t index) const {
  if (index + 1 >= lumps_.size()) return false;
  const std::string& next = lumps_[index + 1].name;
  return next == "TEXTMAP" || (next == "THINGS" && !is_binary_map_lump(lumps_[index].name));
}

std::vector<std::string> WadFile::map_names() const {
  std::vector<std::string> names;
  for (std::size_t index = 0; index < lumps_.size(); ++index)
    if (is_map_marker(index)) names.push_back(lumps_[index].name);
  return names;
}

Expected<MapLumps> WadFile::find_map(std::string_view name) const {
  const std::string wanted = upper_case(name);
  std::optional<std::size_t> marker;
  for (std::size_t index = 0; index < lumps_.size(); ++index)
    if (lumps_[index].name == wanted && is_map_marker(index)) marker = index;
  if (!marker) {
    const std::string known = joined(map_names());
    return Error{
        ErrorCode::kNotFound,
        path_ + ": no map " + wanted + (known.empty() ? " (and no other map)" : " (it has " + known + ")")};
  }
  MapLumps lumps;
  lumps.marker = *marker;
  std::size_t index = *marker + 1;
  // Within a map the last lump of a name counts; their order is free.
  const auto note = [&](std::size_t at) {
    static constexpr std::pair<std::string_view, std::optional<std::size_t> MapLumps::*> kLumps[] = {
        {"BEHAVIOR", &MapLumps::behavior}, {"SCRIPTS", &MapLumps::scripts},
        {"DIALOGUE", &MapLumps::dialogue}, {"THINGS", &MapLumps::things},
        {"LINEDEFS", &MapLumps::linedefs}, {"SIDEDEFS", &MapLumps::sidedefs},
        {"VERTEXES", &MapLumps::vertexes}, {"SECTORS", &MapLumps::sectors},
    };
    for (const auto& [lump_name, member] : kLumps)
      if (lumps_[at].name == lump_name) lumps.*member = at;
  };
  if (lumps_[index].name == "TEXTMAP") {
    lumps.textmap = index;
    while (++index < lumps_.size() && lumps_[index].name != "ENDMAP") note(index);
    if (index >= lumps_.size())
      return Error{ErrorCode::kBadFormat, path_ + ": map " + wanted + " has a TEXTMAP but no ENDMAP lump"};
    lumps.end = index + 1;
  } else {
    for (; index < lumps_.size() && is_binary_map_lump(lumps_[index].name); ++index) note(index);
    lumps.end = index;
  }
  return lumps;
}

}  // namespace comrad::wad
