#include "sim_workers/engine/acs/behavior_reader.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <numeric>
#include <string_view>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/strings.h"

namespace comrad::doom::acs {
namespace {

constexpr std::size_t kShortestLump = 32;  // shorter ones are stubs that editors leave behind
constexpr int64_t kArrayElementsMax = 1 << 20;
constexpr int32_t kLocalsMax = 1 << 16;
constexpr std::size_t kScriptsMax = 4096;
constexpr std::size_t kTextBytesMax = std::size_t{1} << 24;  // many entries may share the same bytes
constexpr int32_t kTypeFactor = 1000;

uint32_t u16(std::span<const uint8_t> bytes, std::size_t at) {
  return bytes[at] | static_cast<uint32_t>(bytes[at + 1]) << 8;
}
int32_t i16(std::span<const uint8_t> bytes, std::size_t at) { return static_cast<int16_t>(u16(bytes, at)); }
uint32_t u32(std::span<const uint8_t> bytes, std::size_t at) {
  return u16(bytes, at) | u16(bytes, at + 2) << 16;
}
int32_t i32(std::span<const uint8_t> bytes, std::size_t at) { return static_cast<int32_t>(u32(bytes, at)); }

std::string_view tag_at(std::span<const uint8_t> bytes, std::size_t at) {
  return {reinterpret_cast<const char*>(bytes.data()) + at, 4};
}

/// Texts with their escapes replaced, as ZDoom 2.8 does when it loads a text table (measured with StrLen and
/// GetChar:
/// "\\n" is one letter, an unknown escape loses its backslash).
std::string unescaped(std::string_view text) {
  if (text.find('\\') == std::string_view::npos) return std::string(text);
  const auto digit = [](char c, int base) {
    const int value = c >= '0' && c <= '9'   ? c - '0'
                      : c >= 'a' && c <= 'f' ? c - 'a' + 10
                      : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                             : base;
    return value < base ? value : -1;
  };
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\\' || i + 1 == text.size()) {
      result += text[i];
      continue;
    }
    const char c = text[++i];
    constexpr std::string_view kLetters = "abcfnrtv", kCodes = "\a\b\x1C\f\n\r\t\v";
    if (const std::size_t known = kLetters.find(c); known != std::string_view::npos) {
      result += kCodes[known];
    } else if (c == 'x' || digit(c, 8) >= 0) {
      const int base = c == 'x' ? 16 : 8;
      const std::size_t end = std::min(text.size(), i + 3);
      int value = 0;
      std::size_t place = c == 'x' ? i + 1 : i;
      for (; place < end && digit(text[place], base) >= 0; ++place)
        value = value * base + digit(text[place], base);
      i = place - 1;
      if (value == 0) break;
      result += static_cast<char>(value);
    } else if (c != '\n') {
      result += c;
    }
  }
  return result;
}

constexpr std::string_view kOldMagic("ACS\0", 4), kPlainMagic = "ACSE", kCompactMagic = "ACSe";

}  // namespace

Error BehaviorReader::error(uint64_t offset, const std::string& what) const {
  char place[32];
  std::snprintf(place, sizeof(place), ": BEHAVIOR at 0x%llx: ", static_cast<unsigned long long>(offset));
  return {ErrorCode::kBadFormat, label_ + place + what};
}

