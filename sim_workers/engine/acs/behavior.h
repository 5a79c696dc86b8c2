// A BEHAVIOR lump, checked and decoded into tables: scripts, functions, strings, arrays, code. Reads ACS0 and
// ACSE/ACSe, compact and plain, also where the new format hides behind an ACS0 header. Immutable; worlds
// share it. Stage: loading.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "doomgen/acs/pcodes.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::doom::acs {

constexpr std::size_t kMapVariableCount = 128;

/// When a script starts by itself. Numbers as in the SPTR chunk.
enum class ScriptType : uint8_t {
  kClosed = 0,
  kOpen = 1,
  kRespawn = 2,
  kDeath = 3,
  kEnter = 4,
  kPickup = 5,
  kBlueReturn = 6,
  kRedReturn = 7,
  kWhiteReturn = 8,
  kLightning = 12,
  kUnloading = 13,
  kDisconnect = 14,
  kReturn = 15,
  kEvent = 16,
  kKill = 17,
  kReopen = 18
};

/// An array among the locals of a script or function.
struct LocalArray {
  int32_t offset = 0, size = 0;  ///< of its first element, counted from the first local
};

struct Script {
  int32_t number = 0;  ///< negative for named ones: -1 - index into names
  std::string name;    ///< of a named script, lower case
  ScriptType type = ScriptType::kClosed;
  uint32_t address = 0;                        ///< offset in the lump
  int32_t arg_count = 0, variable_count = 20;  ///< variables: arguments and arrays included
  bool is_net = false, is_clientside = false;
  std::vector<LocalArray> arrays;
};

struct Function {
  std::string name;
  uint32_t address = 0;
  int32_t arg_count = 0, variable_count = 0;  ///< variables: arrays included, arguments not
  bool returns_value = false;
  bool imported = false;  ///< of a library that is not there: calling it is an error
  std::vector<LocalArray> arrays;
};

struct MapArray {
  int32_t index = 0;  ///< map variable that names it
  std::vector<int32_t> initial;
};

/// What one lump brings: the map's first, then its libraries'. Code of a lump counts all of these from its own beginning.
struct Module {
  uint32_t begin = 0, size = 0;  ///< of its bytes in Behavior::code()
  bool compact = false;          ///< byte-sized operands (ACSe)
  uint32_t first_function = 0, first_string = 0, first_jump = 0;
  std::array<uint16_t, kMapVariableCount> variables{};  ///< number in the lump to number in the Behavior
};

/// The lump of a library by its name; nothing where the WAD has none.
using LibraryReader = std::function<std::optional<std::span<const uint8_t>>(std::string_view name)>;

class Behavior {
 public:
  /// Reads a lump and the libraries that it requests, and those that they request. `label` names it in messages. A lump
  /// too short to hold code gives an empty Behavior; a library that is not there is a warning.
  ///
  ///   loadacs   names of further libraries, from the lump LOADACS
  ///
  /// Errors: kBadFormat with the offset.
  static Expected<std::shared_ptr<const Behavior>> load(std::span<const uint8_t> lump,
                                                        const std::string& label,
                                                        const LibraryReader& libraries = nullptr,
                                                        const std::vector<std::string>& loadacs = {});

  bool compact() const { return modules_.front().compact; }
  std::span<const Module> modules() const { return modules_; }  ///< one at least
  const Module& module_at(uint32_t address) const {
    std::size_t index = modules_.size() - 1;
    while (index > 0 && address < modules_[index].begin) --index;
    return modules_[index];
  }
  std::span<const uint8_t> code() const { return code_; }
  std::span<const Script> scripts() const { return scripts_; }
  std::span<const Function> functions() const { return functions_; }
  const Script* find_script(int32_t number) const;
  const Script* find_script(std::string_view name) const;  ///< any case
  std::span<const std::string> strings() const { return strings_; }
  std::span<const MapArray> arrays() const { return arrays_; }
  int array_of(uint32_t map_variable) const {  ///< index into arrays(); -1: it is a plain variable
    return map_variable < array_slots_.size() ? array_slots_[map_variable] : -1;
  }
  std::span<const int32_t> map_variables() const {
    return map_variables_;
  }                                                           ///< initial values, 128 for each module
  std::span<const uint32_t> jumps() const { return jumps_; }  ///< targets of GotoStack
  const std::string& label() const { return label_; }

  /// True the first time that it is asked about a p-code (`index`) or function (kPCodeCount + number): for
  /// one warning per behavior, whichever world comes across it.
  bool first_time(std::size_t index) const {
    return index < warned_.size() && !warned_[index].load(std::memory_order_relaxed) &&
           !warned_[index].exchange(true, std::memory_order_relaxed);
  }

 private:
  friend class BehaviorReader;
  friend class BehaviorLinker;
  std::string label_;
  std::vector<Module> modules_;
  std::vector<uint8_t> code_;
  std::vector<Script> scripts_;
  std::vector<Function> functions_;
  std::vector<std::string> strings_;
  std::vector<MapArray> arrays_;
  std::vector<int16_t> array_slots_;
  std::vector<int32_t> map_variables_;
  std::vector<uint32_t> jumps_;
  mutable std::array<std::atomic<bool>, bytecode::kPCodeCount + 1024> warned_{};
};

}  // namespace comrad::doom::acs
