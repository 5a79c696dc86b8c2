#include "sim_workers/engine/acs/caller.h"

#include <spdlog/fmt/fmt.h>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/acs/strings.h"
#include "sim_workers/engine/play/hitscan.h"

namespace comrad::doom::acs {

Actor* Caller::activator() const {
  if (thread.activator_id == 0) return nullptr;
  Actor* actor = world.actor(thread.activator_id);
  return actor != nullptr && !actor->removed ? actor : nullptr;
}

int Caller::activator_player() const {
  const Actor* actor = activator();
  return actor != nullptr && actor->player_index < world.player_count() ? actor->player_index : -1;
}

Actor* Caller::pointer_of(Actor* actor, int32_t selector) const {
  for (int player = 0; player < kPlayersMax; ++player)
    if (selector == 64 << player) return player < world.player_count() ? world.body_of(player) : nullptr;
  if (actor == nullptr || selector == 0) return actor;
  switch (selector) {
    case 2:
      return world.actor(actor->target_id);
    case 4:
      return world.actor(actor->master_id);
    case 8:
      return world.actor(actor->tracer_id);
    case 16:
    case 32768:
      return actor->player_index >= 0 ? aim_bullet(world, *actor).target : nullptr;
    default:
      return nullptr;
  }
}

std::string_view Caller::text(int32_t index) const {
  const bool known =
      index >= kDynamicStringBase
          ? static_cast<std::size_t>(index - kDynamicStringBase) < machine().dynamic_strings.size()
          : index >= 0 && static_cast<std::size_t>(index) < behavior.strings().size();
  if (!known) {
    if (index != 0)  // what scripts pass for "none"
      warn(kWarnString, fmt::format("string {}, of which there is none, reads as empty", index));
    return {};
  }
  return string_at(world, index);
}

std::optional<uint32_t> Caller::type_named(int32_t string_index) const {
  const std::string_view name = text(string_index);
  const std::optional<uint32_t> type = world.catalog().find(name);
  if (!type && !name.empty() && !same_ignoring_case(name, "None"))
    warn(kWarnName + static_cast<uint32_t>(string_index) % 256,
         "there is no actor type \"" + printable(name) + "\"");
  return type;
}

void Caller::unsupported(std::size_t warning_index, std::string_view what) const {
  if (behavior.first_time(warning_index))
    spdlog::warn("{}: {} is not supported and does nothing", script_label(), what);
}

void Caller::warn(std::size_t warning_index, const std::string& message) const {
  if (behavior.first_time(warning_index)) spdlog::warn("{}: {}", script_label(), message);
}

std::string Caller::script_label() const {
  std::string label = behavior.label() + ": script ";
  const auto scripts = behavior.scripts();
  if (thread.script_index < scripts.size() && !scripts[thread.script_index].name.empty())
    return label + "\"" + printable(scripts[thread.script_index].name) + "\"";
  return fmt::format("{}{}", label, thread.script);
}

}  // namespace comrad::doom::acs