Expected<std::shared_ptr<Behavior>> BehaviorReader::read() {
  auto behavior = std::make_shared<Behavior>();
  behavior->label_ = label_;
  behavior->map_variables_.assign(kMapVariableCount, 0);
  behavior->array_slots_.assign(kMapVariableCount, -1);
  Module& module = behavior->modules_.emplace_back();
  std::iota(module.variables.begin(), module.variables.end(), uint16_t{0});
  if (bytes_.size() < kShortestLump) return behavior;

  const std::string_view magic = tag_at(bytes_, 0);
  const uint32_t start = u32(bytes_, 4);
  if (start < 8 || start > bytes_.size())
    return error(4, "the directory lies outside the lump; it is no compiled script");
  if (magic == kOldMagic) {
    const std::string_view hidden = start >= 24 ? tag_at(bytes_, start - 4) : std::string_view();
    if (hidden == kPlainMagic || hidden == kCompactMagic) {
      const uint32_t chunks = u32(bytes_, start - 8);
      bytes_ = bytes_.first(start - 8);
      module.compact = hidden == kCompactMagic;
      COMRAD_TRY(read_chunks(*behavior, chunks, false));
    } else {
      COMRAD_TRY(read_old(*behavior, start));
    }
  } else if (magic == kPlainMagic || magic == kCompactMagic) {
    module.compact = magic == kCompactMagic;
    COMRAD_TRY(read_chunks(*behavior, start, true));
  } else {
    return error(0, "begins with none of ACS0, ACSE, ACSe; compile the script again");
  }
  behavior->code_.assign(bytes_.begin(), bytes_.end());
  module.size = static_cast<uint32_t>(bytes_.size());
  return behavior;
}

Status BehaviorReader::read_old(Behavior& behavior, uint32_t directory) {
  uint64_t at = directory;
  if (at + 4 > bytes_.size()) return error(at, "the script directory is cut off");
  const uint64_t script_count = u32(bytes_, at);
  at += 4;
  if (script_count > kScriptsMax || at + script_count * 12 > bytes_.size())
    return error(at - 4, fmt::format("a directory of {} scripts does not fit the lump", script_count));
  for (uint64_t i = 0; i < script_count; ++i, at += 12) {
    Script script;
    const uint32_t number = u32(bytes_, at);
    script.number = static_cast<int32_t>(number % kTypeFactor);
    script.type = static_cast<ScriptType>(std::min<uint32_t>(number / kTypeFactor, 255));
    script.address = u32(bytes_, at + 4);
    script.arg_count = i32(bytes_, at + 8);
    if (script.address >= bytes_.size())
      return error(at + 4, fmt::format("script {} begins outside the lump", script.number));
    if (script.arg_count < 0 || script.arg_count > script.variable_count)
      return error(at + 8, fmt::format("script {} has {} arguments", script.number, script.arg_count));
    behavior.scripts_.push_back(std::move(script));
  }
  if (at + 4 > bytes_.size()) return {};
  const uint64_t string_count = u32(bytes_, at);
  at += 4;
  if (string_count > bytes_.size() / 4 || at + string_count * 4 > bytes_.size())
    return error(at - 4, fmt::format("a table of {} strings does not fit the lump", string_count));
  std::size_t total = 0;
  for (uint64_t i = 0; i < string_count; ++i, at += 4) {
    std::optional<std::string> text = text_at(bytes_, u32(bytes_, at));
    if (text && (total += text->size()) > kTextBytesMax) return error(at, "more text than 16 MiB");
    if (!text) return error(at, fmt::format("string {} runs out of the lump", i));
    behavior.strings_.push_back(unescaped(*text));
  }
  return {};
}

