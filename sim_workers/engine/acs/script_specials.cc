#include "sim_workers/engine/acs/script_specials.h"

#include <array>
#include <cctype>
#include <cstddef>
#include <string>

#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/specials/line_specials.h"

namespace comrad::doom::acs {
namespace {

using bytecode::BuiltIn;

/// The number at the end of a map's name: 7 of MAP07; 0 where there is none.
int32_t map_number(const std::string& name) {
  int32_t number = 0;
  std::size_t first_digit = name.size();
  while (first_digit > 0 && std::isdigit(static_cast<unsigned char>(name[first_digit - 1])) != 0)
    --first_digit;
  for (std::size_t i = first_digit; i < name.size() && number < 100'000; ++i)
    number = number * 10 + (name[i] - '0');
  return number;
}

/// There is one map at a time; scripts of others do not run.
bool is_of_this_map(const World& world, const SpecialCall& call, int32_t map) {
  if (map == 0 || map == map_number(world.level().name)) return true;
  warn_of_special(world, call.number, "requests another map, which is not supported");
  return false;
}

struct NamedSpecial {
  BuiltIn named;
  int32_t special;
};
constexpr std::array<NamedSpecial, 7> kNamedSpecials = {{
    {BuiltIn::kACS_NamedExecute, Special::kACS_Execute},
    {BuiltIn::kACS_NamedSuspend, Special::kACS_Suspend},
    {BuiltIn::kACS_NamedTerminate, Special::kACS_Terminate},
    {BuiltIn::kACS_NamedLockedExecute, Special::kACS_LockedExecute},
    {BuiltIn::kACS_NamedLockedExecuteDoor, Special::kACS_LockedExecuteDoor},
    {BuiltIn::kACS_NamedExecuteWithResult, Special::kACS_ExecuteWithResult},
    {BuiltIn::kACS_NamedExecuteAlways, Special::kACS_ExecuteAlways},
}};

int32_t start_script(World& world, const SpecialCall& call, StartOptions options) {
  options.activator_id = call.activator != nullptr ? call.activator->id : 0;
  options.back_side = call.back_side;
  if (call.line >= 0 && static_cast<std::size_t>(call.line) < world.level().linedefs.size()) {
    options.line = call.line;
    const Linedef& line = world.level().linedefs[static_cast<std::size_t>(call.line)];
    if (!line.arg0_text.empty() && line.special == call.number && line.args[0] == call.args[0])
      return start_script(world, line.arg0_text, options);
  }
  return start_script(world, call.args[0], options);
}

}  // namespace

StoredSpecial stored_special(const Caller& caller, StoredSpecial special) {
  if (special.number >= 0) return special;
  for (const NamedSpecial& entry : kNamedSpecials) {
    if (special.number != -static_cast<int32_t>(entry.named)) continue;
    special.number = entry.special;
    special.args[0] = script_number(caller.world, caller.text(special.args[0]));
    return special;
  }
  return {};
}

std::optional<int32_t> execute_script_special(World& world, const SpecialCall& call) {
  const auto& a = call.args;
  switch (call.number) {
    case Special::kACS_Execute:  // script, map, arguments
    case Special::kACS_ExecuteAlways:
      if (!is_of_this_map(world, call, a[1])) return 0;
      return start_script(world, call,
                          {.args = {a[2], a[3], a[4]}, .always = call.number == Special::kACS_ExecuteAlways});
    case Special::kACS_Suspend:  // script, map
      if (is_of_this_map(world, call, a[1])) suspend_script(world, a[0]);
      return 1;
    case Special::kACS_Terminate:
      if (is_of_this_map(world, call, a[1])) terminate_script(world, a[0]);
      return 1;
    case Special::kACS_LockedExecute:  // script, map, two arguments, lock
    case Special::kACS_LockedExecuteDoor:
      if (a[4] != 0 && (call.activator == nullptr || !has_key(world, *call.activator, a[4]))) return 0;
      if (!is_of_this_map(world, call, a[1])) return 0;
      return start_script(world, call, {.args = {a[2], a[3]}});
    case Special::kACS_ExecuteWithResult:  // script, arguments
      return start_script(world, call, {.args = {a[1], a[2], a[3], a[4]}, .always = true, .immediate = true});
    default:
      return std::nullopt;
  }
}

}  // namespace comrad::doom::acs
