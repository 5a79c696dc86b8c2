#include "sim_workers/engine/acs/interpreter.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <optional>
#include <string>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/actor_calls.h"
#include "sim_workers/engine/acs/actor_properties.h"
#include "sim_workers/engine/acs/hud.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/acs/map_calls.h"
#include "sim_workers/engine/acs/script_calls.h"
#include "sim_workers/engine/acs/script_specials.h"
#include "sim_workers/engine/acs/strings.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/player_thinker.h"
#include "sim_workers/engine/play/weapons.h"
#include "sim_workers/engine/specials/line_specials.h"

namespace comrad::doom::acs {
namespace {

using bytecode::kPCodeCount;
using bytecode::Operation;
using bytecode::PCode;
using bytecode::VariableCode;
using Scope = bytecode::VariableScope;

constexpr int32_t kExpensive = 50;  // instructions that a call counts for which looks at the whole world
constexpr std::size_t kTextsMax = 64;

// ---------------------------------------------------------------- tables

/// What is asked of every p-code before it is run.
struct Step {
  uint8_t pops = 0, pushes = 0;
  std::array<uint8_t, 2> operand_bytes{};  ///< in plain and in compact code
  VariableCode variable{};
};

constexpr std::array<Step, kPCodeCount> make_steps() {
  std::array<Step, kPCodeCount> steps{};
  for (std::size_t code = 0; code < kPCodeCount; ++code) {
    const bytecode::PCodeInfo& info = bytecode::kPCodes[code];
    Step& step = steps[code];
    step.pops = info.pops, step.pushes = info.pushes;
    step.variable = bytecode::kVariableCodes[code];
    for (const char operand : info.operands)
      for (const bool compact : {false, true})
        step.operand_bytes[compact] =
            static_cast<uint8_t>(step.operand_bytes[compact] + bytecode::operand_bytes(operand, compact));
  }
  return steps;
}
constexpr std::array<Step, kPCodeCount> kSteps = make_steps();

// ---------------------------------------------------------------- arithmetic that wraps

constexpr int32_t wrap(int64_t value) { return static_cast<int32_t>(static_cast<uint64_t>(value)); }

int32_t apply(Operation operation, int32_t a, int32_t b) {
  switch (operation) {
    case Operation::kAdd:
    case Operation::kInc:
      return wrap(int64_t{a} + b);
    case Operation::kSub:
    case Operation::kDec:
      return wrap(int64_t{a} - b);
    case Operation::kMul:
      return wrap(int64_t{a} * b);
    case Operation::kDiv:
      return wrap(int64_t{a} / b);
    case Operation::kMod:
      return wrap(int64_t{a} % b);
    case Operation::kAnd:
      return a & b;
    case Operation::kEor:
      return a ^ b;
    case Operation::kOr:
      return a | b;
    case Operation::kLeftShift:
      return static_cast<int32_t>(static_cast<uint32_t>(a) << (b & 31));
    case Operation::kRightShift:
      return a >> (b & 31);
    default:
      return b;
  }
}

// ---------------------------------------------------------------- the interpreter

class Interpreter {
 public:
  Interpreter(World& world, const Behavior& behavior, Thread& thread)
      : world_(world),
        state_(world.state()),
        machine_(world.state().scripts),
        behavior_(behavior),
        thread_(thread),
        caller_{world, behavior, thread},
        code_(behavior.code()),
        module_(&behavior.module_at(thread.address)),
        compact_(module_->compact),
        pc_(thread.address) {
    sp_ = std::min(thread.stack.size(), kStackMax);
    std::copy_n(thread.stack.begin(), sp_, stack_.begin());
  }

  void run() {
    while (thread_.state == ThreadState::kRunning && !failed_) {
      at_ = pc_;
      if (--machine_.instructions_left < 0) {
        stop_runaway();
        break;
      }
      const uint32_t number = fetch();
      if (failed_) break;
      const Step& step = kSteps[number];
      if (sp_ < step.pops || sp_ - step.pops + step.pushes > kStackMax ||
          code_.size() - pc_ < step.operand_bytes[compact_]) {
        fail_step(number);
        break;
      }
      if (step.variable.operation != Operation::kNone) {
        run_variable(step.variable);
      } else {
        execute(static_cast<PCode>(number));
      }
    }
    if (failed_) thread_.state = ThreadState::kToBeRemoved;
    thread_.address = pc_;
    thread_.stack.assign(stack_.begin(), stack_.begin() + static_cast<std::ptrdiff_t>(sp_));
  }

 private:
  // ---- code

  uint32_t fetch() {
    const std::size_t left = code_.size() - pc_;
    if (compact_ ? left < 1 : left < 4) return fail_fetch({});
    uint32_t number = 0;
    if (compact_) {
      number = code_[pc_++];
      if (number >= bytecode::kFirstWidePCode) {
        if (left < 2) return fail_fetch({});
        number = bytecode::kFirstWidePCode + ((number - bytecode::kFirstWidePCode) << 8) + code_[pc_++];
      }
    } else {
      number = static_cast<uint32_t>(word());
    }
    return number < kPCodeCount ? number : fail_fetch(number);
  }

  // Operands; their bytes have been counted before.
  int32_t word() {
    const uint8_t* bytes = code_.data() + pc_;  // one load; a loop over pc_ is four
    pc_ += 4;
    return static_cast<int32_t>(bytes[0] | bytes[1] << 8 | bytes[2] << 16 | uint32_t{bytes[3]} << 24);
  }
  int32_t raw_byte() { return code_[pc_++]; }
  int32_t small() { return compact_ ? raw_byte() : word(); }
  int32_t half() {
    if (!compact_) return word();
    const int32_t low = raw_byte();
    return low | raw_byte() << 8;
  }

  void jump(int32_t target) {
    if (target < 0 || static_cast<uint32_t>(target) >= module_->size) {
      fail("jumps to " + hex(static_cast<uint32_t>(target)) + ", outside the lump");
      return;
    }
    pc_ = module_->begin + static_cast<uint32_t>(target);
  }
  /// To an address of code(), maybe of another lump.
  void enter(uint32_t address) {
    module_ = &behavior_.module_at(address);
    compact_ = module_->compact;
    pc_ = address;
  }

  static std::string hex(uint32_t value) {
    char text[16];
    std::snprintf(text, sizeof(text), "0x%x", value);
    return text;
  }

  // What ends a script is cold: its texts must not stand between the steps of a running one.
  [[gnu::cold]] void fail(const std::string& what) {
    if (failed_) return;
    failed_ = true;
    machine_.last_error = caller_.script_label() + " at " + hex(at_) + ": " + what;
    if (behavior_.first_time(kWarnError)) spdlog::warn("{}; the script is stopped", machine_.last_error);
  }

