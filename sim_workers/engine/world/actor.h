// A live object of the world (Doom's mobj). Stage: tic.
#pragma once

#include <array>
#include <cstdint>

#include "sim_workers/engine/actors/actor_type.h"
#include "sim_workers/engine/fixed.h"

namespace comrad::doom {

/// Eight ways a monster walks, and standing still.
enum Direction : uint8_t {
  kEast,
  kNorthEast,
  kNorth,
  kNorthWest,
  kWest,
  kSouthWest,
  kSouth,
  kSouthEast,
  kNoDirection
};

/// References to it hold until the end of the tic (World keeps actors in place); code that remembers one longer
/// keeps its id. Another actor is named by id too: 0 is nobody, and the one named may be gone.
struct Actor {
  uint32_t id = 0;    ///< never reused inside a world
  uint32_t type = 0;  ///< index into the catalog
  Fixed x = 0, y = 0, z = 0;
  Fixed velocity_x = 0, velocity_y = 0, velocity_z = 0;
  Angle angle = 0;
  Angle pitch = 0;  ///< positive down
  Fixed radius = 0, height = 0;
  Fixed floor_z = 0, ceiling_z = 0, dropoff_z = 0;  ///< of the opening it is in, other bodies included
  /// The same without other bodies, as it was when it moved last or a plane near it did. Under its whole box;
  /// of a body that was put somewhere (born, or placed by a script) under its centre alone.
  Fixed ground_z = 0, roof_z = 0;
  uint32_t sector_index = 0;        ///< of its centre
  uint32_t floor_sector_index = 0;  ///< that gives floor_z
  ActorFlags flags;
  int32_t health = 0;
  int32_t start_health = 0;   ///< of its type or, where the map sets it, of the map
  uint32_t state = kNoState;  ///< index into the catalog's states
  int32_t tics = -1;          ///< left in this state; -1 for ever
  uint32_t sprite = 0;        ///< as the state sets; apart so that weapons' and scripts' changes can show
  uint8_t frame = 0;

  int32_t thing_id = 0;      ///< TID of scripts; 0 none
  uint32_t thing_order = 0;  ///< higher for the actor that got its thing id later
  int32_t special = 0;
  std::array<int32_t, 5> args{};

  uint32_t target_id = 0;  ///< whom it attacks; of a missile: who fired it
  uint32_t tracer_id = 0;  ///< whom a seeker follows; an arch-vile's corpse
  uint32_t master_id = 0;
  uint32_t goal_id = 0;
  uint32_t last_enemy_id = 0;
  uint32_t last_heard_id = 0;
  int32_t hate_thing_id = 0;  ///< Thing_Hate: it looks for actors of this thing id; 0 none
  Direction move_direction = kNoDirection;
  int32_t move_count = 0;
  int32_t reaction_tics = 0;
  int32_t threshold = 0;  ///< tics that it keeps its target when others hurt it
  int32_t last_look_player = 0;
  int32_t special_1 = 0, special_2 = 0;

  Fixed speed = 0, float_speed = 0;
  DamageDice damage;
  Fixed damage_factor = kFracUnit;
  Fixed gravity = kFracUnit;
  int32_t mass = 100;
  int32_t amount = 1;  ///< of an item
  int32_t score = 0;   ///< of APROP_Score
  int32_t bounce_count = -1;
  DamageType damage_type = DamageType::kNormal;
  RenderStyle render_style = RenderStyle::kNormal;
  float alpha = 1.0f, scale_x = 1.0f, scale_y = 1.0f;
  uint8_t translation = 0;

  int32_t player_index = -1;  ///< -1: no player
  bool removed = false;       ///< taken out at the end of the tic
  /// Where it was spawned, for items and monsters that come back.
  Fixed spawn_x = 0, spawn_y = 0, spawn_z = 0;
  Angle spawn_angle = 0;
  uint64_t spawn_tic = 0;

  bool has(ActorFlag flag) const { return flags.has(flag); }
  void set(ActorFlag flag, bool on = true) { flags.set(flag, on); }
  bool is_corpse() const { return flags.has(ActorFlag::kCorpse); }
  /// Makes it faster by `more` units a tic that way.
  void push(Angle way, Fixed more) {
    velocity_x = clamped_fixed(int64_t{velocity_x} + fixed_mul(more, fine_cosine(way)));
    velocity_y = clamped_fixed(int64_t{velocity_y} + fixed_mul(more, fine_sine(way)));
  }
  Fixed top() const { return clamped_fixed(int64_t{z} + height); }
  /// The z at which it hangs from its ceiling.
  Fixed hanging_z() const { return clamped_fixed(int64_t{ceiling_z} - height); }
};

}  // namespace comrad::doom
