#include "sim_workers/engine/acs/strings.h"

#include <algorithm>
#include <charconv>
#include <cstdio>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/acs/machine.h"

namespace comrad::doom::acs {
namespace {

constexpr std::size_t kStringsMax = 1 << 12;       // alive at once
constexpr std::size_t kAllTextBytesMax = 1 << 24;  // in all of them

// Marks every string number among values that scripts can still read. A number that merely looks like one
// keeps a string alive for longer; that is harmless, and the same on every machine.
class Marks {
 public:
  explicit Marks(std::size_t count) : used_(count, false) {}
  void add(int32_t value) {
    const int64_t index = int64_t{value} - kDynamicStringBase;
    if (index >= 0 && index < static_cast<int64_t>(used_.size()))
      used_[static_cast<std::size_t>(index)] = true;
  }
  template <typename Values>
  void add_all(const Values& values) {
    for (const int32_t value : values) add(value);
  }
  bool used(std::size_t index) const { return used_[index]; }

 private:
  std::vector<bool> used_;
};

}  // namespace

std::string_view string_at(const World& world, int32_t index) {
  if (index >= kDynamicStringBase) {
    const auto& strings = world.state().scripts.dynamic_strings;
    const std::size_t place = static_cast<std::size_t>(index - kDynamicStringBase);
    return place < strings.size() ? std::string_view(strings[place]) : std::string_view();
  }
  if (world.behavior() == nullptr || index < 0) return {};
  const auto strings = world.behavior()->strings();
  return static_cast<std::size_t>(index) < strings.size()
             ? std::string_view(strings[static_cast<std::size_t>(index)])
             : std::string_view();
}

int compare_text(std::string_view a, std::string_view b, bool any_case, std::size_t count) {
  a = a.substr(0, count), b = b.substr(0, count);
  const std::size_t shared = std::min(a.size(), b.size());
  for (std::size_t i = 0; i < shared; ++i) {
    const auto left = static_cast<unsigned char>(any_case ? lower_case(a[i]) : a[i]);
    const auto right = static_cast<unsigned char>(any_case ? lower_case(b[i]) : b[i]);
    if (left != right) return left < right ? -1 : 1;
  }
  return a.size() == b.size() ? 0 : a.size() < b.size() ? -1 : 1;
}

std::string printable(std::string_view text) {
  std::string result(text.substr(0, 64));
  for (char& c : result)
    if (c < ' ' || c > '~') c = '?';
  return result;
}

std::optional<int32_t> add_string(World& world, std::string_view text) {
  MachineState& machine = world.state().scripts;
  std::vector<std::string>& strings = machine.dynamic_strings;
  if (text.empty()) {  // an empty place is a free one: the empty text has its own number
    if (strings.empty()) strings.emplace_back();
    return kDynamicStringBase;
  }
  for (std::size_t i = 1; i < strings.size(); ++i)
    if (strings[i] == text) return kDynamicStringBase + static_cast<int32_t>(i);
  if (strings.empty()) strings.emplace_back();
  if (machine.dynamic_bytes + text.size() > kAllTextBytesMax) return std::nullopt;
  if (!machine.free_strings.empty()) {
    const uint32_t place = machine.free_strings.back();
    machine.free_strings.pop_back();
    strings[place].assign(text);
    machine.dynamic_bytes += text.size();
    return kDynamicStringBase + static_cast<int32_t>(place);
  }
  if (strings.size() >= kStringsMax) return std::nullopt;
  strings.emplace_back(text);
  machine.dynamic_bytes += text.size();
  return kDynamicStringBase + static_cast<int32_t>(strings.size() - 1);
}

void purge_strings(World& world) {
  MachineState& machine = world.state().scripts;
  const std::size_t alive = machine.dynamic_strings.size() - machine.free_strings.size();
  if (alive < machine.string_purge_at) return;
  Marks marks(machine.dynamic_strings.size());
  for (const Thread& thread : machine.threads) {
    marks.add_all(thread.stack), marks.add_all(thread.locals);
    marks.add(thread.result);
  }
  marks.add_all(machine.map_variables), marks.add_all(machine.world_variables);
  for (const auto& array : machine.map_arrays) marks.add_all(array);
  for (const auto& array : machine.world_arrays) marks.add_all(array);
  for (const auto& array : machine.global_arrays) marks.add_all(array);
  marks.add_all(world.state().globals);
  for (const PlaneWatcher& watcher : machine.plane_watchers) marks.add_all(watcher.args);
  for (const Actor& actor : world.actors()) marks.add_all(actor.args);
  for (const LineState& line : world.state().lines) marks.add_all(line.args);
  for (std::size_t i = 0; i < machine.dynamic_strings.size(); ++i) {
    if (i == 0 || marks.used(i) || machine.dynamic_strings[i].empty()) continue;
    machine.dynamic_bytes -= machine.dynamic_strings[i].size();
    machine.dynamic_strings[i].clear();
    machine.free_strings.push_back(static_cast<uint32_t>(i));
  }
  const std::size_t left = machine.dynamic_strings.size() - machine.free_strings.size();
  machine.string_purge_at = std::max(kStringPurgeFirst, static_cast<uint32_t>(left) * 2);
}

void append_fixed(std::string& out, int32_t value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%g", to_double(value));
  out += text;
}

void append_number(std::string& out, int32_t value) {
  char text[16];
  const auto result = std::to_chars(text, text + sizeof(text), value);
  out.append(text, result.ptr);
}

void append_unsigned(std::string& out, uint32_t value, uint32_t base) {
  char text[40];
  const auto result = std::to_chars(text, text + sizeof(text), value, static_cast<int>(base));
  for (char* c = text; c != result.ptr; ++c) *c = upper_case(*c);
  out.append(text, result.ptr);
}

}  // namespace comrad::doom::acs
