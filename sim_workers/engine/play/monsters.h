// How monsters look for players, walk and choose their attacks. Stage: tic.
#pragma once

#include <cstdint>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

constexpr int32_t kTurnThreshold = 100;  ///< tics that a monster keeps to who hurt it last

/// Whom it attacks; null: nobody, or gone.
Actor* target_of(World& world, const Actor& actor);
/// Doom's estimate of the distance seen from above, saturated.
Fixed distance_between(const Actor& from, const Actor& to);
Angle angle_between(const Actor& from, const Actor& to);
/// Players and friendly monsters are friends of each other; nobody else has any.
bool is_friend(const Actor& one, const Actor& other);
/// True where monsters move and shoot as on the highest skill.
bool is_fast(const World& world, const Actor& monster);

bool check_melee_range(World& world, Actor& monster);
bool check_missile_range(World& world, Actor& monster);
/// One step in move_direction; opens doors on its way.
bool monster_move(World& world, Actor& monster);
/// Towards its target, or round what is in the way; the frightened turn away.
void new_chase_direction(World& world, Actor& monster);
/// Anywhere; more often than not straight on.
void random_chase_direction(World& world, Actor& monster);
/// Finds somebody to attack: who it hates, enemies of a friendly monster, players in turn; its goal where
/// there is nobody. True when it has a target now.
bool look_for_players(World& world, Actor& monster, bool all_around);
struct LookRange {
  bool all_around = false;
  Fixed nearest = 0, farthest = 0;  ///< 0: no limit
  Angle field_of_view = 0;          ///< 0: half a turn
};
bool look_for_players(World& world, Actor& monster, const LookRange& range);
void face_target(World& world, Actor& monster);
/// A monster's death frees or wakes others: A_BossDeath's map rules.
void boss_death(World& world, Actor& boss);
/// A charging lost soul ran into a body, or (null) a wall: it bites and stops.
void skull_struck(World& world, Actor& skull, Actor* struck);

/// What a chasing monster may do in this call.
struct ChaseOptions {
  uint32_t melee_state = kNoState, missile_state = kNoState;
  bool stands = false;  ///< turns and attacks, but does not walk
};
/// One decision of a monster that is awake: attack, give up, or take a step.
void chase(World& world, Actor& monster, const ChaseOptions& options);
/// One step without a target.
void wander(World& world, Actor& monster);
/// To its Idle state, or Spawn.
void set_idle(World& world, Actor& actor);
/// True where a monster that `other` hurt may take it as its new target.
bool may_turn_against(World& world, Actor& monster, const Actor& other);

}  // namespace comrad::doom
