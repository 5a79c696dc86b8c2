// All actor types, states, sprites and arguments of a game: the built-in Doom actors and those of
// DECORATE lumps. Immutable once worlds use it, and shared by them. Stage: tic and render.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "sim_workers/engine/actors/actor_type.h"

namespace comrad::doom {

constexpr int kPlayersMax = 8;

/// Editor number of the places where players of a deathmatch begin.
constexpr int32_t kDeathmatchStart = 11;

/// The player, from 0, whose start a THINGS editor number is: 1-4 and 4001-4004. Nothing for other numbers.
constexpr std::optional<int> player_of_start(int32_t editor_number) {
  if (editor_number >= 1 && editor_number <= 4) return editor_number - 1;
  if (editor_number >= 4001 && editor_number <= 4004) return editor_number - 4001 + 4;
  return std::nullopt;
}

class ActorCatalog {
 public:
  ActorCatalog();  ///< every built-in actor (actors/builtin_*.cc)

  /// Adds a type, which replaces one of the same name (its index stays). Returns its index.
  uint32_t add(ActorType type);
  /// A type with pictures alone: letters of `sprite` in a circle, `tics` each (-1: the first for ever).
  uint32_t add_simple(ActorType type, std::string_view sprite, std::string_view letters, int tics,
                      bool bright = false);
  /// A copy of `parent` called `name`, without what is not inherited: numbers, replacement, weapon slot.
  ActorType derived(uint32_t parent, std::string_view name) const;
  uint32_t add_state(const State& state);              ///< returns its index
  uint32_t add_args(std::span<const ActionArg> args);  ///< returns the index of the first
  uint32_t add_sprite(std::string_view name);  ///< four letters, upper case; the same name has one index
  int32_t add_text(std::string_view text);
  uint8_t add_translation(const std::array<uint8_t, 256>& table);
  /// The damage type of that name, made where it is new; nothing where there are 16 of them already.
  std::optional<DamageType> add_damage_type(std::string_view name);
  ActorType& edit(uint32_t index) { return types_[index]; }

  std::optional<uint32_t> find(std::string_view name) const;         ///< any case
  std::optional<uint32_t> find_editor_number(int32_t number) const;  ///< the newest wins
  std::optional<uint32_t> find_spawn_id(int32_t number) const;
  std::optional<DamageType> find_damage_type(std::string_view name) const;  ///< any case; also the lumps' own
  std::string_view damage_type_name(DamageType type) const;
  /// The type that is spawned where `index` is requested: itself, or what replaces it.
  uint32_t replacement(uint32_t index) const { return replacement_[index]; }
  bool is_a(uint32_t type, uint32_t ancestor) const;
  bool is_a(uint32_t type, std::string_view ancestor) const;

  const ActorType& operator[](uint32_t index) const { return types_[index]; }
  std::size_t size() const { return types_.size(); }
  const State& state(uint32_t index) const { return states_[index]; }
  std::size_t state_count() const { return states_.size(); }
  std::span<const ActionArg> args(const State& state) const {
    return std::span(args_).subspan(state.first_arg, state.arg_count);
  }
  const std::string& sprite_name(uint32_t index) const { return sprites_[index]; }
  std::size_t sprite_count() const { return sprites_.size(); }
  const std::string& text(int32_t index) const { return texts_[static_cast<std::size_t>(index)]; }
  const std::array<uint8_t, 256>& translation(uint8_t index) const { return translations_[index]; }

  // Types that the engine itself requests; kNoType where a catalog lacks one.
  struct Known {
    uint32_t player = kNoType, bullet_puff = kNoType, blood = kNoType, teleport_fog = kNoType,
             item_fog = kNoType, fist = kNoType, pistol = kNoType, clip = kNoType, shell = kNoType,
             rocket_ammo = kNoType, cell = kNoType, basic_armor = kNoType, archvile_fire = kNoType,
             lost_soul = kNoType, gibs_state = kNoState, arachnotron_plasma = kNoType, tracer_smoke = kNoType;
  };
  const Known& known() const { return known_; }
  /// Players become actors of this class; false where it is none of PlayerPawn's. After refresh_known().
  bool set_player(std::string_view name);
  void refresh_known();  ///< after the last add(); the constructor and DECORATE call it

 private:
  std::vector<ActorType> types_;
  std::vector<uint32_t> replacement_;
  std::vector<State> states_;
  std::vector<ActionArg> args_;
  std::vector<std::string> sprites_;
  std::vector<std::string> texts_;
  std::vector<std::string> damage_types_;  // from DamageType::kFirstOwn on
  std::vector<std::array<uint8_t, 256>> translations_;
  std::unordered_map<std::string, uint32_t> by_name_;  // lower case
  std::unordered_map<int32_t, uint32_t> by_editor_number_;
  Known known_;
};

}  // namespace comrad::doom