Status BehaviorReader::read_chunks(Behavior& behavior, uint32_t first, bool wide_scripts) {
  struct Chunk {
    std::string_view tag;
    Bytes bytes;
  };
  std::vector<Chunk> chunks;
  for (uint64_t at = first; at + 8 <= bytes_.size();) {
    const uint64_t size = u32(bytes_, at + 4);
    if (size > bytes_.size() - at - 8)
      return error(
          at, fmt::format("chunk {} of {} bytes runs out of the lump", printable(tag_at(bytes_, at)), size));
    chunks.push_back({tag_at(bytes_, at), bytes_.subspan(at + 8, size)});
    at += 8 + size;
  }
  if (first > bytes_.size()) return error(4, "the chunks lie outside the lump");

  // Tables first, then what refers to them.
  for (const auto& [tag, chunk] : chunks) {
    if (tag == "SPTR") COMRAD_TRY(read_scripts(behavior, chunk, wide_scripts));
    if (tag == "FUNC") COMRAD_TRY(read_functions(behavior, chunk));
    if (tag == "ARAY") COMRAD_TRY(read_arrays(behavior, chunk));
    if (tag == "STRL") COMRAD_TRY(read_strings(behavior, chunk, false));
    if (tag == "STRE") COMRAD_TRY(read_strings(behavior, chunk, true));
    if (tag == "MINI") COMRAD_TRY(read_variables(behavior, chunk));
    COMRAD_TRY(read_links(tag, chunk));
    if (tag == "JUMP")
      for (std::size_t at = 0; at + 4 <= chunk.size(); at += 4) behavior.jumps_.push_back(u32(chunk, at));
  }
  for (const auto& [tag, chunk] : chunks) {
    if (tag == "SFLG") COMRAD_TRY(read_script_facts(behavior, chunk, true));
    if (tag == "SVCT") COMRAD_TRY(read_script_facts(behavior, chunk, false));
    if (tag == "AINI") read_array_values(behavior, chunk);
    if (tag == "FNAM") {
      COMRAD_TRY_ASSIGN(const std::vector<std::string> names, read_names(chunk));
      for (std::size_t i = 0; i < std::min(names.size(), behavior.functions_.size()); ++i)
        behavior.functions_[i].name = names[i];
    }
    if (tag == "SNAM") {
      COMRAD_TRY_ASSIGN(const std::vector<std::string> names, read_names(chunk));
      for (Script& script : behavior.scripts_) {
        const std::size_t index =
            script.number < 0 ? static_cast<std::size_t>(-1 - script.number) : names.size();
        if (index < names.size()) script.name = lower_case(names[index]);
      }
    }
  }
  for (const auto& [tag, chunk] : chunks) {  // after the counts of variables
    if ((tag != "SARY" && tag != "FARY") || chunk.size() < 2) continue;
    if (tag == "SARY") {
      for (Script& script : behavior.scripts_)
        if (script.number == i16(chunk, 0))
          COMRAD_TRY(read_local_arrays(chunk, script.variable_count, script.arrays, script.variable_count));
    } else if (u16(chunk, 0) < behavior.functions_.size()) {
      Function& function = behavior.functions_[u16(chunk, 0)];
      int32_t end = function.arg_count + function.variable_count;
      COMRAD_TRY(read_local_arrays(chunk, end, function.arrays, end));
      function.variable_count = end - function.arg_count;
    }
  }
  return {};
}

Status BehaviorReader::read_scripts(Behavior& behavior, Bytes chunk, bool wide) {
  const std::size_t size = wide ? 12 : 8;
  if (chunk.size() / size > kScriptsMax)
    return error(offset_of(chunk), fmt::format("more than {} scripts", kScriptsMax));
  for (std::size_t at = 0; at + size <= chunk.size(); at += size) {
    Script script;
    script.number = i16(chunk, at);
    const uint32_t type = wide ? u16(chunk, at + 2) : chunk[at + 2];
    script.type = static_cast<ScriptType>(std::min<uint32_t>(type, 255));
    script.address = u32(chunk, at + 4);
    script.arg_count = wide ? i32(chunk, at + 8) : chunk[at + 3];
    if (script.address >= bytes_.size())
      return error(offset_of(chunk) + at + 4,
                   fmt::format("script {} begins outside the lump", script.number));
    if (script.arg_count < 0 || script.arg_count > 255)
      return error(offset_of(chunk) + at + 8,
                   fmt::format("script {} has {} arguments", script.number, script.arg_count));
    script.variable_count = std::max(script.variable_count, script.arg_count);
    behavior.scripts_.push_back(std::move(script));
  }
  return {};
}

Status BehaviorReader::read_script_facts(Behavior& behavior, Bytes chunk, bool flags) {
  for (std::size_t at = 0; at + 4 <= chunk.size(); at += 4) {
    for (Script& script : behavior.scripts_) {
      if (script.number != i16(chunk, at)) continue;
      const auto value = static_cast<int32_t>(u16(chunk, at + 2));
      if (flags) {
        script.is_net = (value & 1) != 0, script.is_clientside = (value & 2) != 0;
      } else {
        script.variable_count = std::max(value, script.arg_count);
      }
    }
  }
  return {};
}

