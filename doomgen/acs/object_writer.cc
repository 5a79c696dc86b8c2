#include "doomgen/acs/object_writer.h"

#include <algorithm>
#include <cstddef>
#include <string_view>

namespace comrad::acs_compiler {
namespace {

using Bytes = std::vector<uint8_t>;

constexpr int32_t kDefaultVariables = 20;  // of a script without an entry in SVCT
constexpr int32_t kOldScriptsMax = 999;    // numbers in the old directory; a type is a multiple of 1000

void put(Bytes& out, uint32_t value, int bytes = 4) {
  for (int i = 0; i < bytes; ++i) out.push_back(static_cast<uint8_t>(value >> (8 * i)));
}
void put_text(Bytes& out, std::string_view text) {
  out.insert(out.end(), text.begin(), text.end());
  out.push_back(0);
}
void pad(Bytes& out) {
  while (out.size() % 4 != 0) out.push_back(0);
}

/// Returns where the chunk's bytes begin.
uint32_t put_chunk(Bytes& lump, std::string_view tag, const Bytes& bytes) {
  lump.insert(lump.end(), tag.begin(), tag.end());
  put(lump, static_cast<uint32_t>(bytes.size()));
  const auto start = static_cast<uint32_t>(lump.size());
  lump.insert(lump.end(), bytes.begin(), bytes.end());
  return start;
}

/// FNAM, SNAM and MEXP: a count, offsets, the names.
Bytes name_table(const std::vector<std::string>& names) {
  Bytes out;
  put(out, static_cast<uint32_t>(names.size()));
  auto place = static_cast<uint32_t>(4 + names.size() * 4);
  for (const std::string& name : names) {
    put(out, place);
    place += static_cast<uint32_t>(name.size() + 1);
  }
  for (const std::string& name : names) put_text(out, name);
  pad(out);
  return out;
}

/// Engines replace escapes in texts when they load them (measured in ZDoom 2.8: "\\n" in a text table has
/// length 1), so a backslash that is to stay needs another one.
std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : text) result.append(c == '\\' ? 2 : 1, c);
  return result;
}

/// STRL and STRE. `places` gets the offset of each text in the chunk.
Bytes text_table(const Object& object, std::vector<uint32_t>& places) {
  Bytes out;
  put(out, 0);
  put(out, static_cast<uint32_t>(object.texts.size()));
  put(out, 0);
  auto place = static_cast<uint32_t>(12 + object.texts.size() * 4);
  for (const std::string& plain : object.texts) {
    const std::string text = escaped(plain);
    places.push_back(place);
    put(out, place);
    place += static_cast<uint32_t>(text.size() + 1);
  }
  for (const std::string& plain : object.texts) {
    const std::string text = escaped(plain);
    const auto start = static_cast<uint32_t>(out.size());
    put_text(out, text);
    if (!object.encrypts_texts) continue;
    for (std::size_t i = 0; i <= text.size(); ++i)
      out[start + i] = static_cast<uint8_t>(out[start + i] ^ (start * 157135u + (i >> 1)));
  }
  pad(out);
  return out;
}

void put_local_arrays(Bytes& lump, std::string_view tag, int32_t number, const std::vector<int32_t>& arrays) {
  if (arrays.empty()) return;
  Bytes bytes;
  put(bytes, static_cast<uint32_t>(number), 2);
  for (const int32_t size : arrays) put(bytes, static_cast<uint32_t>(size));
  put_chunk(lump, tag, bytes);
}

void put_scripts(Bytes& lump, const Object& object) {
  Bytes scripts, counts, flags;
  for (const ObjectScript& script : object.scripts) {
    put(scripts, static_cast<uint32_t>(script.number), 2);
    put(scripts, static_cast<uint32_t>(script.type), 1);
    put(scripts, static_cast<uint32_t>(script.arg_count), 1);
    put(scripts, script.address);
    if (script.variable_count > kDefaultVariables) {
      put(counts, static_cast<uint32_t>(script.number), 2);
      put(counts, static_cast<uint32_t>(script.variable_count), 2);
    }
    if (script.net || script.clientside) {
      put(flags, static_cast<uint32_t>(script.number), 2);
      put(flags, (script.net ? 1u : 0u) | (script.clientside ? 2u : 0u), 2);
    }
  }
  put_chunk(lump, "SPTR", scripts);
  if (!counts.empty()) put_chunk(lump, "SVCT", counts);
  if (!flags.empty()) put_chunk(lump, "SFLG", flags);
  if (!object.script_names.empty()) put_chunk(lump, "SNAM", name_table(object.script_names));
}

void put_functions(Bytes& lump, const Object& object) {
  if (object.functions.empty()) return;
  Bytes functions;
  std::vector<std::string> names;
  for (const ObjectFunction& function : object.functions) {
    put(functions, static_cast<uint32_t>(function.arg_count), 1);
    put(functions, static_cast<uint32_t>(function.variable_count), 1);
    put(functions, function.returns_value ? 1 : 0, 1);
    put(functions, 0, 1);  // the engine writes here which library it found the function in
    put(functions, function.imported ? 0 : function.address);
    names.push_back(function.name);
  }
  put_chunk(lump, "FUNC", functions);
  put_chunk(lump, "FNAM", name_table(names));
}

