#include "sim_workers/engine/actors/action_arguments.h"

#include <string_view>
#include <utility>

namespace comrad::doom {
namespace {

// One letter per argument: n number, c class, s state label or count of states, t text; the last one counts
// for those after it where it is a capital.
constexpr std::pair<ActionId, std::string_view> kSignatures[] = {
    {ActionId::kChase, "ss"},
    {ActionId::kLookEx, "nnnnns"},
    {ActionId::kPainAttack, "c"},
    {ActionId::kPainDie, "c"},
    {ActionId::kDualPainAttack, "c"},
    {ActionId::kFatAttack1, "c"},
    {ActionId::kFatAttack2, "c"},
    {ActionId::kFatAttack3, "c"},
    {ActionId::kVileTarget, "c"},
    {ActionId::kVileAttack, "tnnnct"},
    {ActionId::kTracer, "c"},
    {ActionId::kBrainSpit, "c"},
    {ActionId::kSpawnFly, "c"},
    {ActionId::kSpawnDebris, "c"},
    {ActionId::kBurst, "c"},
    {ActionId::kCustomMissile, "c"},
    {ActionId::kSpawnProjectile, "c"},
    {ActionId::kFireCustomMissile, "c"},
    {ActionId::kFireProjectile, "c"},
    {ActionId::kCustomBulletAttack, "nnnnc"},
    {ActionId::kFireBullets, "nnnnc"},
    {ActionId::kCustomPunch, "nnncnnntt"},
    {ActionId::kSaw, "ttnc"},
    {ActionId::kM_Saw, "ttnc"},
    {ActionId::kRailAttack, "nnnttnnc"},
    {ActionId::kCustomRailgun, "nnttnnnc"},
    {ActionId::kBFGSpray, "c"},
    {ActionId::kCustomMeleeAttack, "nttt"},
    {ActionId::kCustomComboAttack, "cnntt"},
    {ActionId::kSpawnItem, "c"},
    {ActionId::kSpawnItemEx, "c"},
    {ActionId::kDropItem, "c"},
    {ActionId::kRadiusGive, "cnnnctn"},
    {ActionId::kJump, "nS"},
    {ActionId::kJumpIf, "ns"},
    {ActionId::kJumpIfHealthLower, "ns"},
    {ActionId::kJumpIfCloser, "ns"},
    {ActionId::kJumpIfMasterCloser, "ns"},
    {ActionId::kJumpIfTracerCloser, "ns"},
    {ActionId::kJumpIfTargetInLOS, "s"},
    {ActionId::kJumpIfInventory, "cns"},
    {ActionId::kJumpIfInTargetInventory, "cns"},
    {ActionId::kJumpIfNoAmmo, "s"},
    {ActionId::kCheckSight, "s"},
    {ActionId::kCheckFloor, "s"},
    {ActionId::kCheckCeiling, "s"},
    {ActionId::kCheckForReload, "ns"},
    {ActionId::kMonsterRefire, "ns"},
    {ActionId::kReFire, "s"},
    {ActionId::kGunFlash, "s"},
    {ActionId::kCountdownArg, "ns"},
    {ActionId::kWarp, "nnnnnns"},
    {ActionId::kGiveInventory, "c"},
    {ActionId::kTakeInventory, "c"},
    {ActionId::kGiveToTarget, "c"},
    {ActionId::kTakeFromTarget, "c"},
    {ActionId::kSelectWeapon, "c"},
    {ActionId::kChangeFlag, "t"},
    {ActionId::kACS_NamedExecuteAlways, "t"},
    {ActionId::kPlaySound, "t"},
    {ActionId::kPlaySoundEx, "tt"},
    {ActionId::kPlayWeaponSound, "t"},
    {ActionId::kLog, "t"},
    {ActionId::kPrint, "t"},
    {ActionId::kPrintBold, "t"},
    {ActionId::kKillMaster, "t"},
    {ActionId::kKillChildren, "t"},
    {ActionId::kDamageMaster, "nt"},
    {ActionId::kDamageChildren, "nt"},
    {ActionId::kDamageSelf, "nt"},
    {ActionId::kDamageTarget, "nt"},
    {ActionId::kSetUserVar, "t"},
    {ActionId::kSetDamageType, "t"},
    {ActionId::kDie, "t"},
    {ActionId::kExplode, "nnnnnnct"},
};

}  // namespace

ArgumentMeaning argument_meaning(ActionId action, std::size_t index) {
  for (const auto& [known, signature] : kSignatures) {
    if (known != action) continue;
    const char last = signature.back();
    const char letter = index < signature.size()       ? signature[index]
                        : (last >= 'A' && last <= 'Z') ? last
                                                       : 'n';
    switch (letter) {
      case 'c':
        return ArgumentMeaning::kClass;
      case 's':
      case 'S':
        return ArgumentMeaning::kLabel;
      case 't':
        return ArgumentMeaning::kText;
      default:
        return ArgumentMeaning::kNumber;
    }
  }
  return ArgumentMeaning::kNumber;
}

}  // namespace comrad::doom