Status BehaviorReader::read_functions(Behavior& behavior, Bytes chunk) {
  for (std::size_t at = 0; at + 8 <= chunk.size(); at += 8) {
    Function function;
    function.arg_count = chunk[at];
    function.variable_count = chunk[at + 1];
    function.returns_value = chunk[at + 2] != 0;
    function.address = u32(chunk, at + 4);
    function.imported = chunk[at + 3] != 0 || function.address == 0;  // 0: some library will have it
    if (!function.imported && function.address >= bytes_.size())
      return error(offset_of(chunk) + at + 4,
                   fmt::format("function {} begins outside the lump", behavior.functions_.size()));
    behavior.functions_.push_back(std::move(function));
  }
  return {};
}

Status BehaviorReader::read_strings(Behavior& behavior, Bytes chunk, bool encrypted) {
  if (chunk.size() < 12) return error(offset_of(chunk), "a string table without a head");
  const uint64_t count = u32(chunk, 4);
  if (count > (chunk.size() - 12) / 4)
    return error(offset_of(chunk) + 4, fmt::format("a table of {} strings does not fit its chunk", count));
  behavior.strings_.clear();
  std::size_t total = 0;
  for (uint64_t i = 0; i < count; ++i) {
    const uint32_t offset = u32(chunk, 12 + i * 4);
    std::optional<std::string> text;
    if (encrypted) {
      std::string plain;
      for (uint64_t k = 0; offset + k < chunk.size(); ++k) {
        const auto c = static_cast<uint8_t>(chunk[offset + k] ^ (offset * 157135u + (k >> 1)));
        if (c == 0) {
          text = std::move(plain);
          break;
        }
        plain.push_back(static_cast<char>(c));
      }
    } else {
      text = text_at(chunk, offset);
    }
    if (text && (total += text->size()) > kTextBytesMax)
      return error(offset_of(chunk) + 12 + i * 4, "more text than 16 MiB");
    if (!text) return error(offset_of(chunk) + 12 + i * 4, fmt::format("string {} runs out of its chunk", i));
    behavior.strings_.push_back(unescaped(*text));
  }
  return {};
}

Status BehaviorReader::read_arrays(Behavior& behavior, Bytes chunk) {
  int64_t total = 0;
  for (const MapArray& array : behavior.arrays_) total += static_cast<int64_t>(array.initial.size());
  for (std::size_t at = 0; at + 8 <= chunk.size(); at += 8) {
    const uint32_t index = u32(chunk, at);
    const int64_t size = u32(chunk, at + 4);
    total += size;
    if (index >= kMapVariableCount || behavior.array_slots_[index] >= 0)
      return error(offset_of(chunk) + at, fmt::format("an array named by map variable {}", index));
    if (total > kArrayElementsMax)
      return error(offset_of(chunk) + at + 4,
                   fmt::format("arrays of more than {} elements", kArrayElementsMax));
    behavior.array_slots_[index] = static_cast<int16_t>(behavior.arrays_.size());
    behavior.arrays_.push_back(
        {static_cast<int32_t>(index), std::vector<int32_t>(static_cast<std::size_t>(size), 0)});
  }
  return {};
}

Status BehaviorReader::read_variables(Behavior& behavior, Bytes chunk) {
  if (chunk.size() < 4) return {};
  const uint32_t first = u32(chunk, 0);
  const std::size_t count = chunk.size() / 4 - 1;
  if (first > kMapVariableCount || count > kMapVariableCount - first)
    return error(offset_of(chunk), fmt::format("{} map variables from {} on", count, first));
  for (std::size_t i = 0; i < count; ++i) behavior.map_variables_[first + i] = i32(chunk, 4 + i * 4);
  return {};
}

