#include "sim_workers/engine/actors/actor_catalog.h"

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/actors/builtin.h"
#include "sim_workers/engine/actors/flag_names.h"
#include "sim_workers/engine/actors/state_labels.h"

namespace comrad::doom {

uint32_t ActorType::find_label(std::string_view label_name) const {
  for (const Label& label : labels)
    if (same_ignoring_case(label.name, label_name)) return label.state;
  return kNoState;
}

ActorCatalog::ActorCatalog() {
  add_sprite("TNT1");
  texts_.emplace_back();
  translations_.emplace_back();  // 0: none, every colour stays
  for (std::size_t color = 0; color < 256; ++color) translations_[0][color] = static_cast<uint8_t>(color);
  add_builtin_actors(this);
  refresh_known();
}

uint32_t ActorCatalog::add(ActorType type) {
  std::string name = lower_case(type.name);
  const auto known_type = by_name_.find(name);
  const uint32_t index =
      known_type != by_name_.end() ? known_type->second : static_cast<uint32_t>(types_.size());
  if (known_type == by_name_.end()) {
    by_name_.emplace(std::move(name), index);
    types_.emplace_back();
    replacement_.push_back(index);
  } else if (const auto number = by_editor_number_.find(types_[index].editor_number);
             number != by_editor_number_.end() && number->second == index) {
    by_editor_number_.erase(number);  // of the type that goes
  }
  if (type.editor_number >= 0) by_editor_number_[type.editor_number] = index;
  if (type.replaces < replacement_.size()) {
    // An earlier replacement gives way, and so does the type that led to it.
    for (uint32_t& replacement : replacement_)
      if (replacement == type.replaces) replacement = index;
    replacement_[type.replaces] = index;
  }
  // Monsters are kin of their topmost monster ancestor.
  if (type.species == kNoType && type.flags.has(ActorFlag::kIsMonster)) type.species = index;
  types_[index] = std::move(type);
  return index;
}

uint32_t ActorCatalog::add_simple(ActorType type, std::string_view sprite, std::string_view letters, int tics,
                                  bool bright) {
  const uint32_t first = static_cast<uint32_t>(states_.size());
  const uint32_t sprite_index = add_sprite(sprite);
  for (std::size_t place = 0; place < letters.size(); ++place) {
    State state;
    state.sprite = sprite_index;
    state.frame = static_cast<uint8_t>(letters[place] - 'A');
    state.bright = bright;
    state.tics = static_cast<int16_t>(tics);
    state.next = place + 1 < letters.size() ? first + static_cast<uint32_t>(place) + 1 : first;
    add_state(state);
  }
  set_label(&type, "spawn", letters.empty() ? kNoState : first);
  return add(std::move(type));
}

ActorType ActorCatalog::derived(uint32_t parent, std::string_view name) const {
  ActorType type = types_[parent];
  type.name = name;
  type.parent = parent;
  type.replaces = kNoType;
  type.editor_number = -1;
  type.spawn_id = type.conversation_id = 0;
  if (type.weapon.slot_of_player) type.weapon.slot = -1, type.weapon.slot_of_player = false;
  if (type.item_class == ItemClass::kAmmo && type.ammo_base == kNoType &&
      !same_ignoring_case(types_[parent].name, "Ammo"))
    type.ammo_base = parent;
  return type;
}

uint32_t ActorCatalog::add_state(const State& state) {
  states_.push_back(state);
  return static_cast<uint32_t>(states_.size() - 1);
}

uint32_t ActorCatalog::add_args(std::span<const ActionArg> args) {
  const uint32_t first = static_cast<uint32_t>(args_.size());
  args_.insert(args_.end(), args.begin(), args.end());
  return first;
}

uint32_t ActorCatalog::add_sprite(std::string_view name) {
  std::string upper = upper_case(name.substr(0, 4));
  const auto found = std::find(sprites_.begin(), sprites_.end(), upper);
  if (found == sprites_.end())
    sprites_.push_back(std::move(upper));
  else
    return static_cast<uint32_t>(found - sprites_.begin());
  return static_cast<uint32_t>(sprites_.size() - 1);
}

int32_t ActorCatalog::add_text(std::string_view text) {
  const auto found = std::find(texts_.begin(), texts_.end(), text);
  if (found != texts_.end()) return static_cast<int32_t>(found - texts_.begin());
  texts_.emplace_back(text);
  return static_cast<int32_t>(texts_.size() - 1);
}

uint8_t ActorCatalog::add_translation(const std::array<uint8_t, 256>& table) {
  const auto found = std::find(translations_.begin(), translations_.end(), table);
  if (found != translations_.end()) return static_cast<uint8_t>(found - translations_.begin());
  if (translations_.size() == 256) return 0;
  translations_.push_back(table);
  return static_cast<uint8_t>(translations_.size() - 1);
}

std::optional<DamageType> ActorCatalog::find_damage_type(std::string_view name) const {
  if (const std::optional<DamageType> known = doom::find_damage_type(name)) return known;
  for (std::size_t own = 0; own < damage_types_.size(); ++own)
    if (same_ignoring_case(damage_types_[own], name))
      return static_cast<DamageType>(static_cast<std::size_t>(DamageType::kFirstOwn) + own);
  return std::nullopt;
}

std::optional<DamageType> ActorCatalog::add_damage_type(std::string_view name) {
  if (const std::optional<DamageType> known = find_damage_type(name)) return known;
  const std::size_t next = static_cast<std::size_t>(DamageType::kFirstOwn) + damage_types_.size();
  if (next >= static_cast<std::size_t>(DamageType::kCount)) return std::nullopt;
  damage_types_.emplace_back(name);
  return static_cast<DamageType>(next);
}

std::string_view ActorCatalog::damage_type_name(DamageType type) const {
  if (type < DamageType::kFirstOwn) return doom::damage_type_name(type);
  const std::size_t own = static_cast<std::size_t>(type) - static_cast<std::size_t>(DamageType::kFirstOwn);
  return own < damage_types_.size() ? std::string_view(damage_types_[own]) : std::string_view();
}

std::optional<uint32_t> ActorCatalog::find(std::string_view name) const {
  const auto found = by_name_.find(lower_case(name));
  if (found != by_name_.end()) return found->second;
  if (same_ignoring_case(name, "Player")) return find("DoomPlayer");
  return std::nullopt;
}

std::optional<uint32_t> ActorCatalog::find_editor_number(int32_t number) const {
  const auto found = by_editor_number_.find(number);
  if (number < 0 || found == by_editor_number_.end()) return std::nullopt;
  return found->second;
}

std::optional<uint32_t> ActorCatalog::find_spawn_id(int32_t number) const {
  if (number <= 0) return std::nullopt;
  for (uint32_t index = static_cast<uint32_t>(types_.size()); index-- > 0;)
    if (types_[index].spawn_id == number) return index;
  return std::nullopt;
}

bool ActorCatalog::is_a(uint32_t type, uint32_t ancestor) const {
  // A chain is never longer than the list, so a broken one ends too.
  for (std::size_t step = 0; type < types_.size() && step <= types_.size(); ++step) {
    if (type == ancestor) return true;
    type = types_[type].parent;
  }
  return false;
}

bool ActorCatalog::is_a(uint32_t type, std::string_view ancestor) const {
  const std::optional<uint32_t> index = find(ancestor);
  return index && is_a(type, *index);
}

bool ActorCatalog::set_player(std::string_view name) {
  const std::optional<uint32_t> type = find(name);
  if (!type || !types_[*type].is_player) return false;
  known_.player = *type;
  return true;
}

void ActorCatalog::refresh_known() {
  const auto index_of = [this](std::string_view name) { return find(name).value_or(kNoType); };
  known_ = {.player = index_of("DoomPlayer"),
            .bullet_puff = index_of("BulletPuff"),
            .blood = index_of("Blood"),
            .teleport_fog = index_of("TeleportFog"),
            .item_fog = index_of("ItemFog"),
            .fist = index_of("Fist"),
            .pistol = index_of("Pistol"),
            .clip = index_of("Clip"),
            .shell = index_of("Shell"),
            .rocket_ammo = index_of("RocketAmmo"),
            .cell = index_of("Cell"),
            .basic_armor = index_of("BasicArmor"),
            .archvile_fire = index_of("ArchvileFire"),
            .lost_soul = index_of("LostSoul"),
            .arachnotron_plasma = index_of("ArachnotronPlasma"),
            .tracer_smoke = index_of("RevenantTracerSmoke")};
  if (const std::optional<uint32_t> gibs = find("RealGibs"))
    known_.gibs_state = types_[*gibs].state(StateLabel::kSpawn);
}

}  // namespace comrad::doom
