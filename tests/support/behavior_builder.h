// Writes BEHAVIOR lumps for tests, in every container that compilers make. A plain assembler: instructions by
// number, labels for jumps.
#pragma once

#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "doomgen/acs/pcodes.h"

namespace comrad::doom::acs::test {

using bytecode::BuiltIn;
using bytecode::PCode;

enum class Container { kOld, kPlain, kCompact, kHiddenPlain, kHiddenCompact };
constexpr Container kContainers[] = {Container::kOld, Container::kPlain, Container::kCompact,
                                     Container::kHiddenPlain, Container::kHiddenCompact};

class BehaviorBuilder {
 public:
  struct Label {
    std::size_t index;
  };

  explicit BehaviorBuilder(Container container = Container::kCompact) : container_(container), code_(8, 0) {}

  bool compact() const {
    return container_ == Container::kCompact || container_ == Container::kHiddenCompact;
  }
  bool chunked() const { return container_ != Container::kOld; }

  int32_t text(std::string_view value) {
    for (std::size_t i = 0; i < strings_.size(); ++i)
      if (strings_[i] == value) return static_cast<int32_t>(i);
    strings_.emplace_back(value);
    return static_cast<int32_t>(strings_.size() - 1);
  }
  BehaviorBuilder& encrypt(bool on = true) {
    encrypts_ = on;
    return *this;
  }

  /// A script whose code begins here.
  BehaviorBuilder& script(int number, int type = 0, int arg_count = 0, int variable_count = 20) {
    scripts_.push_back({number, type, arg_count, variable_count, address(), {}});
    return *this;
  }
  BehaviorBuilder& named_script(std::string name, int type = 0, int arg_count = 0) {
    names_.push_back(std::move(name));
    return script(-static_cast<int>(names_.size()), type, arg_count);
  }
  /// Arrays among the variables of the script or function begun last.
  BehaviorBuilder& local_arrays(std::vector<int32_t> sizes) {
    (last_is_function_ ? functions_.back().arrays : scripts_.back().arrays) = std::move(sizes);
    return *this;
  }
  /// A function whose code begins here. Returns its number.
  int32_t function(int arg_count, int variable_count, bool returns, std::string name = "f",
                   bool imported = false) {
    functions_.push_back({arg_count, variable_count, returns, imported, address(), std::move(name), {}});
    last_is_function_ = true;
    return static_cast<int32_t>(functions_.size() - 1);
  }
  BehaviorBuilder& end_function() {
    last_is_function_ = false;
    return *this;
  }
  BehaviorBuilder& map_variable(int32_t index, int32_t value) {
    variables_.emplace_back(index, value);
    return *this;
  }
  BehaviorBuilder& array(int32_t index, std::vector<int32_t> values) {
    arrays_.emplace_back(index, std::move(values));
    return *this;
  }
  BehaviorBuilder& jump_target(Label label) {
    jumps_.push_back(label);
    return *this;
  }
  BehaviorBuilder& chunk(std::string tag, std::vector<uint8_t> bytes) {
    extra_.emplace_back(std::move(tag), std::move(bytes));
    return *this;
  }

  Label label() {
    labels_.push_back(0);
    return {labels_.size() - 1};
  }
  BehaviorBuilder& bind(Label label) {
    labels_[label.index] = address();
    return *this;
  }
  uint32_t address() const { return static_cast<uint32_t>(code_.size()); }

  /// An instruction with its operands as in the table; of PushBytes all values, of CaseGotoSorted
  /// the pairs.
  BehaviorBuilder& op(PCode code, std::vector<int32_t> operands = {}) {
    number(code);
    const std::string_view kinds = bytecode::kPCodes[static_cast<std::size_t>(code)].operands;
    if (kinds == "n") {
      code_.push_back(static_cast<uint8_t>(operands.size()));
      for (const int32_t value : operands) code_.push_back(static_cast<uint8_t>(value));
      return *this;
    }
    for (std::size_t i = 0; i < kinds.size(); ++i) {
      const int32_t value = i < operands.size() ? operands[i] : 0;
      bytes(static_cast<uint32_t>(value), bytecode::operand_bytes(kinds[i], compact()));
    }
    return *this;
  }
  BehaviorBuilder& push(int32_t value) { return op(PCode::kPushNumber, {value}); }
  BehaviorBuilder& push(std::initializer_list<int32_t> values) {
    for (const int32_t value : values) push(value);
    return *this;
  }
  BehaviorBuilder& push_text(std::string_view value) { return push(text(value)); }
  BehaviorBuilder& go(PCode code, Label label) {
    number(code);
    return word(label);
  }
  BehaviorBuilder& case_goto(int32_t value, Label label) {
    number(PCode::kCaseGoto);
    bytes(static_cast<uint32_t>(value), 4);
    return word(label);
  }
  BehaviorBuilder& case_sorted(const std::vector<std::pair<int32_t, Label>>& cases) {
    number(PCode::kCaseGotoSorted);
    while (code_.size() % 4 != 0) code_.push_back(0);
    bytes(static_cast<uint32_t>(cases.size()), 4);
    for (const auto& [value, label] : cases) {
      bytes(static_cast<uint32_t>(value), 4);
      word(label);
    }
    return *this;
  }
  BehaviorBuilder& call(BuiltIn function, int arg_count) {
    return op(PCode::kCallFunc, {arg_count, static_cast<int32_t>(function)});
  }
  BehaviorBuilder& store_global(int32_t index) { return op(PCode::kAssignGlobalVar, {index}); }
  BehaviorBuilder& end() { return op(PCode::kTerminate); }

