// SetActorProperty, GetActorProperty and CheckActorProperty: the numbers that scripts know actors' values by.
// Stage: tic.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "sim_workers/engine/acs/caller.h"

namespace comrad::doom::acs {

enum class ActorProperty : int32_t {
  kHealth = 0,
  kSpeed = 1,
  kDamage = 2,
  kAlpha = 3,
  kRenderStyle = 4,
  kSeeSound = 5,
  kAttackSound = 6,
  kPainSound = 7,
  kDeathSound = 8,
  kActiveSound = 9,
  kAmbush = 10,
  kInvulnerable = 11,
  kJumpZ = 12,
  kChaseGoal = 13,
  kFrightened = 14,
  kGravity = 15,
  kFriendly = 16,
  kSpawnHealth = 17,
  kDropped = 18,
  kNoTarget = 19,
  kSpecies = 20,
  kNameTag = 21,
  kScore = 22,
  kNoTrigger = 23,
  kDamageFactor = 24,
  kMasterTid = 25,
  kTargetTid = 26,
  kTracerTid = 27,
  kWaterLevel = 28,
  kScaleX = 29,
  kScaleY = 30,
  kDormant = 31,
  kMass = 32,
  kAccuracy = 33,
  kStamina = 34,
  kHeight = 35,
  kRadius = 36,
  kReactionTime = 37,
  kMeleeRange = 38,
  kViewHeight = 39,
  kAttackZOffset = 40,
  kStencilColor = 41,
  kFriction = 42,
  kDamageMultiplier = 43,
  kMaxStepHeight = 44,
  kMaxDropOffHeight = 45,
  kDamageType = 46,
};
constexpr int32_t kActorPropertyCount = 47;
std::string_view actor_property_name(int32_t property);  ///< empty for numbers of none

/// Sets it. What this engine cannot change is one warning.
void set_actor_property(const Caller& caller, Actor& actor, int32_t property, int32_t value);
/// Its value; 0 where there is nobody, and for texts.
int32_t get_actor_property(const Caller& caller, const Actor* actor, int32_t property);
/// Does it have that value? Texts compare as text.
bool check_actor_property(const Caller& caller, const Actor* actor, int32_t property, int32_t value);

}  // namespace comrad::doom::acs
