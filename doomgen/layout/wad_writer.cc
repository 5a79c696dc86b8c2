#include "doomgen/layout/wad_writer.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

namespace comrad::doomgen {
namespace {

constexpr std::size_t kHeaderBytes = 12, kEntryBytes = 16, kNameBytes = 8;

void put_u32(std::string& out, std::size_t value) {
  for (int shift = 0; shift < 32; shift += 8) out += static_cast<char>((value >> shift) & 0xFF);
}

}  // namespace

Status WadWriter::add(std::string_view name, std::string_view bytes) {
  const bool good = !name.empty() && name.size() <= kNameBytes &&
                    std::all_of(name.begin(), name.end(),
                                [](char c) { return c > ' ' && c <= '~' && !(c >= 'a' && c <= 'z'); });
  if (!good)
    return Error{ErrorCode::kBadInput,
                 "'" + std::string(name) + "' is no lump name: 1 to 8 upper-case characters"};
  lumps_.push_back({std::string(name), std::string(bytes)});
  return {};
}

Status WadWriter::add_udmf_map(std::string_view map_name, std::string_view textmap, std::string_view behavior,
                               std::string_view scripts) {
  COMRAD_TRY(add(map_name, {}));
  COMRAD_TRY(add("TEXTMAP", textmap));
  if (!behavior.empty()) COMRAD_TRY(add("BEHAVIOR", behavior));
  if (!scripts.empty()) COMRAD_TRY(add("SCRIPTS", scripts));
  return add("ENDMAP", {});
}

Status WadWriter::add_hexen_map(std::string_view map_name, const HexenLumps& lumps, std::string_view behavior,
                                std::string_view scripts) {
  // "ACS\0", the directory's place, no scripts, no strings.
  constexpr std::string_view kNoScripts("ACS\0\x08\0\0\0\0\0\0\0\0\0\0\0", 16);
  COMRAD_TRY(add(map_name, {}));
  COMRAD_TRY(add("THINGS", lumps.things));
  COMRAD_TRY(add("LINEDEFS", lumps.linedefs));
  COMRAD_TRY(add("SIDEDEFS", lumps.sidedefs));
  COMRAD_TRY(add("VERTEXES", lumps.vertexes));
  for (const char* name : {"SEGS", "SSECTORS", "NODES"}) COMRAD_TRY(add(name, {}));
  COMRAD_TRY(add("SECTORS", lumps.sectors));
  for (const char* name : {"REJECT", "BLOCKMAP"}) COMRAD_TRY(add(name, {}));
  COMRAD_TRY(add("BEHAVIOR", behavior.empty() ? kNoScripts : behavior));
  if (!scripts.empty()) COMRAD_TRY(add("SCRIPTS", scripts));
  return {};
}

Expected<std::string> WadWriter::bytes() const {
  std::size_t data_bytes = kHeaderBytes;
  for (const Lump& lump : lumps_) data_bytes += lump.bytes.size();
  const std::size_t total = data_bytes + kEntryBytes * lumps_.size();
  if (total > INT32_MAX)
    return Error{ErrorCode::kNoSpace,
                 fmt::format("the WAD would have {} bytes; the format ends at 2 GB", total)};
  std::string out;
  out.reserve(total);
  out += "PWAD";
  put_u32(out, lumps_.size());
  put_u32(out, data_bytes);
  for (const Lump& lump : lumps_) out += lump.bytes;
  std::size_t offset = kHeaderBytes;
  for (const Lump& lump : lumps_) {
    put_u32(out, offset);
    put_u32(out, lump.bytes.size());
    std::string name = lump.name;
    name.resize(kNameBytes, '\0');
    out += name;
    offset += lump.bytes.size();
  }
  return out;
}

uint64_t content_hash(std::string_view bytes) {
  uint64_t hash = 0xCBF29CE484222325ull;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3ull;
  return hash;
}

}  // namespace comrad::doomgen