  [[gnu::cold]] uint32_t fail_fetch(std::optional<uint32_t> unknown) {
    fail(unknown ? fmt::format("there is no p-code {}", *unknown) : "runs out of the lump");
    return 0;
  }
  [[gnu::cold]] void stop_runaway() {
    ++machine_.runaway_count;
    fail(fmt::format("has run {} instructions in one tic without a Delay", machine_.instructions_per_tic));
  }
  /// States which of a step's demands is not met.
  [[gnu::cold]] void fail_step(uint32_t number) {
    const Step& step = kSteps[number];
    const std::string name(bytecode::kPCodes[number].name);
    if (sp_ < step.pops) return fail("the stack is empty for " + name);
    if (sp_ - step.pops + step.pushes > kStackMax) return fail("the stack is full");
    fail("the operands of " + name + " run out of the lump");
  }
  [[gnu::cold]] int32_t* fail_variable(Scope scope, uint32_t index) {
    static constexpr std::array<const char*, 8> kScopes = {
        "script variable", "map variable", "world variable", "global variable",
        "local array",     "map array",    "world array",    "global array"};
    fail(fmt::format("there is no {} {}", kScopes[static_cast<std::size_t>(scope)], index));
    return &scratch_;
  }

  // ---- stack; depth has been checked by the table, where the number of values is fixed

  int32_t pop() { return stack_[--sp_]; }
  void push(int32_t value) { stack_[sp_++] = value; }
  int32_t& top(std::size_t depth = 1) { return stack_[sp_ - depth]; }
  void drop(std::size_t count) { sp_ -= count; }
  /// The last `count` values, oldest first; they leave the stack.
  template <std::size_t kCount>
  std::array<int32_t, kCount> take() {
    std::array<int32_t, kCount> values;
    sp_ -= kCount;
    std::copy_n(stack_.begin() + static_cast<std::ptrdiff_t>(sp_), kCount, values.begin());
    return values;
  }
  bool has(std::size_t count) {
    if (sp_ < count) fail("the stack is empty");
    return sp_ >= count;
  }
  bool has_room(std::size_t count) {
    if (sp_ + count > kStackMax) fail("the stack is full");
    return sp_ + count <= kStackMax;
  }

  // ---- variables

  /// The variable, or a scratch place: `failed_` marks a bad number, an element outside its array reads as 0.
  int32_t* variable(Scope scope, int32_t number, int32_t element, bool writes) {
    scratch_ = 0;
    const auto index = static_cast<uint32_t>(number);
    switch (scope) {
      case Scope::kScript:
        if (index < thread_.locals.size() - thread_.local_base)
          return &thread_.locals[thread_.local_base + index];
        break;
      case Scope::kMap:
        if (index < kMapVariableCount && module_->variables[index] < machine_.map_variables.size())
          return &machine_.map_variables[module_->variables[index]];
        break;
      case Scope::kWorld:
        if (index < machine_.world_variables.size()) return &machine_.world_variables[index];
        break;
      case Scope::kGlobal:
        if (index < state_.globals.size()) return &state_.globals[index];
        break;
      case Scope::kScriptArray: {
        const std::vector<LocalArray>& arrays = local_arrays();
        if (index >= arrays.size()) break;
        const LocalArray& array = arrays[index];
        if (element < 0 || element >= array.size) return outside(element);
        const std::size_t place = thread_.local_base + static_cast<std::size_t>(array.offset + element);
        if (place >= thread_.locals.size()) return outside(element);
        return &thread_.locals[place];
      }
      case Scope::kMapArray: {
        const int slot = index < kMapVariableCount ? behavior_.array_of(module_->variables[index]) : -1;
        if (slot < 0 || static_cast<std::size_t>(slot) >= machine_.map_arrays.size()) break;
        return element_of(machine_.map_arrays[static_cast<std::size_t>(slot)], element, false);
      }
      case Scope::kWorldArray:
        if (index < machine_.world_variables.size())
          return grown(machine_.world_arrays, index, element, writes);
        break;
      case Scope::kGlobalArray:
        if (index < state_.globals.size()) return grown(machine_.global_arrays, index, element, writes);
        break;
    }
    return fail_variable(scope, index);
  }

  [[gnu::cold]] int32_t* outside(int32_t element) {
    caller_.warn(kWarnElement, fmt::format("element {} lies outside its array and reads as 0", element));
    return &scratch_;
  }
  int32_t* element_of(std::vector<int32_t>& array, int32_t element, bool silent) {
    if (element >= 0 && static_cast<std::size_t>(element) < array.size())
      return &array[static_cast<std::size_t>(element)];
    return silent ? &scratch_ : outside(element);
  }
  /// World and global arrays have no size: they grow to what is written.
  int32_t* grown(std::vector<std::vector<int32_t>>& arrays, uint32_t index, int32_t element, bool writes) {
    if (index >= arrays.size()) {
      if (!writes) return &scratch_;
      arrays.resize(index + 1);
    }
    std::vector<int32_t>& array = arrays[index];
    if (writes && element >= 0 && static_cast<std::size_t>(element) >= array.size()) {
      if (static_cast<std::size_t>(element) >= kArrayElementsMax) {
        fail(fmt::format("element {} of a world or global array; {} is the end", element, kArrayElementsMax));
        return &scratch_;
      }
      array.resize(static_cast<std::size_t>(element) + 1, 0);
    }
    return element_of(array, element, !writes && element >= 0);
  }

  const std::vector<LocalArray>& local_arrays() const {
    if (thread_.function >= 0)
      return behavior_.functions()[static_cast<std::size_t>(thread_.function)].arrays;
    return behavior_.scripts()[thread_.script_index].arrays;
  }

  void run_variable(const VariableCode& code) {
    const int32_t number = small();
    const Operation operation = code.operation;
    const bool one = operation == Operation::kInc || operation == Operation::kDec;
    const int32_t operand = one ? 1 : operation == Operation::kPush ? 0 : pop();
    const int32_t element = is_array(code.scope) ? pop() : 0;
    int32_t* cell = variable(code.scope, number, element, operation != Operation::kPush);
    if (failed_) return;
    if (operation == Operation::kPush) return push(*cell);
    if ((operation == Operation::kDiv || operation == Operation::kMod) && operand == 0)
      return fail("divides by zero");
    *cell = apply(operation, *cell, operand);
  }

  void binary(Operation operation) {
    const int32_t b = pop();
    if ((operation == Operation::kDiv || operation == Operation::kMod) && b == 0)
      return fail("divides by zero");
    top() = apply(operation, top(), b);
  }

  // ---- functions of the lump

  /// Of the Behavior, for the number in the code of a lump.
  int32_t function_number(int32_t number) const { return wrap(int64_t{number} + module_->first_function); }