void BehaviorReader::read_array_values(Behavior& behavior, Bytes chunk) {
  if (chunk.size() < 4) return;
  const int slot = behavior.array_of(u32(chunk, 0));
  if (slot < 0) {
    spdlog::warn("{}: BEHAVIOR at 0x{:x}: values for array {}, which there is none of, are ignored", label_,
                 offset_of(chunk), u32(chunk, 0));
    return;
  }
  std::vector<int32_t>& values = behavior.arrays_[static_cast<std::size_t>(slot)].initial;
  for (std::size_t i = 0; i < std::min(values.size(), chunk.size() / 4 - 1); ++i)
    values[i] = i32(chunk, 4 + i * 4);
}

Status BehaviorReader::read_local_arrays(Bytes chunk, int32_t first, std::vector<LocalArray>& arrays,
                                         int32_t& end) {
  int64_t offset = first;
  for (std::size_t at = 2; at + 4 <= chunk.size(); at += 4) {
    const int64_t size = u32(chunk, at);
    if (offset + size > kLocalsMax)
      return error(offset_of(chunk) + at, fmt::format("local arrays of more than {} elements", kLocalsMax));
    arrays.push_back({static_cast<int32_t>(offset), static_cast<int32_t>(size)});
    offset += size;
  }
  end = static_cast<int32_t>(offset);
  return {};
}

Expected<std::vector<std::string>> BehaviorReader::read_names(Bytes chunk) {
  if (chunk.size() < 4) return std::vector<std::string>{};
  const uint64_t count = u32(chunk, 0);
  if (count > chunk.size() / 4 - 1)
    return error(offset_of(chunk), fmt::format("a table of {} names does not fit its chunk", count));
  std::vector<std::string> names;
  std::size_t total = 0;
  for (uint64_t i = 0; i < count; ++i) {
    std::optional<std::string> text = text_at(chunk, u32(chunk, 4 + i * 4));
    if (text && (total += text->size()) > kTextBytesMax)
      return error(offset_of(chunk) + 4 + i * 4, "more text than 16 MiB");
    if (!text) return error(offset_of(chunk) + 4 + i * 4, fmt::format("name {} runs out of its chunk", i));
    names.push_back(std::move(*text));
  }
  return names;
}

std::optional<std::string> BehaviorReader::text_at(Bytes bytes, uint64_t offset) {
  if (offset >= bytes.size()) return std::nullopt;
  const Bytes rest = bytes.subspan(offset);
  const auto end = std::find(rest.begin(), rest.end(), uint8_t{0});
  if (end == rest.end()) return std::nullopt;
  return std::string(rest.begin(), end);
}

Status BehaviorReader::read_links(std::string_view tag, Bytes chunk) {
  if (tag == "LOAD") {
    for (std::size_t at = 0; at < chunk.size();) {
      std::optional<std::string> name = text_at(chunk, at);
      if (!name) break;
      at += name->size() + 1;
      if (!name->empty()) links_.libraries.push_back(std::move(*name));
    }
  } else if (tag == "MEXP") {
    COMRAD_TRY_ASSIGN(links_.exported, read_names(chunk));
  } else if (tag == "MIMP" || tag == "AIMP") {
    // Number, size of an array, name; arrays begin with their count.
    const bool arrays = tag == "AIMP";
    for (std::size_t at = arrays ? 4 : 0; at + 4 < chunk.size();) {
      const std::size_t name_at = at + (arrays ? 8 : 4);
      std::optional<std::string> name = text_at(chunk, name_at);
      if (!name || u32(chunk, at) >= kMapVariableCount)
        return error(offset_of(chunk) + at, "an imported variable that does not fit its chunk");
      const uint32_t number = u32(chunk, at);
      at = name_at + name->size() + 1;
      links_.imported.push_back({number, std::move(*name)});
    }
  } else if (tag == "MSTR" || tag == "ASTR") {
    for (std::size_t at = 0; at + 4 <= chunk.size(); at += 4) links_.texts.push_back(u32(chunk, at));
  } else if (tag == "ATAG") {
    spdlog::warn(
        "{}: BEHAVIOR at 0x{:x}: ATAG, an array of texts and numbers in a library, is not read; use one or "
        "the other",
        label_, offset_of(chunk));
  }
  return {};
}

}  // namespace comrad::doom::acs