  std::vector<uint8_t> build() const {
    std::vector<uint8_t> lump = code_;
    for (const auto& [place, label] : patches_) {
      const uint32_t target = labels_[label];
      for (int i = 0; i < 4; ++i)
        lump[place + static_cast<std::size_t>(i)] = static_cast<uint8_t>(target >> (8 * i));
    }
    while (lump.size() % 4 != 0) lump.push_back(0);
    return chunked() ? with_chunks(std::move(lump)) : with_directory(std::move(lump));
  }

 private:
  struct ScriptEntry {
    int number, type, arg_count, variable_count;
    uint32_t address;
    std::vector<int32_t> arrays;
  };
  struct FunctionEntry {
    int arg_count, variable_count;
    bool returns, imported;
    uint32_t address;
    std::string name;
    std::vector<int32_t> arrays;
  };
  using Bytes = std::vector<uint8_t>;

  static void put(Bytes& out, uint32_t value, int count) {
    for (int i = 0; i < count; ++i) out.push_back(static_cast<uint8_t>(value >> (8 * i)));
  }
  static void set(Bytes& out, std::size_t place, uint32_t value) {
    for (std::size_t i = 0; i < 4; ++i) out[place + i] = static_cast<uint8_t>(value >> (8 * i));
  }
  void bytes(uint32_t value, int count) { put(code_, value, count); }
  BehaviorBuilder& word(Label label) {
    patches_.emplace_back(code_.size(), label.index);
    bytes(0, 4);
    return *this;
  }
  void number(PCode code) {
    const auto value = static_cast<uint32_t>(code);
    if (!compact()) return bytes(value, 4);
    if (value < bytecode::kFirstWidePCode) return bytes(value, 1);
    const uint32_t rest = value - bytecode::kFirstWidePCode;
    bytes(bytecode::kFirstWidePCode + (rest >> 8), 1);
    bytes(rest & 0xFF, 1);
  }

  Bytes with_directory(Bytes lump) const {
    std::vector<uint32_t> places;
    for (const std::string& text : strings_) {
      places.push_back(static_cast<uint32_t>(lump.size()));
      lump.insert(lump.end(), text.begin(), text.end());
      lump.push_back(0);
    }
    while (lump.size() % 4 != 0) lump.push_back(0);
    std::memcpy(lump.data(), "ACS\0", 4);
    set(lump, 4, static_cast<uint32_t>(lump.size()));
    put(lump, static_cast<uint32_t>(scripts_.size()), 4);
    for (const ScriptEntry& script : scripts_) {
      put(lump, static_cast<uint32_t>(script.type * 1000 + script.number), 4);
      put(lump, script.address, 4);
      put(lump, static_cast<uint32_t>(script.arg_count), 4);
    }
    put(lump, static_cast<uint32_t>(strings_.size()), 4);
    for (const uint32_t place : places) put(lump, place, 4);
    return lump;
  }

  static void add_chunk(Bytes& lump, std::string_view tag, const Bytes& bytes) {
    lump.insert(lump.end(), tag.begin(), tag.begin() + 4);
    put(lump, static_cast<uint32_t>(bytes.size()), 4);
    lump.insert(lump.end(), bytes.begin(), bytes.end());
  }
  static Bytes name_table(const std::vector<std::string>& names) {
    Bytes out;
    put(out, static_cast<uint32_t>(names.size()), 4);
    std::size_t place = 4 + names.size() * 4;
    for (const std::string& name : names) {
      put(out, static_cast<uint32_t>(place), 4);
      place += name.size() + 1;
    }
    for (const std::string& name : names) {
      out.insert(out.end(), name.begin(), name.end());
      out.push_back(0);
    }
    return out;
  }
  Bytes string_table() const {
    Bytes out;
    put(out, 0, 4), put(out, static_cast<uint32_t>(strings_.size()), 4), put(out, 0, 4);
    std::size_t place = 12 + strings_.size() * 4;
    for (const std::string& text : strings_) {
      put(out, static_cast<uint32_t>(place), 4);
      place += text.size() + 1;
    }
    for (const std::string& text : strings_) {
      const auto start = static_cast<uint32_t>(out.size());
      for (std::size_t i = 0; i <= text.size(); ++i) {
        const uint8_t c = i < text.size() ? static_cast<uint8_t>(text[i]) : 0;
        out.push_back(encrypts_ ? static_cast<uint8_t>(c ^ (start * 157135u + (i >> 1))) : c);
      }
    }
    return out;
  }