  void call(int32_t index, bool discards_result) {
    const auto functions = behavior_.functions();
    if (index < 0 || static_cast<std::size_t>(index) >= functions.size())
      return fail(fmt::format("there is no function {}", index));
    const Function& function = functions[static_cast<std::size_t>(index)];
    if (function.imported)
      return fail("calls \"" + printable(function.name) + "\" of a library that is not loaded");
    const auto arg_count = static_cast<std::size_t>(function.arg_count);
    const auto size = arg_count + static_cast<std::size_t>(function.variable_count);
    if (!has(arg_count)) return;
    if (thread_.calls.size() >= kCallsMax || thread_.locals.size() + size > kLocalsMax)
      return fail("calls functions too deep inside each other");
    const std::size_t base = thread_.locals.size();
    thread_.calls.push_back({.return_address = pc_,
                             .local_base = thread_.local_base,
                             .local_count = static_cast<uint32_t>(base - thread_.local_base),
                             .discards_result = discards_result,
                             .function = thread_.function});
    thread_.locals.resize(base + size, 0);
    drop(arg_count);
    std::copy_n(stack_.begin() + static_cast<std::ptrdiff_t>(sp_), arg_count,
                thread_.locals.begin() + static_cast<std::ptrdiff_t>(base));
    thread_.local_base = static_cast<uint32_t>(base);
    thread_.function = index;
    enter(function.address);
  }

  void return_from_function(int32_t value) {
    if (thread_.calls.empty()) return fail("returns from no function");
    const CallFrame frame = thread_.calls.back();
    thread_.calls.pop_back();
    thread_.locals.resize(thread_.local_base);
    thread_.local_base = frame.local_base;
    thread_.function = frame.function;
    enter(frame.return_address);
    if (!frame.discards_result && has_room(1)) push(value);
  }

  // ---- texts

  void begin_text() {
    if (thread_.print_starts.size() >= kTextsMax) return fail("builds too many texts at once");
    thread_.print_starts.push_back(static_cast<uint32_t>(thread_.print_buffer.size()));
  }
  std::string take_text() {
    if (thread_.print_starts.empty()) return fail("ends a text that it has not begun"), std::string();
    const uint32_t start = thread_.print_starts.back();
    thread_.print_starts.pop_back();
    std::string text = thread_.print_buffer.substr(start);
    charge_for(text.size());
    thread_.print_buffer.resize(start);
    return text;
  }
  template <typename Append>
  void print(Append append) {
    const std::size_t before = thread_.print_buffer.size();
    append(thread_.print_buffer);
    charge_for(thread_.print_buffer.size() - std::min(before, thread_.print_buffer.size()));
    if (thread_.print_buffer.size() > kTextMax) {
      thread_.print_buffer.clear();
      fail(fmt::format("builds a text of more than {} bytes", kTextMax));
    }
  }
  void print_text(std::string_view text) {
    print([&](std::string& out) { out += text; });
  }
  /// Letters from an array of characters, up to a zero.
  void print_array(Scope scope, bool ranged) {
    const int32_t count = ranged ? pop() : INT32_MAX;
    const int32_t offset = ranged ? pop() : 0;
    const int32_t array = pop();
    const int64_t first = int64_t{pop()} + offset;
    if (count < 1 || offset < 0 || first < 0 || first > INT32_MAX) return;
    for (int64_t i = 0; i < count && first + i <= INT32_MAX && !failed_; ++i) {
      const int32_t letter = *variable(scope, array, static_cast<int32_t>(first + i), false);
      if (letter == 0 || failed_) return;
      print([&](std::string& out) { out.push_back(static_cast<char>(letter)); });
    }
  }
  void print_name(int32_t who) {
    const Actor* actor = caller_.activator();
    if (who > 0 && who <= world_.player_count()) {
      print_text(fmt::format("Player {}", who));
    } else if (who == -1 || who == -2) {
      print_text(world_.level().name);
    } else if (who < 0) {
      return;
    } else if (who == 0 && actor != nullptr && actor->player_index >= 0) {
      print_text(fmt::format("Player {}", actor->player_index + 1));
    } else if (who == 0 && actor != nullptr) {
      print_text(world_.type_of(*actor).name);
    }
  }
  /// StrCpy: a string into an array. True where all of it had room.
  void copy_to_array(Scope scope) {
    const auto [place, array, offset, capacity, text_index, text_offset] = take<6>();
    if (offset < 0 || text_offset < 0) return push(0);
    const std::string_view text = caller_.text(text_index);
    if (static_cast<std::size_t>(text_offset) >= text.size()) return push(1);
    const std::string rest(text.substr(static_cast<std::size_t>(text_offset)));
    const int64_t first = int64_t{place} + offset;
    std::size_t done = 0;
    for (int64_t i = 0; i < capacity && !failed_; ++i) {
      if (first + i < 0 || first + i > INT32_MAX) break;
      const bool end = done == rest.size();
      int32_t* cell = variable(scope, array, static_cast<int32_t>(first + i), true);
      if (failed_) return;
      *cell = end ? 0 : static_cast<unsigned char>(rest[done]);
      if (end) return charge_for(done), push(1);
      ++done;
    }
    charge_for(done);
    push(done == rest.size() ? 1 : 0);
  }
  void end_hud_message(bool bold) {
    const std::size_t options =
        thread_.option_start >= 0 ? std::min(static_cast<std::size_t>(thread_.option_start), sp_) : sp_;
    thread_.option_start = -1;
    std::string text = take_text();
    if (failed_) return;
    if (options < 6) return fail("the stack is empty for HudMessage");
    const std::span<const int32_t> values(stack_.data(), sp_);
    show_hud_message(caller_, std::move(text), values.subspan(options - 6, 6), values.subspan(options), bold);
    sp_ = options - 6;
  }

  // ---- smaller helpers

  int32_t random(int32_t low, int32_t high) {
    if (high < low) std::swap(low, high);
    const uint32_t span = static_cast<uint32_t>(high) - static_cast<uint32_t>(low) + 1u;
    const uint32_t drawn =
        span == 0 ? static_cast<uint32_t>(world_.rng().next() >> 32) : world_.rng().below(span);
    return static_cast<int32_t>(static_cast<uint32_t>(low) + drawn);
  }
  void wait(ThreadState how, int32_t data) {
    thread_.state = how;
    thread_.state_data = data;
  }
  void delay(int32_t tics) {
    if (tics > 0) wait(ThreadState::kDelayed, tics);
  }
  int32_t special(int32_t number, const std::array<int32_t, 5>& args) {
    charge();
    return world_.events().run_special(world_, {.number = number,
                                                .args = args,
                                                .activator = caller_.activator(),
                                                .line = thread_.line,
                                                .back_side = thread_.back_side});
  }
  void charge() { machine_.instructions_left -= kExpensive; }
  /// For work that grows with a text or with how many there are: a script in a loop of it must end as well.
  void charge_for(std::size_t bytes) { machine_.instructions_left -= static_cast<int64_t>(bytes / 16); }
  bool is_player(int32_t player) const { return player >= 0 && player < world_.player_count(); }
  void unsupported(PCode code) {
    const auto number = static_cast<std::size_t>(code);
    caller_.unsupported(number, bytecode::kPCodes[number].name);
  }
  static Angle byte_angle(int32_t angle) { return static_cast<uint32_t>(angle) << 24; }

