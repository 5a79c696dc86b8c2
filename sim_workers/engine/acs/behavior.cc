#include "sim_workers/engine/acs/behavior.h"

#include <algorithm>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/behavior_linker.h"
#include "sim_workers/engine/acs/behavior_reader.h"
#include "sim_workers/engine/acs/strings.h"

namespace comrad::doom::acs {
namespace {

constexpr std::size_t kLibrariesMax = 64;

}  // namespace

Expected<std::shared_ptr<const Behavior>> Behavior::load(std::span<const uint8_t> lump,
                                                         const std::string& label,
                                                         const LibraryReader& libraries,
                                                         const std::vector<std::string>& loadacs) {
  BehaviorReader reader(lump, label);
  COMRAD_TRY_ASSIGN(std::shared_ptr<Behavior> map, reader.read());
  BehaviorLinker linker(*map, reader.links());

  struct Wanted {
    std::string name, by;
  };
  std::vector<Wanted> wanted;
  const auto want = [&](const std::vector<std::string>& names, const std::string& by) {
    for (const std::string& name : names)
      if (std::none_of(wanted.begin(), wanted.end(),
                       [&](const Wanted& other) { return same_ignoring_case(other.name, name); }))
        wanted.push_back({name, by});
  };
  want(loadacs, label + ": LOADACS");
  want(reader.links().libraries, label + ": LOAD");
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const auto [name, by] = wanted[i];  // a copy: `wanted` grows
    const auto bytes = libraries ? libraries(name) : std::nullopt;
    if (!bytes || i >= kLibrariesMax) {
      spdlog::warn("{} names the library {}, which {}; scripts that call it stop", by, printable(name),
                   bytes ? "is one too many" : "is not in the WAD");
      continue;
    }
    const std::string library_label = label + " library " + printable(name);
    BehaviorReader library_reader(*bytes, library_label);
    COMRAD_TRY_ASSIGN(const std::shared_ptr<Behavior> library, library_reader.read());
    linker.add(*library, library_reader.links());
    want(library_reader.links().libraries, library_label + ": LOAD");
  }
  linker.resolve();
  return std::shared_ptr<const Behavior>(std::move(map));
}

const Script* Behavior::find_script(int32_t number) const {
  for (const Script& script : scripts_)
    if (script.number == number) return &script;
  return nullptr;
}

const Script* Behavior::find_script(std::string_view name) const {
  for (const Script& script : scripts_)
    if (!script.name.empty() && same_ignoring_case(script.name, name)) return &script;
  return nullptr;
}

}  // namespace comrad::doom::acs