void put_variables(Bytes& lump, const Object& object) {
  // Plain variables come first, so one chunk holds all their values.
  Bytes initial, arrays, imported_arrays, text_variables, text_arrays;
  std::size_t last = 0;
  std::vector<std::string> names;
  uint32_t imported_array_count = 0;
  for (std::size_t i = 0; i < object.variables.size(); ++i) {
    const ObjectVariable& variable = object.variables[i];
    const auto number = static_cast<uint32_t>(i);
    if (variable.imported) {
      if (variable.is_array) {
        ++imported_array_count;
        put(imported_arrays, number);
        put(imported_arrays, static_cast<uint32_t>(variable.size));
        put_text(imported_arrays, variable.name);
      }
      continue;
    }
    names.push_back(variable.name);
    if (variable.is_array) {
      put(arrays, number);
      put(arrays, static_cast<uint32_t>(variable.size));
      if (variable.holds_text) put(text_arrays, number);
    } else {
      if (variable.values[0] != 0) last = i + 1;
      if (variable.holds_text) put(text_variables, number);
    }
  }
  if (last != 0) {
    put(initial, 0);
    for (std::size_t i = 0; i < last; ++i) put(initial, static_cast<uint32_t>(object.variables[i].values[0]));
    put_chunk(lump, "MINI", initial);
  }
  if (!arrays.empty()) put_chunk(lump, "ARAY", arrays);
  for (std::size_t i = 0; i < object.variables.size(); ++i) {
    const ObjectVariable& variable = object.variables[i];
    if (!variable.is_array || variable.imported || variable.values.empty()) continue;
    Bytes values;
    put(values, static_cast<uint32_t>(i));
    for (const int32_t value : variable.values) put(values, static_cast<uint32_t>(value));
    put_chunk(lump, "AINI", values);
  }
  Bytes imported;
  for (std::size_t i = 0; i < object.variables.size(); ++i) {
    if (!object.variables[i].imported || object.variables[i].is_array) continue;
    put(imported, static_cast<uint32_t>(i));
    put_text(imported, object.variables[i].name);
  }
  if (!imported.empty()) put_chunk(lump, "MIMP", imported);
  if (imported_array_count != 0) {
    Bytes bytes;
    put(bytes, imported_array_count);
    bytes.insert(bytes.end(), imported_arrays.begin(), imported_arrays.end());
    put_chunk(lump, "AIMP", bytes);
  }
  if (!object.is_library) return;
  put_chunk(lump, "ALIB", {});
  if (!names.empty()) put_chunk(lump, "MEXP", name_table(names));
  if (!text_variables.empty()) put_chunk(lump, "MSTR", text_variables);
  if (!text_arrays.empty()) put_chunk(lump, "ASTR", text_arrays);
}

}  // namespace

std::vector<uint8_t> write_object(const Object& object) {
  Bytes lump(kHeadBytes, 0);
  std::copy_n("ACS", 3, lump.begin());
  lump.insert(lump.end(), object.code.begin(), object.code.end());
  pad(lump);

  const auto chunks = static_cast<uint32_t>(lump.size());
  put_scripts(lump, object);
  put_functions(lump, object);
  std::vector<uint32_t> places;
  uint32_t texts_start = 0;
  if (!object.texts.empty()) {
    const Bytes table = text_table(object, places);
    texts_start = put_chunk(lump, object.encrypts_texts ? "STRE" : "STRL", table);
  }
  put_variables(lump, object);
  for (const ObjectScript& script : object.scripts)
    put_local_arrays(lump, "SARY", script.number, script.arrays);
  for (std::size_t i = 0; i < object.functions.size(); ++i)
    put_local_arrays(lump, "FARY", static_cast<int32_t>(i), object.functions[i].arrays);
  if (!object.imports.empty()) {
    Bytes names;
    for (const std::string& name : object.imports) put_text(names, name);
    put_chunk(lump, "LOAD", names);
  }
  pad(lump);
  put(lump, chunks);
  lump.insert(lump.end(), {'A', 'C', 'S', 'E'});

  // What engines before the chunks read.
  const auto directory = static_cast<uint32_t>(lump.size());
  for (std::size_t i = 0; i < 4; ++i) lump[4 + i] = static_cast<uint8_t>(directory >> (8 * i));
  const auto is_old = [](const ObjectScript& script) {
    return script.number >= 0 && script.number <= kOldScriptsMax &&
           script.variable_count <= kDefaultVariables;
  };
  put(lump, static_cast<uint32_t>(std::count_if(object.scripts.begin(), object.scripts.end(), is_old)));
  for (const ObjectScript& script : object.scripts) {
    if (!is_old(script)) continue;
    put(lump, static_cast<uint32_t>(script.type * 1000 + script.number));
    put(lump, script.address);
    put(lump, static_cast<uint32_t>(script.arg_count));
  }
  put(lump, object.encrypts_texts ? 0 : static_cast<uint32_t>(places.size()));
  if (!object.encrypts_texts)
    for (const uint32_t place : places) put(lump, texts_start + place);
  return lump;
}

}  // namespace comrad::acs_compiler