  void execute(PCode code);
  void execute_call(PCode code);

  World& world_;
  WorldState& state_;
  MachineState& machine_;
  const Behavior& behavior_;
  Thread& thread_;
  Caller caller_;
  std::span<const uint8_t> code_;
  const Module* module_;  // the lump whose code runs
  bool compact_ = false;
  uint32_t pc_ = 0;  // next byte
  uint32_t at_ = 0;  // of the instruction under way
  bool failed_ = false;
  int32_t scratch_ = 0;
  std::size_t sp_ = 0;
  std::array<int32_t, kStackMax> stack_;
};

// The language itself: values, jumps, calls, waiting, texts. What reaches into the world is
// in execute_call().
void Interpreter::execute(PCode code) {
  switch (code) {
    case PCode::kNop:
      return;
    case PCode::kTerminate:
      return wait(ThreadState::kToBeRemoved, 0);
    case PCode::kSuspend:
      return wait(ThreadState::kSuspended, 0);
    case PCode::kRestart:
      thread_.calls.clear();
      thread_.local_base = 0;
      thread_.function = -1;
      thread_.locals.resize(
          static_cast<std::size_t>(std::max(behavior_.scripts()[thread_.script_index].variable_count, 0)));
      return enter(behavior_.scripts()[thread_.script_index].address);

    // ---- constants
    case PCode::kPushNumber:
      return push(word());
    case PCode::kPushByte:
      return push(raw_byte());
    case PCode::kPush2Bytes:
    case PCode::kPush3Bytes:
    case PCode::kPush4Bytes:
    case PCode::kPush5Bytes: {
      const int count = static_cast<int>(code) - static_cast<int>(PCode::kPush2Bytes) + 2;
      for (int i = 0; i < count; ++i) push(raw_byte());
      return;
    }
    case PCode::kPushBytes: {
      const auto count = static_cast<std::size_t>(raw_byte());
      if (code_.size() - pc_ < count) return fail("the operands of PushBytes run out of the lump");
      if (!has_room(count)) return;
      for (std::size_t i = 0; i < count; ++i) push(raw_byte());
      return;
    }
    case PCode::kPushFunction:
      return push(function_number(small()));
    case PCode::kTagString:
      top() = wrap(int64_t{top()} + module_->first_string);
      return;
    case PCode::kDrop:
      return drop(1);
    case PCode::kDuplicate:
      return push(top());
    case PCode::kSwap:
      return std::swap(top(1), top(2));

    // ---- arithmetic
    case PCode::kAdd:
      return binary(Operation::kAdd);
    case PCode::kSubtract:
      return binary(Operation::kSub);
    case PCode::kMultiply:
      return binary(Operation::kMul);
    case PCode::kDivide:
      return binary(Operation::kDiv);
    case PCode::kModulus:
      return binary(Operation::kMod);
    case PCode::kAndBitwise:
      return binary(Operation::kAnd);
    case PCode::kOrBitwise:
      return binary(Operation::kOr);
    case PCode::kEorBitwise:
      return binary(Operation::kEor);
    case PCode::kLeftShift:
      return binary(Operation::kLeftShift);
    case PCode::kRightShift:
      return binary(Operation::kRightShift);
    case PCode::kEqual: {
      const int32_t b = pop();
      top() = top() == b;
      return;
    }
    case PCode::kNotEqual: {
      const int32_t b = pop();
      top() = top() != b;
      return;
    }
    case PCode::kLess: {
      const int32_t b = pop();
      top() = top() < b;
      return;
    }
    case PCode::kGreater: {
      const int32_t b = pop();
      top() = top() > b;
      return;
    }
    case PCode::kLessOrEqual: {
      const int32_t b = pop();
      top() = top() <= b;
      return;
    }
    case PCode::kGreaterOrEqual: {
      const int32_t b = pop();
      top() = top() >= b;
      return;
    }
    case PCode::kAndLogical: {
      const int32_t b = pop();
      top() = top() != 0 && b != 0;
      return;
    }
    case PCode::kOrLogical: {
      const int32_t b = pop();
      top() = top() != 0 || b != 0;
      return;
    }
    case PCode::kNegateLogical:
      top() = top() == 0;
      return;
    case PCode::kNegateBinary:
      top() = ~top();
      return;
    case PCode::kUnaryMinus:
      top() = wrap(-int64_t{top()});
      return;
    case PCode::kFixedMul: {
      const int32_t b = pop();
      top() = fixed_mul(top(), b);
      return;
    }
    case PCode::kFixedDiv: {
      const int32_t b = pop();
      top() = fixed_div(top(), b);
      return;
    }
    case PCode::kSin:
      top() = fine_sine(to_angle(top()));
      return;
    case PCode::kCos:
      top() = fine_cosine(to_angle(top()));
      return;
    case PCode::kVectorAngle: {
      const int32_t y = pop();
      top() = from_angle(vector_angle(top(), y));
      return;
    }
    case PCode::kRandom: {
      const int32_t high = pop();
      top() = random(top(), high);
      return;
    }
    case PCode::kRandomDirect: {
      const int32_t low = word();
      return push(random(low, word()));
    }
    case PCode::kRandomDirectB: {
      const int32_t low = raw_byte();
      return push(random(low, raw_byte()));
    }

    // ---- jumps
    case PCode::kGoto:
      return jump(word());
    case PCode::kIfGoto: {
      const int32_t target = word();
      if (pop() != 0) jump(target);
      return;
    }
    case PCode::kIfNotGoto: {
      const int32_t target = word();
      if (pop() == 0) jump(target);
      return;
    }
    case PCode::kCaseGoto: {
      const int32_t value = word(), target = word();
      if (top() != value) return;
      drop(1);
      return jump(target);
    }
    case PCode::kCaseGotoSorted: {
      const std::size_t aligned = (static_cast<std::size_t>(pc_) + 3) & ~std::size_t{3};
      if (aligned > code_.size() || code_.size() - aligned < 4)
        return fail("the table of CaseGotoSorted runs out of the lump");
      pc_ = static_cast<uint32_t>(aligned);
      const auto count = static_cast<uint32_t>(word());
      if ((code_.size() - pc_) / 8 < count) return fail("the table of CaseGotoSorted runs out of the lump");
      const uint32_t table = pc_, end = pc_ + count * 8;
      uint32_t low = 0, high = count;
      while (low < high) {
        const uint32_t middle = (low + high) / 2;
        pc_ = table + middle * 8;
        const int32_t value = word(), target = word();
        if (value == top()) {
          drop(1);
          return jump(target);
        }
        if (value < top()) {
          low = middle + 1;
        } else {
          high = middle;
        }
      }
      pc_ = end;
      return;
    }
    case PCode::kGotoStack: {
      const auto index = static_cast<uint32_t>(pop());
      const auto jumps = behavior_.jumps().subspan(module_->first_jump);
      if (index >= jumps.size()) return fail(fmt::format("there is no jump target {}", index));
      return jump(static_cast<int32_t>(jumps[index]));
    }

    // ---- functions
    case PCode::kCall:
      return call(function_number(small()), false);
    case PCode::kCallDiscard:
      return call(function_number(small()), true);
    case PCode::kCallStack:
      return call(pop() & 0xFFFF, false);
    case PCode::kReturnVoid:
      return return_from_function(0);
    case PCode::kReturnValue:
      return return_from_function(pop());
    case PCode::kSetResultValue:
      thread_.result = pop();
      return;
    case PCode::kCallFunc: {
      const auto count = static_cast<std::size_t>(small());
      const int32_t number = half();
      if (!has(count) || (count == 0 && !has_room(1))) return;
      charge();
      drop(count);
      const CallResult result =
          call_function(caller_, number, std::span<const int32_t>(stack_.data() + sp_, count));
      if (result.error != nullptr) return fail(result.error);
      return push(result.value);
    }

    // ---- waiting
    case PCode::kDelay:
      return delay(pop());
    case PCode::kDelayDirect:
      return delay(word());
    case PCode::kDelayDirectB:
      return delay(raw_byte());
    case PCode::kTagWait:
      return wait(ThreadState::kTagWait, pop());
    case PCode::kTagWaitDirect:
      return wait(ThreadState::kTagWait, word());
    case PCode::kPolyWait:
      return wait(ThreadState::kPolyWait, pop());
    case PCode::kPolyWaitDirect:
      return wait(ThreadState::kPolyWait, word());
    case PCode::kScriptWait:
      return wait(ThreadState::kScriptWaitPre, pop());
    case PCode::kScriptWaitDirect:
      return wait(ThreadState::kScriptWaitPre, word());
    case PCode::kScriptWaitNamed: {
      const Script* script = behavior_.find_script(caller_.text(pop()));
      return wait(ThreadState::kScriptWaitPre, script != nullptr ? script->number : INT32_MIN);
    }

    // ---- texts
    case PCode::kBeginPrint:
      return begin_text();
    case PCode::kPrintString: {
      const std::string text(caller_.text(pop()));
      return print_text(text);
    }
    case PCode::kPrintLocalized: {
      unsupported(code);  // no LANGUAGE lumps: the key itself is shown
      const std::string text(caller_.text(pop()));
      return print_text(text);
    }
    case PCode::kPrintBind:
      drop(1);
      return print_text("???");
    case PCode::kPrintNumber: {
      const int32_t value = pop();
      return print([&](std::string& out) { append_number(out, value); });
    }
    case PCode::kPrintCharacter: {
      const int32_t value = pop();
      return print([&](std::string& out) { out.push_back(static_cast<char>(value)); });
    }
    case PCode::kPrintFixed: {
      const int32_t value = pop();
      return print([&](std::string& out) { append_fixed(out, value); });
    }
    case PCode::kPrintBinary:
    case PCode::kPrintHex: {
      const auto value = static_cast<uint32_t>(pop());
      return print([&](std::string& out) { append_unsigned(out, value, code == PCode::kPrintHex ? 16 : 2); });
    }
    case PCode::kPrintName:
      return print_name(pop());
    case PCode::kPrintMapCharArray:
      return print_array(Scope::kMapArray, false);
    case PCode::kPrintWorldCharArray:
      return print_array(Scope::kWorldArray, false);
    case PCode::kPrintGlobalCharArray:
      return print_array(Scope::kGlobalArray, false);
    case PCode::kPrintScriptCharArray:
      return print_array(Scope::kScriptArray, false);
    case PCode::kPrintMapChRange:
      return print_array(Scope::kMapArray, true);
    case PCode::kPrintWorldChRange:
      return print_array(Scope::kWorldArray, true);
    case PCode::kPrintGlobalChRange:
      return print_array(Scope::kGlobalArray, true);
    case PCode::kPrintScriptChRange:
      return print_array(Scope::kScriptArray, true);
    case PCode::kStrCpyToMapChRange:
      return copy_to_array(Scope::kMapArray);
    case PCode::kStrCpyToWorldChRange:
      return copy_to_array(Scope::kWorldArray);
    case PCode::kStrCpyToGlobalChRange:
      return copy_to_array(Scope::kGlobalArray);
    case PCode::kStrCpyToScriptChRange:
      return copy_to_array(Scope::kScriptArray);
    case PCode::kStrLen:
      top() = static_cast<int32_t>(caller_.text(top()).size());
      return;
    case PCode::kSaveString: {
      const std::string text = take_text();
      if (failed_) return;
      charge_for(machine_.dynamic_strings.size());
      const std::optional<int32_t> index = add_string(world_, text);
      return index ? push(*index) : fail("builds more texts than the machine keeps");
    }
    case PCode::kEndPrint:
    case PCode::kEndPrintBold: {
      std::string text = take_text();
      if (!failed_) show_print(caller_, std::move(text), code == PCode::kEndPrintBold);
      return;
    }
    case PCode::kEndLog: {
      const std::string text = take_text();
      if (!failed_) spdlog::debug("{}: {}", caller_.script_label(), text);
      return;
    }
    case PCode::kMoreHudMessage:
      return;
    case PCode::kOptHudMessage:
      thread_.option_start = static_cast<int32_t>(sp_);
      return;
    case PCode::kEndHudMessage:
    case PCode::kEndHudMessageBold:
      return end_hud_message(code == PCode::kEndHudMessageBold);
    case PCode::kSetFont:
    case PCode::kSetFontDirect:
      thread_.font = upper_case(caller_.text(code == PCode::kSetFont ? pop() : word()));
      return;
    case PCode::kSetHudSize: {
      const auto [width, height, covers_bar] = take<3>();
      thread_.hud_width = width == INT32_MIN ? 0 : std::abs(width);
      thread_.hud_height = height == INT32_MIN ? 0 : std::abs(height);
      thread_.hud_covers_bar = covers_bar != 0;
      return;
    }
    default:
      return execute_call(code);
  }
}

void Interpreter::execute_call(PCode code) {
  switch (code) {
    // ---- line specials
    case PCode::kLspec1:
    case PCode::kLspec2:
    case PCode::kLspec3:
    case PCode::kLspec4:
    case PCode::kLspec5: {
      const int count = static_cast<int>(code) - static_cast<int>(PCode::kLspec1) + 1;
      const int32_t number = small();
      std::array<int32_t, 5> args{};
      for (int i = count - 1; i >= 0; --i) args[static_cast<std::size_t>(i)] = pop();
      special(number, args);
      return;
    }
    case PCode::kLspec1Direct:
    case PCode::kLspec2Direct:
    case PCode::kLspec3Direct:
    case PCode::kLspec4Direct:
    case PCode::kLspec5Direct: {
      const int count = static_cast<int>(code) - static_cast<int>(PCode::kLspec1Direct) + 1;
      const int32_t number = small();
      std::array<int32_t, 5> args{};
      for (int i = 0; i < count; ++i) args[static_cast<std::size_t>(i)] = word();
      special(number, args);
      return;
    }
    case PCode::kLspec1DirectB:
    case PCode::kLspec2DirectB:
    case PCode::kLspec3DirectB:
    case PCode::kLspec4DirectB:
    case PCode::kLspec5DirectB: {
      const int count = static_cast<int>(code) - static_cast<int>(PCode::kLspec1DirectB) + 1;
      const int32_t number = raw_byte();
      std::array<int32_t, 5> args{};
      for (int i = 0; i < count; ++i) args[static_cast<std::size_t>(i)] = raw_byte();
      special(number, args);
      return;
    }
    case PCode::kLspec5Result: {
      const int32_t number = small();
      return push(special(number, take<5>()));
    }
    case PCode::kLspec5Ex: {
      const int32_t number = word();
      special(number, take<5>());
      return;
    }
    case PCode::kLspec5ExResult: {
      const int32_t number = word();
      return push(special(number, take<5>()));
    }

    // ---- the game
    case PCode::kPlayerCount:
      return push(world_.player_count());
    case PCode::kGameType:
      return push(world_.options().deathmatch ? 2 : world_.is_multiplayer() ? 1 : 0);
    case PCode::kGameSkill:
      return push(world_.options().skill - 1);
    case PCode::kTimer:
      return push(static_cast<int32_t>(static_cast<uint32_t>(world_.tic_count())));
    case PCode::kIsNetworkGame:
      return push(world_.player_count() > 1);
    case PCode::kSinglePlayer:
      return push(world_.player_count() == 1);
    case PCode::kPlayerNumber:
      return push(caller_.activator_player());
    case PCode::kActivatorTid: {
      const Actor* actor = caller_.activator();
      return push(actor != nullptr ? actor->thing_id : 0);
    }
    case PCode::kPlayerInGame:
      top() = is_player(top());
      return;
    case PCode::kPlayerIsBot:
      top() = 0;
      return;
    case PCode::kPlayerClass:
      top() = is_player(top()) ? 0 : -1;
      return;
    case PCode::kPlayerHealth: {
      const Actor* actor = caller_.activator();
      return push(actor != nullptr ? actor->health : 0);
    }
    case PCode::kPlayerArmorPoints:
      return push(caller_.activator_player() >= 0 ? world_.player(caller_.activator_player()).armor : 0);
    case PCode::kPlayerFrags:
      return push(caller_.activator_player() >= 0 ? world_.player(caller_.activator_player()).frag_count : 0);
    case PCode::kPlayerTeam:
    case PCode::kPlayerExpert:
    case PCode::kBlueTeamCount:
    case PCode::kRedTeamCount:
    case PCode::kBlueTeamScore:
    case PCode::kRedTeamScore:
    case PCode::kIsOneFlagCtf:
    case PCode::kGetInvasionWave:
    case PCode::kGetInvasionState:
    case PCode::kGetSigilPieces:
      return push(0);  // of games that this engine does not play
    case PCode::kPlayerBlueSkull:
    case PCode::kPlayerRedSkull:
    case PCode::kPlayerYellowSkull:
    case PCode::kPlayerMasterSkull:
    case PCode::kPlayerBlueCard:
    case PCode::kPlayerRedCard:
    case PCode::kPlayerYellowCard:
    case PCode::kPlayerMasterCard:
    case PCode::kPlayerBlackSkull:
    case PCode::kPlayerSilverSkull:
    case PCode::kPlayerGoldSkull:
    case PCode::kPlayerBlackCard:
    case PCode::kPlayerSilverCard:
      unsupported(code);  // the community's compiler writes none of them; CheckInventory requests keys
      return push(0);
    case PCode::kGetPlayerInfo: {
      const auto [player, what] = take<2>();
      return push(player_info(world_, player, what));
    }
    case PCode::kGetPlayerInput: {
      const auto [player, what] = take<2>();
      return push(player_input(world_, player < 0 ? caller_.activator_player() : player, what));
    }
    case PCode::kCheckPlayerCamera: {
      const int32_t player = pop();
      const Actor* camera = is_player(player) ? world_.actor(world_.player(player).camera_id) : nullptr;
      return push(camera != nullptr && camera->player_index < 0 ? camera->thing_id : -1);
    }
    case PCode::kGetLevelInfo:
      top() = level_info(world_, top());
      return;
    case PCode::kGetScreenWidth:
      return push(320);
    case PCode::kGetScreenHeight:
      return push(200);
    case PCode::kGetCvar:
      unsupported(code);
      top() = 0;
      return;
    case PCode::kChangeLevel:
      drop(4);
      return world_.exit_level();
    case PCode::kSetGravity:
    case PCode::kSetGravityDirect:
      state_.gravity = (code == PCode::kSetGravity ? pop() : word()) / 800;  // 800.0 is one
      return;
    case PCode::kSetAirControl:
    case PCode::kSetAirControlDirect:
      state_.air_control = code == PCode::kSetAirControl ? pop() : word();
      return;

    // ---- lines and sectors
    case PCode::kLineSide:
      return push(thread_.back_side ? 1 : 0);
    case PCode::kClearLineSpecial:
      if (thread_.line >= 0 && static_cast<std::size_t>(thread_.line) < state_.lines.size())
        state_.lines[static_cast<std::size_t>(thread_.line)].special = 0;
      return;
    case PCode::kGetLineRowOffset: {
      const bool known =
          thread_.line >= 0 && static_cast<std::size_t>(thread_.line) < world_.level().linedefs.size();
      if (!known) return push(0);
      const Linedef& line = world_.level().linedefs[static_cast<std::size_t>(thread_.line)];
      return push(world_.level().sidedefs[line.front].offset_y);
    }
    case PCode::kSetLineTexture: {
      charge();
      const auto [line, side, part, texture] = take<4>();
      return set_line_texture(caller_, line, side, part, caller_.text(texture));
    }
    case PCode::kSetLineBlocking: {
      charge();
      const auto [line, what] = take<2>();
      return set_line_blocking(world_, line, what);
    }
    case PCode::kSetLineMonsterBlocking: {
      charge();
      const auto [line_id, on] = take<2>();
      const bool blocks = on != 0;
      return each_line(world_, line_id, [&](std::size_t, LineState& line) {
        line.flags = blocks ? line.flags | kLineBlockMonsters : line.flags & ~kLineBlockMonsters;
      });
    }
    case PCode::kSetLineSpecial: {
      charge();
      const auto [line_id, number, a, b, c, d, e] = take<7>();
      const StoredSpecial wanted = stored_special(caller_, {number, {a, b, c, d, e}});
      return each_line(world_, line_id, [&](std::size_t, LineState& line) {
        line.special = wanted.number, line.args = wanted.args;
      });
    }
    case PCode::kChangeFloor:
    case PCode::kChangeCeiling: {
      charge();
      const auto [tag, flat] = take<2>();
      return change_flat(world_, tag, caller_.text(flat), code == PCode::kChangeCeiling);
    }
    case PCode::kChangeFloorDirect:
    case PCode::kChangeCeilingDirect: {
      charge();
      const int32_t tag = word();
      return change_flat(world_, tag, caller_.text(word()), code == PCode::kChangeCeilingDirect);
    }
    case PCode::kReplaceTextures: {
      charge();
      const auto [from, to, flags] = take<3>();
      return replace_textures(world_, caller_.text(from), caller_.text(to), flags);
    }
    case PCode::kGetSectorFloorZ:
    case PCode::kGetSectorCeilingZ: {
      charge();
      const auto [tag, x, y] = take<3>();
      return push(sector_height(world_, tag, x, y, code == PCode::kGetSectorCeilingZ));
    }
    case PCode::kGetSectorLightLevel:
      charge();
      top() = sector_light(world_, top());
      return;
    case PCode::kSectorDamage: {
      charge();
      const auto [tag, amount, type, protection, flags] = take<5>();
      return damage_sector(caller_, tag, amount, type, protection, flags);
    }
    case PCode::kSetFloorTrigger:
    case PCode::kSetCeilingTrigger: {
      const auto [tag, height, number, a, b, c, d, e] = take<8>();
      return watch_plane(caller_, tag, wrap(int64_t{height} * kFracUnit), number, {a, b, c, d, e},
                         code == PCode::kSetCeilingTrigger);
    }

    // ---- actors
    case PCode::kThingCount:
    case PCode::kThingCountName: {
      charge();
      const auto [type, thing_id] = take<2>();
      return push(code == PCode::kThingCount ? count_things_by_number(caller_, type, thing_id, -1)
                                             : count_things_by_name(caller_, type, thing_id, -1));
    }
    case PCode::kThingCountDirect: {
      charge();
      const int32_t type = word();
      return push(count_things_by_number(caller_, type, word(), -1));
    }
    case PCode::kThingCountSector:
    case PCode::kThingCountNameSector: {
      charge();
      const auto [type, thing_id, tag] = take<3>();
      return push(code == PCode::kThingCountSector ? count_things_by_number(caller_, type, thing_id, tag)
                                                   : count_things_by_name(caller_, type, thing_id, tag));
    }
    case PCode::kSpawn: {
      charge();
      const auto [type, x, y, z, thing_id, angle] = take<6>();
      return push(spawn_thing(caller_, type, x, y, z, thing_id, byte_angle(angle), false));
    }
    case PCode::kSpawnDirect: {
      charge();
      std::array<int32_t, 6> values;
      for (int32_t& value : values) value = word();
      const auto [type, x, y, z, thing_id, angle] = values;
      return push(spawn_thing(caller_, type, x, y, z, thing_id, byte_angle(angle), false));
    }
    case PCode::kSpawnSpot: {
      charge();
      const auto [type, spot, thing_id, angle] = take<4>();
      return push(spawn_at_spots(caller_, type, spot, thing_id, byte_angle(angle), false, false));
    }
    case PCode::kSpawnSpotDirect: {
      charge();
      std::array<int32_t, 4> values;
      for (int32_t& value : values) value = word();
      const auto [type, spot, thing_id, angle] = values;
      return push(spawn_at_spots(caller_, type, spot, thing_id, byte_angle(angle), false, false));
    }
    case PCode::kSpawnSpotFacing: {
      charge();
      const auto [type, spot, thing_id] = take<3>();
      return push(spawn_at_spots(caller_, type, spot, thing_id, 0, true, false));
    }
    case PCode::kSpawnProjectile:
    case PCode::kThingProjectile2: {
      charge();
      const auto [source, type_value, angle, speed, rise, gravity, thing_id] = take<7>();
      const std::optional<uint32_t> type = code == PCode::kSpawnProjectile
                                               ? caller_.type_named(type_value)
                                               : world_.catalog().find_spawn_id(type_value);
      if (type) spawn_projectile(caller_, source, *type, byte_angle(angle), speed, rise, gravity, thing_id);
      return;
    }
    case PCode::kGetActorX:
    case PCode::kGetActorY:
    case PCode::kGetActorZ:
    case PCode::kGetActorFloorZ:
    case PCode::kGetActorCeilingZ:
    case PCode::kGetActorAngle:
    case PCode::kGetActorPitch:
    case PCode::kGetActorLightLevel: {
      const Actor* actor = caller_.one_actor(top());
      if (actor == nullptr) {
        top() = 0;
        return;
      }
      switch (code) {
        case PCode::kGetActorX:
          top() = actor->x;
          return;
        case PCode::kGetActorY:
          top() = actor->y;
          return;
        case PCode::kGetActorZ:
          top() = actor->z;
          return;
        case PCode::kGetActorFloorZ:
          top() = actor->ground_z;  // bodies do not count
          return;
        case PCode::kGetActorCeilingZ:
          top() = actor->roof_z;
          return;
        case PCode::kGetActorAngle:
          top() = from_angle(actor->angle);
          return;
        case PCode::kGetActorPitch:
          top() = static_cast<int32_t>(actor->pitch) >> kFracBits;
          return;
        default:
          top() = state_.sectors[actor->sector_index].light;
          return;
      }
    }
    case PCode::kSetActorAngle: {
      const auto [thing_id, angle] = take<2>();
      const Angle wanted = to_angle(angle);
      caller_.each_actor(thing_id, [&](Actor& actor) { world_.set_angle(actor.id, wanted); });
      return;
    }
    case PCode::kSetActorPitch: {
      const auto [thing_id, pitch] = take<2>();
      const Angle wanted = to_angle(pitch);
      caller_.each_actor(thing_id, [&](Actor& actor) {
        actor.pitch =
            actor.player_index >= 0 ? PlayerThinker::clamped_pitch(static_cast<int32_t>(wanted)) : wanted;
      });
      return;
    }
    case PCode::kSetActorPosition: {
      charge();
      const auto [thing_id, x, y, z, fog] = take<5>();
      Actor* actor = caller_.one_actor(thing_id);
      return push(actor != nullptr && set_position(caller_, *actor, x, y, z, fog != 0));
    }
    case PCode::kSetActorState: {
      const auto [thing_id, label, exact] = take<3>();
      return push(set_actor_state(caller_, thing_id, label, exact != 0));
    }
    case PCode::kSetActorProperty: {
      const auto [thing_id, property, value] = take<3>();
      const int32_t which = property, wanted = value;
      caller_.each_actor(thing_id, [&](Actor& actor) { set_actor_property(caller_, actor, which, wanted); });
      return;
    }
    case PCode::kGetActorProperty: {
      const auto [thing_id, property] = take<2>();
      return push(get_actor_property(caller_, caller_.one_actor(thing_id), property));
    }
    case PCode::kSetThingSpecial: {
      const auto [thing_id, number, a, b, c, d, e] = take<7>();
      const StoredSpecial wanted = stored_special(caller_, {number, {a, b, c, d, e}});
      caller_.each_actor(thing_id,
                         [&](Actor& actor) { actor.special = wanted.number, actor.args = wanted.args; });
      return;
    }
    case PCode::kThingDamage2: {
      charge();
      const auto [thing_id, amount, type] = take<3>();
      return push(damage_thing(caller_, thing_id, amount, type));
    }
    case PCode::kClassifyActor:
      top() = classify_actor(caller_, top());
      return;
    case PCode::kCheckActorFloorTexture:
    case PCode::kCheckActorCeilingTexture: {
      const auto [thing_id, texture] = take<2>();
      const Actor* actor = caller_.one_actor(thing_id);
      if (actor == nullptr) return push(0);
      const Sector& sector = state_.sectors[actor->sector_index];
      return push(same_ignoring_case(
          code == PCode::kCheckActorFloorTexture ? sector.floor_texture : sector.ceiling_texture,
          caller_.text(texture)));
    }

    // ---- inventory
    case PCode::kClearInventory:
      return clear_inventory_of(caller_, caller_.activator(), caller_.activator() == nullptr);
    case PCode::kClearActorInventory:
      caller_.each_actor(pop(), [&](Actor& actor) { clear_inventory_of(caller_, &actor, false); });
      return;
    case PCode::kGiveInventory:
    case PCode::kTakeInventory:
    case PCode::kGiveInventoryDirect:
    case PCode::kTakeInventoryDirect: {
      const bool direct = code == PCode::kGiveInventoryDirect || code == PCode::kTakeInventoryDirect;
      const int32_t amount_on_stack = direct ? 0 : pop();
      const int32_t name = direct ? word() : pop();
      const int32_t amount = direct ? word() : amount_on_stack;
      Actor* actor = caller_.activator();
      if (code == PCode::kGiveInventory || code == PCode::kGiveInventoryDirect) {
        give_inventory(caller_, actor, actor == nullptr, name, amount);
      } else {
        take_inventory(caller_, actor, actor == nullptr, name, amount);
      }
      return;
    }
    case PCode::kCheckInventory:
      top() = check_inventory(caller_, caller_.activator(), top());
      return;
    case PCode::kCheckInventoryDirect:
      return push(check_inventory(caller_, caller_.activator(), word()));
    case PCode::kGiveActorInventory:
    case PCode::kTakeActorInventory: {
      const auto [thing_id, name, amount] = take<3>();
      const int32_t what = name, count = amount;
      const bool everyone = thing_id == 0 && caller_.activator() == nullptr;
      const auto change = [&](Actor* actor) {
        if (code == PCode::kGiveActorInventory) {
          give_inventory(caller_, actor, everyone, what, count);
        } else {
          take_inventory(caller_, actor, everyone, what, count);
        }
      };
      if (everyone) return change(nullptr);
      caller_.each_actor(thing_id, [&](Actor& actor) { change(&actor); });
      return;
    }
    case PCode::kCheckActorInventory: {
      const auto [thing_id, name] = take<2>();
      const Actor* const owner = thing_id != 0 ? caller_.one_actor(thing_id) : nullptr;  // 0 is no actor here
      return push(check_inventory(caller_, owner, name));
    }
    case PCode::kUseInventory:
      top() = use_inventory(caller_, caller_.activator(), caller_.activator() == nullptr, top());
      return;
    case PCode::kUseActorInventory: {
      const auto [thing_id, name] = take<2>();
      const int32_t what = name;
      int32_t used = 0;
      caller_.each_actor(thing_id,
                         [&](Actor& actor) { used += use_inventory(caller_, &actor, false, what); });
      return push(used);
    }
    case PCode::kSetWeapon: {
      const int player = caller_.activator_player();
      const std::optional<uint32_t> type = caller_.type_named(pop());
      return push(player >= 0 && type && select_weapon(world_, player, *type, true));
    }
    case PCode::kCheckWeapon: {
      const int player = caller_.activator_player();
      const uint32_t ready = player >= 0 ? world_.player(player).ready_weapon : kNoType;
      top() = ready != kNoType && same_ignoring_case(world_.catalog()[ready].name, caller_.text(top()));
      return;
    }
    case PCode::kGetAmmoCapacity: {
      const int player = caller_.activator_player();
      const std::optional<uint32_t> type = caller_.type_named(pop());
      return push(player >= 0 && type ? max_item(world_, player, *type) : 0);
    }
    case PCode::kSetAmmoCapacity: {
      const auto [name, amount] = take<2>();
      const int player = caller_.activator_player();
      const std::optional<uint32_t> type = caller_.type_named(name);
      if (player >= 0 && type) set_max_item(world_, player, *type, std::max(amount, 0));
      return;
    }

    // ---- sounds, music, sky and fades: nothing here shows them
    case PCode::kSectorSound:
    case PCode::kAmbientSound:
    case PCode::kSoundSequence:
    case PCode::kThingSound:
    case PCode::kActivatorSound:
    case PCode::kLocalAmbientSound:
    case PCode::kMusicChange:
    case PCode::kSetMusic:
    case PCode::kLocalSetMusic:
    case PCode::kFadeTo:
    case PCode::kFadeRange:
    case PCode::kCancelFade:
    case PCode::kChangeSky:
    case PCode::kSetCameraToTexture:
    case PCode::kSetMugshotState:
    case PCode::kSetStyle:
      return drop(bytecode::kPCodes[static_cast<std::size_t>(code)].pops);
    case PCode::kSetMusicDirect:
    case PCode::kLocalSetMusicDirect:
    case PCode::kSetStyleDirect:
      pc_ += kSteps[static_cast<std::size_t>(code)].operand_bytes[compact_];
      return;

    // ---- what would change play, but is not there
    case PCode::kConsoleCommandDirect:
    case PCode::kConsoleCommand:
    case PCode::kPlayMovie:
    case PCode::kStartTranslation:
    case PCode::kTranslationRange1:
    case PCode::kTranslationRange2:
    case PCode::kTranslationRange3:
    case PCode::kEndTranslation:
    case PCode::kSetMarineWeapon:
    case PCode::kSetMarineSprite:
    case PCode::kMorphActor:
    case PCode::kUnmorphActor: {
      unsupported(code);
      const Step& step = kSteps[static_cast<std::size_t>(code)];
      pc_ += step.operand_bytes[compact_];
      drop(step.pops);
      for (int i = 0; i < step.pushes; ++i) push(0);
      return;
    }
    default:
      return fail("uses " + std::string(bytecode::kPCodes[static_cast<std::size_t>(code)].name) +
                  ", which this engine does not support");
  }
}

}  // namespace

void run_thread(World& world, const Behavior& behavior, Thread& thread) {
  MachineState& machine = world.state().scripts;
  if (machine.nesting == 0) machine.instructions_left = machine.instructions_per_tic;
  ++machine.nesting;
  Interpreter(world, behavior, thread).run();
  --machine.nesting;
}

}  // namespace comrad::doom::acs