  Bytes with_chunks(Bytes lump) const {
    const bool hidden = container_ == Container::kHiddenPlain || container_ == Container::kHiddenCompact;
    const auto first = static_cast<uint32_t>(lump.size());
    Bytes scripts, counts;
    for (const ScriptEntry& script : scripts_) {
      put(scripts, static_cast<uint32_t>(script.number), 2);
      if (hidden) {
        put(scripts, static_cast<uint32_t>(script.type), 1);
        put(scripts, static_cast<uint32_t>(script.arg_count), 1);
        put(scripts, script.address, 4);
      } else {
        put(scripts, static_cast<uint32_t>(script.type), 2);
        put(scripts, script.address, 4);
        put(scripts, static_cast<uint32_t>(script.arg_count), 4);
      }
      if (script.variable_count == 20) continue;
      put(counts, static_cast<uint32_t>(script.number), 2);
      put(counts, static_cast<uint32_t>(script.variable_count), 2);
    }
    add_chunk(lump, "SPTR", scripts);
    if (!counts.empty()) add_chunk(lump, "SVCT", counts);
    if (!names_.empty()) add_chunk(lump, "SNAM", name_table(names_));
    if (!functions_.empty()) {
      Bytes functions;
      std::vector<std::string> names;
      for (const FunctionEntry& function : functions_) {
        put(functions, static_cast<uint32_t>(function.arg_count), 1);
        put(functions, static_cast<uint32_t>(function.variable_count), 1);
        put(functions, function.returns ? 1 : 0, 1);
        put(functions, function.imported ? 1 : 0, 1);
        put(functions, function.imported ? 0 : function.address, 4);
        names.push_back(function.name);
      }
      add_chunk(lump, "FUNC", functions);
      add_chunk(lump, "FNAM", name_table(names));
    }
    if (!strings_.empty()) add_chunk(lump, encrypts_ ? "STRE" : "STRL", string_table());
    for (const auto& [index, value] : variables_) {
      Bytes bytes;
      put(bytes, static_cast<uint32_t>(index), 4), put(bytes, static_cast<uint32_t>(value), 4);
      add_chunk(lump, "MINI", bytes);
    }
    for (const auto& [index, values] : arrays_) {
      Bytes sizes, initial;
      put(sizes, static_cast<uint32_t>(index), 4), put(sizes, static_cast<uint32_t>(values.size()), 4);
      put(initial, static_cast<uint32_t>(index), 4);
      for (const int32_t value : values) put(initial, static_cast<uint32_t>(value), 4);
      add_chunk(lump, "ARAY", sizes);
      add_chunk(lump, "AINI", initial);
    }
    for (const ScriptEntry& script : scripts_) add_local_arrays(lump, "SARY", script.number, script.arrays);
    for (std::size_t i = 0; i < functions_.size(); ++i)
      add_local_arrays(lump, "FARY", static_cast<int>(i), functions_[i].arrays);
    if (!jumps_.empty()) {
      Bytes bytes;
      for (const Label label : jumps_) put(bytes, labels_[label.index], 4);
      add_chunk(lump, "JUMP", bytes);
    }
    for (const auto& [tag, bytes] : extra_) add_chunk(lump, tag, bytes);

    const char* magic = compact() ? "ACSe" : "ACSE";
    if (!hidden) {
      std::memcpy(lump.data(), magic, 4);
      set(lump, 4, first);
      return lump;
    }
    put(lump, first, 4);
    lump.insert(lump.end(), magic, magic + 4);
    std::memcpy(lump.data(), "ACS\0", 4);
    set(lump, 4, static_cast<uint32_t>(lump.size()));
    put(lump, 0, 4), put(lump, 0, 4);  // no scripts, no strings for readers of the old format
    return lump;
  }
  static void add_local_arrays(Bytes& lump, std::string_view tag, int number,
                               const std::vector<int32_t>& sizes) {
    if (sizes.empty()) return;
    Bytes bytes;
    put(bytes, static_cast<uint32_t>(number), 2);
    for (const int32_t size : sizes) put(bytes, static_cast<uint32_t>(size), 4);
    add_chunk(lump, tag, bytes);
  }

  Container container_;
  Bytes code_;  // with the 8 bytes of the head
  std::vector<std::string> strings_, names_;
  std::vector<ScriptEntry> scripts_;
  std::vector<FunctionEntry> functions_;
  std::vector<std::pair<int32_t, int32_t>> variables_;
  std::vector<std::pair<int32_t, std::vector<int32_t>>> arrays_;
  std::vector<std::pair<std::string, Bytes>> extra_;
  std::vector<uint32_t> labels_;
  std::vector<Label> jumps_;
  std::vector<std::pair<std::size_t, std::size_t>> patches_;  // place, label
  bool encrypts_ = false, last_is_function_ = false;
};

}  // namespace comrad::doom::acs::test
