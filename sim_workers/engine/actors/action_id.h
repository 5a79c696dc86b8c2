// The action functions of states, by name and by number. A name here has a function action_<Name> in
// play/actions.h; DECORATE calls it A_<Name>. The list is the support table of the README.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace comrad::doom {

// Of every actor and of monsters: play/monsters.cc, play/actor_actions.cc.
// clang-format off
#define COMRAD_ACTOR_ACTIONS(X) \
  X(Look) X(LookEx) X(Chase) X(FastChase) X(VileChase) X(Wander) X(FaceTarget) X(FaceMaster) \
  X(FaceTracer) X(Pain) X(Scream) X(XScream) X(PlayerScream) X(NoBlocking) X(Fall) X(SpawnDebris) \
  X(ActiveSound) X(PosAttack) X(SPosAttackUseAtkSound) X(CPosAttack) X(CPosRefire) X(SpidRefire) \
  X(TroopAttack) X(SargAttack) X(HeadAttack) X(BruisAttack) X(SkullAttack) X(BspiAttack) X(CyberAttack) \
  X(PainAttack) X(PainDie) X(DualPainAttack) X(BetaSkullAttack) X(SkelFist) X(SkelMissile) X(SkelWhoosh) \
  X(Tracer) X(FatRaise) X(FatAttack1) X(FatAttack2) X(FatAttack3) X(VileStart) X(VileTarget) \
  X(VileAttack) X(FireCrackle) X(StartFire) X(Fire) X(BossDeath) X(KeenDie) X(BrainAwake) X(BrainPain) \
  X(BrainScream) X(BrainDie) X(BrainExplode) X(BrainSpit) X(SpawnSound) X(SpawnFly) X(BabyMetal) X(Hoof) \
  X(Metal) X(Explode) X(RadiusThrust) X(BarrelDestroy) X(Die) X(Detonate) X(MeleeAttack) X(MissileAttack) \
  X(ComboAttack) X(BulletAttack) X(CustomMissile) X(CustomBulletAttack) X(CustomMeleeAttack) \
  X(CustomComboAttack) X(MonsterRail) X(CustomRailgun) X(SpawnItem) X(SpawnItemEx) X(SpawnProjectile) \
  X(DropItem) X(Jump) X(JumpIfHealthLower) X(JumpIfCloser) X(JumpIfTargetInLOS) X(JumpIfInventory) \
  X(JumpIfInTargetInventory) X(JumpIf) X(JumpIfMasterCloser) X(JumpIfTracerCloser) X(CheckSight) \
  X(CheckFloor) X(CheckCeiling) X(MonsterRefire) X(GiveInventory) X(TakeInventory) X(GiveToTarget) X(RadiusGive) \
  X(TakeFromTarget) X(SetSpecial) X(ChangeFlag) X(SetArg) X(ACS_Execute) X(ACS_ExecuteAlways) \
  X(ACS_ExecuteWithResult) X(ACS_NamedExecuteAlways) X(ACS_Terminate) X(Thing_Remove) X(CallSpecial) X(FadeIn) \
  X(FadeOut) X(FadeTo) X(SetTranslucent) X(SetScale) X(ScaleVelocity) X(ChangeVelocity) X(SetAngle) \
  X(SetPitch) X(Gravity) X(NoGravity) X(LowGravity) X(SetGravity) X(Stop) X(ThrustThing) X(Recoil) \
  X(SetSolid) X(UnsetSolid) X(SetShootable) X(UnSetShootable) X(SetFloat) X(UnSetFloat) \
  X(SetInvulnerable) X(UnSetInvulnerable) X(SetReflective) X(UnSetReflective) X(UnsetFloorClip) X(Burst) \
  X(CountdownArg) X(Countdown) X(PlaySound) X(PlaySoundEx) X(PlayWeaponSound) X(StopSound) X(StopSoundEx) \
  X(Log) X(Print) X(PrintBold) X(KillMaster) X(KillChildren) X(DamageMaster) X(DamageChildren) \
  X(DamageSelf) X(DamageTarget) X(RemoveMaster) X(RemoveChildren) X(ClearTarget) X(AlertMonsters) \
  X(Quake) X(Weave) X(SeekerMissile) X(Bang4Cloud) X(Turn) X(Respawn) X(SkullPop) X(FreezeDeath) \
  X(FreezeDeathChunks) X(GenericFreezeDeath) X(QueueCorpse) X(ResetReloadCounter) X(SetUserVar) \
  X(SetDamageType) X(SetSpeed) X(SentinelBob) X(ClearLastHeard) X(Warp) X(M_Refire) X(M_CheckAttack) \
  X(M_Saw) X(M_Punch) X(M_FirePistol) X(M_FireShotgun) X(M_CheckAttack2) X(M_FireShotgun2) X(M_FireCGun) \
  X(M_FireMissile) X(M_FireRailgun) X(M_FirePlasma) X(M_FireBFG) X(M_BerserkPunch) X(M_SawRefire) \
  X(MarineLook) X(MarineChase) X(MarineNoise)
// clang-format on

// Of weapons in a player's hand: play/weapon_actions.cc.
// clang-format off
#define COMRAD_WEAPON_ACTIONS(X) \
  X(WeaponReady) X(Lower) X(Raise) X(ReFire) X(ClearReFire) X(GunFlash) X(CheckReload) X(Light) X(Light0) \
  X(Light1) X(Light2) X(Punch) X(FirePistol) X(FireShotgun) X(FireShotgun2) X(OpenShotgun2) \
  X(LoadShotgun2) X(CloseShotgun2) X(FireCGun) X(FireMissile) X(FirePlasma) X(BFGsound) X(FireBFG) \
  X(BFGSpray) X(Saw) X(FireBullets) X(FireCustomMissile) X(FireProjectile) X(CustomPunch) X(RailAttack) \
  X(SelectWeapon) X(JumpIfNoAmmo) X(CheckForReload) X(WeaponBob) X(ZoomFactor) X(SetCrosshair) \
  X(RestoreSpecialPosition) X(RestoreSpecialThing1) X(RestoreSpecialThing2) X(RestoreSpecialDoomThing) \
  X(KickBack)
// clang-format on

enum class ActionId : uint16_t {
  kNone,
#define COMRAD_ACTION(name) k##name,
  COMRAD_ACTOR_ACTIONS(COMRAD_ACTION) COMRAD_WEAPON_ACTIONS(COMRAD_ACTION)
#undef COMRAD_ACTION
      kCount
};

/// The action called `name`, with or without "A_", in any case. Nothing for names that this engine does
/// not know.
std::optional<ActionId> find_action(std::string_view name);

/// The name without "A_"; empty for kNone.
std::string_view action_name(ActionId id);

}  // namespace comrad::doom
