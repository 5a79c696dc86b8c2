#include "sim_workers/engine/acs/behavior.h"

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/behavior_reader.h"
#include "sim_workers/engine/acs/strings.h"

namespace comrad::doom::acs {

Expected<std::shared_ptr<const Behavior>> Behavior::load(std::span<const uint8_t> lump,
                                                         const std::string& label) {
  return BehaviorReader(lump, label).read();
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
