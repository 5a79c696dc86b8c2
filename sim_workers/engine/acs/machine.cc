#include "sim_workers/engine/acs/machine.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "rollout_buffer/core/log.h"
#include "sim_workers/engine/acs/caller.h"
#include "sim_workers/engine/acs/hud.h"
#include "sim_workers/engine/acs/interpreter.h"
#include "sim_workers/engine/acs/map_calls.h"
#include "sim_workers/engine/acs/strings.h"

namespace comrad::doom::acs {
namespace {

Thread* find_registered(MachineState& machine, int32_t number) {
  for (Thread& thread : machine.threads)
    if (thread.registered && thread.script == number && thread.state != ThreadState::kToBeRemoved)
      return &thread;
  return nullptr;
}

/// A thread at the beginning of its script. The memory of one that ended is used again.
Thread& new_thread(MachineState& machine, const Script& script, std::size_t script_index,
                   const StartOptions& options) {
  Thread& thread = machine.threads.extend();
  std::vector<int32_t> stack = std::move(thread.stack), locals = std::move(thread.locals);
  std::vector<CallFrame> calls = std::move(thread.calls);
  std::vector<uint32_t> print_starts = std::move(thread.print_starts);
  std::string print_buffer = std::move(thread.print_buffer);
  stack.clear(), locals.clear(), calls.clear(), print_starts.clear(), print_buffer.clear();
  thread = Thread{};
  thread.stack = std::move(stack), thread.locals = std::move(locals), thread.calls = std::move(calls);
  thread.print_starts = std::move(print_starts), thread.print_buffer = std::move(print_buffer);

  thread.script = script.number;
  thread.script_index = static_cast<uint32_t>(script_index);
  thread.registered = !options.always;
  thread.address = script.address;
  thread.activator_id = options.activator_id;
  thread.line = options.line;
  thread.back_side = options.back_side;
  thread.result = 1;
  thread.locals.resize(static_cast<std::size_t>(std::max(script.variable_count, 0)), 0);
  const auto arg_count = static_cast<std::size_t>(std::clamp(script.arg_count, 0, 4));
  for (std::size_t i = 0; i < std::min(arg_count, thread.locals.size()); ++i)
    thread.locals[i] = options.args[i];
  return thread;
}

void refuse(World& world, const Script& script, const std::string& why) {
  const Behavior& behavior = *world.behavior();
  MachineState& machine = world.state().scripts;
  machine.last_error = fmt::format("{}: script {} does not start: {}", behavior.label(), script.number, why);
  if (behavior.first_time(kWarnThreads)) spdlog::warn("{}", machine.last_error);
}

int32_t start(World& world, const Script* script, const StartOptions& options) {
  if (script == nullptr) return 0;
  const Behavior& behavior = *world.behavior();
  MachineState& machine = world.state().scripts;
  const auto script_index = static_cast<std::size_t>(script - behavior.scripts().data());
  Thread* thread = nullptr;
  if (!options.always) {
    thread = find_registered(machine, script->number);
    if (thread != nullptr) {
      if (thread->state != ThreadState::kSuspended) return 0;
      thread->state = ThreadState::kRunning;
    }
  }
  if (thread == nullptr) {
    if (machine.threads.size() >= kThreadsMax) return refuse(world, *script, "too many run already"), 0;
    thread = &new_thread(machine, *script, script_index, options);
  }
  if (!options.immediate) return 1;
  if (machine.nesting >= kNestingMax) {
    thread->state = ThreadState::kToBeRemoved;
    return refuse(world, *script, "too many wait for each other's results"), 0;
  }
  const std::size_t place = machine.threads.size() - 1;
  run_thread(world, behavior, *thread);
  const int32_t result = thread->result;
  // One that is done makes room at once: a loop may request thousands of results in a tic.
  if (thread->state == ThreadState::kToBeRemoved && machine.threads.size() == place + 1 &&
      thread == &machine.threads[place])
    machine.threads.resize_down(place);
  return result;
}

/// True where the thread continues in this tic.
bool wake(World& world, Thread& thread) {
  MachineState& machine = world.state().scripts;
  switch (thread.state) {
    case ThreadState::kRunning:
      return true;
    case ThreadState::kDelayed:
      if (--thread.state_data > 0) return false;
      break;
    case ThreadState::kTagWait:
      if (tag_is_busy(world, thread.state_data)) return false;
      break;
    case ThreadState::kPolyWait:
      if (polyobject_is_busy(world, thread.state_data)) return false;
      break;
    case ThreadState::kScriptWaitPre:
      if (find_registered(machine, thread.state_data) != nullptr) thread.state = ThreadState::kScriptWait;
      return false;
    case ThreadState::kScriptWait:
      if (find_registered(machine, thread.state_data) != nullptr) return false;
      break;
    default:
      return false;
  }
  thread.state = ThreadState::kRunning;
  return true;
}

}  // namespace

int32_t start_script(World& world, int32_t number, const StartOptions& options) {
  return world.behavior() != nullptr ? start(world, world.behavior()->find_script(number), options) : 0;
}

int32_t start_script(World& world, std::string_view name, const StartOptions& options) {
  return world.behavior() != nullptr ? start(world, world.behavior()->find_script(name), options) : 0;
}

int32_t script_number(const World& world, std::string_view name) {
  const Script* script = world.behavior() != nullptr ? world.behavior()->find_script(name) : nullptr;
  return script != nullptr ? script->number : kNoScript;
}

void suspend_script(World& world, int32_t number) {
  if (Thread* thread = find_registered(world.state().scripts, number))
    thread->state = ThreadState::kSuspended;
}

void terminate_script(World& world, int32_t number) {
  if (Thread* thread = find_registered(world.state().scripts, number))
    thread->state = ThreadState::kToBeRemoved;
}

void start_scripts_of_type(World& world, ScriptType type, uint32_t activator_id, int32_t arg) {
  if (world.behavior() == nullptr) return;
  std::vector<const Script*> scripts;
  for (const Script& script : world.behavior()->scripts())
    if (script.type == type) scripts.push_back(&script);
  // Measured in ViZDoom 1.3.2: the map's before those of its libraries; of each, named ones in the order of the lump,
  // whose numbers are -1, -2, ..., then the others by rising number.
  const auto place = [&](const Script* script) {
    return std::tuple(world.behavior()->module_at(script->address).begin, script->number >= 0,
                      std::abs(script->number));
  };
  std::stable_sort(scripts.begin(), scripts.end(),
                   [&](const Script* a, const Script* b) { return place(a) < place(b); });
  for (const Script* script : scripts)
    start(world, script, {.args = {arg}, .activator_id = activator_id, .always = type != ScriptType::kOpen});
}

void reset_machine(World& world) {
  MachineState& machine = world.state().scripts;
  machine = MachineState{};
  if (world.behavior() == nullptr) return;
  const Behavior& behavior = *world.behavior();
  machine.map_variables.assign(behavior.map_variables().begin(), behavior.map_variables().end());
  for (const MapArray& array : behavior.arrays()) machine.map_arrays.push_back(array.initial);
}

void tic_machine(World& world) {
  MachineState& machine = world.state().scripts;
  if (world.behavior() != nullptr && !machine.threads.empty()) {
    const std::size_t count = machine.threads.size();  // what these start waits for the next tic
    // The newest runs first, as in ZDoom (measured).
    for (std::size_t i = count; i-- > 0;)
      if (wake(world, machine.threads[i])) run_thread(world, *world.behavior(), machine.threads[i]);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < machine.threads.size(); ++i) {
      if (machine.threads[i].state == ThreadState::kToBeRemoved) continue;
      if (kept != i) std::swap(machine.threads[kept], machine.threads[i]);
      ++kept;
    }
    machine.threads.resize_down(kept);
    purge_strings(world);
  }
  if (!machine.plane_watchers.empty()) tic_plane_watchers(world);
  if (!machine.hud_messages.empty()) tic_hud_messages(world);
  if (world.behavior() == nullptr) return;
  machine.old_buttons.resize(static_cast<std::size_t>(world.player_count()));
  for (int player = 0; player < world.player_count(); ++player) {
    uint32_t& bits = machine.old_buttons[static_cast<std::size_t>(player)];
    bits = button_bits(world, world.player(player).buttons, bits);
  }
}

}  // namespace comrad::doom::acs
