// A compiled program as tables, and its bytes: the chunks of an ACSE object behind an ACS0 header, so that
// engines of either age find what they know.
//
//   0   "ACS\0", offset of the old directory     8  code: p-codes and operands of 4 bytes
//       chunks: SPTR SVCT SFLG SNAM FUNC FNAM STRL MINI ARAY AINI SARY FARY LOAD MIMP AIMP MEXP ALIB MSTR
//       ASTR offset of the chunks, "ACSE"             old directory: scripts with numbers below 1000, texts
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace comrad::acs_compiler {

constexpr uint32_t kHeadBytes = 8;  ///< before the code

struct ObjectScript {
  int32_t number = 0;  ///< negative: -1 - index into script_names
  int32_t type = 0, arg_count = 0;
  int32_t variable_count = 0;  ///< arguments included, arrays not
  uint32_t address = 0;
  bool net = false, clientside = false;
  std::vector<int32_t> arrays;  ///< sizes of local arrays
};

struct ObjectFunction {
  std::string name;
  int32_t arg_count = 0, variable_count = 0;  ///< variables: without arguments and arrays
  bool returns_value = false, imported = false;
  uint32_t address = 0;
  std::vector<int32_t> arrays;
};

/// A map variable or map array; its place in Object::variables is its number.
struct ObjectVariable {
  std::string name;
  bool is_array = false, imported = false;
  int32_t size = 0;             ///< of arrays
  std::vector<int32_t> values;  ///< first values; of plain variables one
  bool holds_text = false;      ///< the values are numbers of texts
};

struct Object {
  std::vector<uint8_t> code;  ///< begins at byte 8 of the lump; addresses count from the lump's beginning
  std::vector<ObjectScript> scripts;
  std::vector<std::string> script_names;
  std::vector<ObjectFunction> functions;
  std::vector<ObjectVariable> variables;
  std::vector<std::string> texts;
  std::vector<std::string> imports;
  bool is_library = false, encrypts_texts = false;
};

/// The bytes of the lump.
std::vector<uint8_t> write_object(const Object& object);

}  // namespace comrad::acs_compiler
