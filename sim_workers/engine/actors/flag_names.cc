#include "sim_workers/engine/actors/flag_names.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "rollout_buffer/core/text.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

// Lower case, without prefix.
// clang-format off
constexpr std::pair<std::string_view, ActorFlag> kFlags[] = {
    {"solid", kSolid}, {"shootable", kShootable}, {"noblockmap", kNoBlockmap}, {"nosector", kNoSector},
    {"nogravity", kNoGravity}, {"lowgravity", kLowGravity}, {"float", kFloat}, {"fly", kFly},
    {"dropoff", kDropOff}, {"noclip", kNoClip}, {"canpass", kCanPass}, {"pushable", kPushable},
    {"cannotpush", kCannotPush}, {"spawnceiling", kSpawnCeiling}, {"noteleport", kNoTeleport},
    {"teleport", kTeleport}, {"slidesonwalls", kSlidesOnWalls}, {"floorclip", kFloorClip},
    {"special", kSpecial},
    {"missile", kMissile}, {"ripper", kRipper}, {"noextremedeath", kNoExtremeDeath},
    {"extremedeath", kExtremeDeath}, {"bounceonwalls", kBounceOnWalls}, {"bounceonfloors", kBounceOnFloors},
    {"seekermissile", kSeekerMissile}, {"forceradiusdmg", kForceRadiusDamage},
    {"noradiusdmg", kNoRadiusDamage}, {"randomize", kRandomize}, {"explodeonwater", kExplodeOnWater},
    {"thrughost", kThruGhost}, {"ghost", kGhost}, {"floorhugger", kFloorHugger},
    {"ceilinghugger", kCeilingHugger}, {"dontsplash", kDontSplash}, {"bloodlessimpact", kBloodlessImpact},
    {"strifedamage", kStrifeDamage}, {"piercearmor", kPierceArmor}, {"hittarget", kHitTarget},
    {"hittracer", kHitTracer}, {"stepmissile", kStepMissile},
    {"ismonster", kIsMonster}, {"countkill", kCountKill}, {"countitem", kCountItem}, {"countsecret", kCountSecret},
    {"ambush", kAmbush},
    {"justhit", kJustHit}, {"justattacked", kJustAttacked}, {"skullfly", kSkullFly}, {"infloat", kInFloat},
    {"inchase", kInChase}, {"friendly", kFriendly}, {"frightened", kFrightened},
    {"lookallaround", kLookAllAround}, {"standstill", kStandStill}, {"dormant", kDormant}, {"boss", kBoss},
    {"bossdeath", kBossDeath}, {"nopain", kNoPain}, {"painless", kPainless},
    {"quicktoretaliate", kQuickToRetaliate}, {"notarget", kNoTarget}, {"noinfighting", kNoInfighting},
    {"donthurtspecies", kDontHurtSpecies}, {"avoidmelee", kAvoidMelee}, {"missilemore", kMissileMore},
    {"missileevenmore", kMissileEvenMore}, {"nevertarget", kNeverTarget}, {"alwaysfast", kAlwaysFast},
    {"neverrespawn", kNeverRespawn}, {"alwaysrespawn", kAlwaysRespawn}, {"nofear", kNoFear}, {"fullvolactive", kFullVolumeActive}, {"shortmissilerange", kShortMissileRange},
    {"longmeleerange", kLongMeleeRange}, {"canusewalls", kCanUseWalls}, {"canpushwalls", kPushWall},
    {"activateimpact", kActivateImpact}, {"activatepcross", kActivateCross},
    {"activatemcross", kActivateCross}, {"noblockmonst", kNoBlockMonsters}, {"touchy", kTouchy},
    {"notargetswitch", kNoTargetSwitch}, {"dontmorph", kDontMorph}, {"falldamage", kFallDamage},
    {"invulnerable", kInvulnerable}, {"reflective", kReflective}, {"buddha", kBuddha},
    {"noblood", kNoBlood}, {"nodamage", kNoDamage}, {"nodamagethrust", kNoDamageThrust}, {"dontthrust", kDontThrust}, {"oldradiusdmg", kOldRadiusDamage},
    {"noicedeath", kNoIceDeath}, {"dontgib", kDontGib}, {"corpse", kCorpse}, {"icecorpse", kIceCorpse},
    {"killed", kKilled}, {"dropped", kDropped}, {"shadow", kShadow}, {"dontfall", kDontFall},
    {"usespecial", kUseSpecial}, {"nonshootable", kNonShootable},
    {"bright", kBright}, {"invisible", kInvisible}, {"forceybillboard", kForceYBillboard},
    {"nointeraction", kNoInteraction}, {"rockettrail", kRocketTrail}, {"puffonactors", kPuffOnActors},
    {"puffgetsowner", kPuffGetsOwner}, {"alwayspuff", kAlwaysPuff}, {"synchronized", kSynchronized},
    {"donttranslate", kDontTranslate}, {"nospriteshadow", kNoSpriteShadow},
    {"movewithsector", kMoveWithSector}, {"skyexplode", kSkyExplode},
    {"pickup", kPickup}, {"alwayspickup", kAlwaysPickup}, {"autoactivate", kAutoActivate},
    {"invbar", kInvBar}, {"undroppable", kUndroppable}, {"quiet", kQuiet},
    {"fancypickupsound", kFancyPickup}, {"bigpowerup", kBigPowerup}, {"keepdepleted", kKeepDepleted},
    {"ignoreskill", kIgnoreSkill}, {"untossable", kUntossable}, {"additivetime", kAdditiveTime},
    {"noscreenflash", kNoScreenFlash}, {"tossed", kTossed}, {"persistentpower", kPersistentPower},
    {"noautofire", kWeaponNoAutoFire}, {"noalert", kWeaponNoAlert}, {"ammo_optional", kWeaponAmmoOptional},
    {"alt_ammo_optional", kWeaponAltAmmoOptional}, {"meleeweapon", kWeaponMelee},
    {"noautoaim", kWeaponNoAutoaim}, {"dontbob", kWeaponDontBob}, {"explosive", kWeaponExplosive},
    {"primary_uses_both", kWeaponPrimaryUsesBoth}, {"wimpy_weapon", kWeaponWimpy},
    {"readysndhalf", kWeaponReadySoundHalf}, {"ammo_checkboth", kWeaponAmmoCheckBoth},
    {"cheatnotweapon", kWeaponCheatNotWeapon},
};
// clang-format on

// Flags of sounds, decals, other games, or of things that this engine never does.
// clang-format off
constexpr std::string_view kIdleFlags[] = {
    "actlikebridge", "allowpain", "allowparticles", "axeblood", "bfg", "blasted", "blockasplayer",
    "bossthink", "bot_explosive", "bot_meleeweapon", "bot_react_skill_thing", "bouncelikeheretic",
    "bumpspecial", "canblast", "canbouncewater", "canjump", "cantseek", "causepain",
    "crashed", "deathmatchonly", "defthreshold", "dehexplosion", "doharmspecies", "dontblast", "dontcorpse",
    "dontdrain", "dontfacetalker", "dontharmclass", "dontharmspecies", "dontlightactors", "dontoverlap",
    "dontreflect", "dontrip", "dontseekinvisible", "dontsquash", "explodeonsky",
    "fastershift", "firedamage", "fireresist", "foilbuddha", "foilinvul", "forcedecal", "forcepain",
    "forcexybillboard", "fullvoldeath", "grenadetrail", "harmfriends", "hereticbounce", "hexenbounce",
    "hittransparent", "hubpower", "icedamage", "inscroll", "interhubstrip", "isteleportspot", "jumpdown",
    "maximumhealth", "mirrorreflect", "mthruspecies", "noaltammocheck", "noattackscreenflash",
    "noautoswitchto", "noblooddecals", "nobloodecals", "nobossrip", "nobounce", "nobouncesound",
    "nodeathdeselect", "nodeathinput", "nodecal", "nodropoff", "noexplodefloor", "noforwardfall",
    "nofriction", "noinfightspecies", "nolifebar", "nomenu", "nopowerups", "noskin", "notautoaimed",
    "notbotweapon", "notdmatch", "noteam", "noteleother", "nothrustwheninvul", "notimefreeze",
    "notonautomap", "notrigger", "noverticalmeleerange", "nowallbouncesnd", "noweaponswitch",
    "painsky", "poisonalways", "powered_up", "reflectsmissiles", "relativetofloor",
    "restrictabsolutely", "retargetafterslam", "ripdontgib", "seeinvisible", "seesdaggers", "shieldreflect",
    "skullflystop", "spawnfloat", "spawnsoundsource", "spectral", "spriteangle", "spriteflip",
    "staff2_kickback", "stayonlift", "stealth", "telestomp", "throbbing", "thruactors", "thruspecies",
    "useboltstate", "usekillscripts", "vfriction", "visibilitypulse", "vulnerable", "weaponspawn",
    "windthrust", "worldtouch", "xflip", "yflip", "zdoomtrans",
};
// clang-format on

// clang-format off
constexpr std::pair<std::string_view, DamageType> kDamageTypes[] = {
    {"none", DamageType::kNormal}, {"normal", DamageType::kNormal}, {"fire", DamageType::kFire},
    {"ice", DamageType::kIce}, {"slime", DamageType::kSlime}, {"drowning", DamageType::kDrowning},
    {"telefrag", DamageType::kTelefrag}, {"falling", DamageType::kFalling}, {"crush", DamageType::kCrush},
    {"suicide", DamageType::kSuicide}, {"exit", DamageType::kExit}, {"railgun", DamageType::kRailgun},
    {"massacre", DamageType::kMassacre}, {"instantdeath", DamageType::kInstantDeath},
    {"electric", DamageType::kElectric}, {"poison", DamageType::kPoison},
};
// clang-format on

// clang-format off
constexpr std::pair<std::string_view, RenderStyle> kStyles[] = {
    {"none", RenderStyle::kNone}, {"normal", RenderStyle::kNormal}, {"fuzzy", RenderStyle::kFuzzy},
    {"soultrans", RenderStyle::kTranslucent}, {"optfuzzy", RenderStyle::kFuzzy},
    {"stencil", RenderStyle::kStencil}, {"addstencil", RenderStyle::kStencil},
    {"translucentstencil", RenderStyle::kStencil}, {"shaded", RenderStyle::kStencil},
    {"translucent", RenderStyle::kTranslucent}, {"add", RenderStyle::kAdd}, {"addshaded", RenderStyle::kAdd},
    {"subtract", RenderStyle::kSubtract}, {"shadow", RenderStyle::kShadow},
};
// clang-format on

// clang-format off
constexpr std::pair<std::string_view, PowerKind> kPowers[] = {
    {"invulnerable", PowerKind::kInvulnerable}, {"strength", PowerKind::kStrength},
    {"invisibility", PowerKind::kInvisibility}, {"ghost", PowerKind::kInvisibility},
    {"shadow", PowerKind::kInvisibility}, {"ironfeet", PowerKind::kIronFeet}, {"mask", PowerKind::kIronFeet},
    {"allmap", PowerKind::kAllMap}, {"scanner", PowerKind::kAllMap}, {"lightamp", PowerKind::kLightAmp},
    {"torch", PowerKind::kLightAmp}, {"timefreezer", PowerKind::kTimeFreeze},
    {"flight", PowerKind::kFlight}, {"speed", PowerKind::kSpeed}, {"damage", PowerKind::kDoubleDamage},
    {"protection", PowerKind::kProtection},
};
// clang-format on

// Bits of the flags that action functions take, and other words with a number.
// clang-format off
constexpr std::pair<std::string_view, int32_t> kConstants[] = {
    {"true", 1}, {"false", 0}, {"none", 0},
    // Chase
    {"chf_fastchase", 1}, {"chf_noplayactive", 2}, {"chf_nightmarefast", 4}, {"chf_resurrect", 8},
    {"chf_dontmove", 16}, {"chf_norandomturn", 32}, {"chf_nodirectionturn", 64},
    {"chf_nopostattackturn", 128}, {"chf_stopifblocked", 256},
    // LookEx
    {"lof_nosightcheck", 1}, {"lof_nosoundcheck", 2}, {"lof_dontchasegoal", 4}, {"lof_noseesound", 8},
    {"lof_fullvolseesound", 16}, {"lof_nojump", 32},
    // RadiusGive
    {"rgf_giveself", 1}, {"rgf_players", 2}, {"rgf_monsters", 4}, {"rgf_objects", 8}, {"rgf_voodoo", 16},
    {"rgf_corpses", 32}, {"rgf_notarget", 64}, {"rgf_notracer", 128}, {"rgf_nomaster", 256}, {"rgf_cube", 512},
    {"rgf_nosight", 1024}, {"rgf_missiles", 2048}, {"rgf_inclusive", 4096}, {"rgf_items", 8192},
    {"rgf_killed", 16384}, {"rgf_exfilter", 32768}, {"rgf_exspecies", 65536}, {"rgf_either", 131072},
    // SpawnItemEx
    {"sxf_transfertranslation", 1}, {"sxf_absoluteposition", 2}, {"sxf_absoluteangle", 4},
    {"sxf_absolutevelocity", 8}, {"sxf_absolutemomentum", 8}, {"sxf_setmaster", 16},
    {"sxf_nocheckposition", 32}, {"sxf_telefrag", 64}, {"sxf_clientside", 128},
    {"sxf_transferambushflag", 256}, {"sxf_transferpitch", 512}, {"sxf_transferpointers", 1024},
    {"sxf_usebloodcolor", 2048}, {"sxf_clearcallertid", 4096}, {"sxf_multiplyspeed", 8192},
    {"sxf_transferscale", 16384}, {"sxf_transferspecial", 32768}, {"sxf_clearcallerspecial", 65536},
    {"sxf_transferstencilcol", 131072}, {"sxf_transferalpha", 262144}, {"sxf_transferrenderstyle", 524288},
    {"sxf_settarget", 1048576}, {"sxf_settracer", 2097152}, {"sxf_nopointers", 4194304},
    {"sxf_originator", 8388608}, {"sxf_transferspriteframe", 16777216}, {"sxf_transferroll", 33554432},
    {"sxf_istarget", 67108864}, {"sxf_ismaster", 134217728}, {"sxf_istracer", 268435456},
    // CustomMissile, SpawnProjectile
    {"cmf_aimoffset", 1}, {"cmf_aimdirection", 2}, {"cmf_trackowner", 4}, {"cmf_checktargetdead", 8},
    {"cmf_absolutepitch", 16}, {"cmf_offsetpitch", 32}, {"cmf_savepitch", 64}, {"cmf_absoluteangle", 128},
    // CustomBulletAttack, FireBullets
    {"cbaf_aimfacing", 1}, {"cbaf_norandom", 2}, {"cbaf_explicitangle", 4}, {"cbaf_norandompuffz", 8},
    {"fbf_useammo", 1}, {"fbf_norandom", 2}, {"fbf_explicitangle", 4}, {"fbf_nopitch", 8}, {"fbf_noflash", 16},
    {"fbf_norandompuffz", 32},
    // FireCustomMissile, CustomPunch, Saw, RailAttack
    {"fpf_aimatangle", 1}, {"fpf_transfertranslation", 2}, {"fpf_noautoaim", 4},
    {"cpf_useammo", 1}, {"cpf_dagger", 2}, {"cpf_pullin", 4}, {"cpf_norandompuffz", 8}, {"cpf_noturn", 16},
    {"sf_norandom", 1}, {"sf_randomlightmiss", 2}, {"sf_randomlighthit", 4}, {"sf_randomlightboth", 6},
    {"sf_nouseammomiss", 8}, {"sf_nouseammo", 16}, {"sf_nopullin", 32}, {"sf_noturn", 64},
    {"rgf_silent", 1}, {"rgf_nopiercing", 2}, {"rgf_explicitangle", 4}, {"rgf_fullbright", 8},
    {"rgf_centerz", 16}, {"rgf_norandompuffz", 32},
    // WeaponReady, GunFlash, CheckForReload
    {"wrf_nobob", 1}, {"wrf_noswitch", 2}, {"wrf_noprimary", 4}, {"wrf_nosecondary", 8}, {"wrf_nofire", 12},
    {"wrf_allowreload", 16}, {"wrf_allowzoom", 32}, {"wrf_disableswitch", 64}, {"gff_noextchange", 1},
    // Explode, RadiusThrust
    {"xf_hurtsource", 1}, {"xf_notmissile", 4}, {"rtf_affectsource", 1}, {"rtf_noimpactdamage", 2},
    {"rtf_notmissile", 4},
    // JumpIfTargetInLOS
    {"jlosf_projectile", 1}, {"jlosf_nosight", 2}, {"jlosf_closenofov", 4}, {"jlosf_closenosight", 8},
    {"jlosf_closenojump", 16}, {"jlosf_deadnojump", 32}, {"jlosf_checkmaster", 64}, {"jlosf_targetlos", 128},
    {"jlosf_fliptarget", 256}, {"jlosf_allyonlyjump", 512}, {"jlosf_combatantonly", 1024},
    {"jlosf_noaimstrict", 2048}, {"jlosf_checktracer", 4096},
    // Pointers to other actors
    {"aaptr_default", 0}, {"aaptr_null", 1}, {"aaptr_target", 2}, {"aaptr_master", 4}, {"aaptr_tracer", 8},
    {"aaptr_player_gettarget", 16}, {"aaptr_player_getconversation", 32}, {"aaptr_player1", 64},
    {"aaptr_player2", 128}, {"aaptr_player3", 256}, {"aaptr_player4", 512}, {"aaptr_player5", 1024},
    {"aaptr_player6", 2048}, {"aaptr_player7", 4096}, {"aaptr_player8", 8192}, {"aaptr_friendplayer", 16384},
    {"aaptr_linetarget", 32768},
    // ChangeVelocity, Warp, Seeker
    {"cvf_relative", 1}, {"cvf_replace", 2},
    {"warpf_absoluteoffset", 1}, {"warpf_absoluteangle", 2}, {"warpf_usecallerangle", 4},
    {"warpf_nocheckposition", 8}, {"warpf_interpolate", 16}, {"warpf_warpinterpolation", 32},
    {"warpf_copyinterpolation", 64}, {"warpf_stop", 128}, {"warpf_tofloor", 256}, {"warpf_testonly", 512},
    {"smf_look", 1}, {"smf_precise", 2}, {"smf_curspeed", 4},
    // Others
    {"styl_translucent", 0}, {"styl_add", 1}, {"styl_fuzzy", 2}, {"style_translucent", 3}, {"style_add", 5},
    {"amf_targetemitter", 1}, {"amf_targetnonplayer", 2}, {"amf_emitfromtarget", 4},
    {"rsf_fog", 1}, {"rsf_keeptarget", 2}, {"rsf_telefrag", 4},
    {"chan_auto", 0}, {"chan_weapon", 1}, {"chan_voice", 2}, {"chan_item", 3}, {"chan_body", 4},
    {"chan_5", 5}, {"chan_6", 6}, {"chan_7", 7}, {"chan_looping", 256}, {"attn_none", 0}, {"attn_norm", 1},
    {"attn_idle", 1}, {"attn_static", 3}, {"ptrop_nosafeguards", 1}, {"xxf_none", 0},
    {"kilf_foilinvul", 1}, {"kilf_killmissiles", 2}, {"kilf_nomonsters", 4}, {"rmvf_missiles", 1},
    {"rmvf_nomonsters", 2}, {"rmvf_misc", 4}, {"rmvf_everything", 8}, {"dmss_foilinvul", 1},
    {"dmss_affectarmor", 2}, {"dmss_kill", 4}, {"ftf_remove", 1}, {"ftf_clamp", 2}, {"spf_forceclamp", 1},
    {"spf_interpolate", 2},
};
// clang-format on

template <typename Value, std::size_t kSize>
std::optional<Value> find_in(const std::pair<std::string_view, Value> (&table)[kSize],
                             std::string_view name) {
  for (const auto& [known, value] : table)
    if (same_ignoring_case(known, name)) return value;
  return std::nullopt;
}

std::string_view without_prefix(std::string_view name) {
  const std::size_t dot = name.rfind('.');
  return dot == std::string_view::npos ? name : name.substr(dot + 1);
}

}  // namespace

std::optional<ActorFlag> find_flag(std::string_view name) { return find_in(kFlags, without_prefix(name)); }

bool has_effect(ActorFlag flag) {
  switch (flag) {
    case kBounceOnWalls:
    case kBounceOnFloors:
    case kPushable:
    case kCannotPush:
    case kExplodeOnWater:
    case kHitTarget:
    case kHitTracer:
    case kStrifeDamage:
      return false;
    default:
      return true;
  }
}

bool is_idle_flag(std::string_view name) {
  const std::string_view bare = without_prefix(name);
  return std::any_of(std::begin(kIdleFlags), std::end(kIdleFlags),
                     [bare](std::string_view known) { return same_ignoring_case(known, bare); });
}

std::optional<DamageType> find_damage_type(std::string_view name) { return find_in(kDamageTypes, name); }

std::string_view damage_type_name(DamageType type) {
  for (const auto& [name, known] : kDamageTypes)
    if (known == type && name != "none") return name;
  return {};
}

std::optional<RenderStyle> find_render_style(std::string_view name) {
  if (name.size() > 6 && same_ignoring_case(name.substr(0, 6), "style_")) name.remove_prefix(6);
  return find_in(kStyles, name);
}

std::optional<PowerKind> find_power(std::string_view name) {
  if (name.size() > 5 && same_ignoring_case(name.substr(0, 5), "power")) name.remove_prefix(5);
  return find_in(kPowers, name);
}

std::optional<int32_t> find_constant(std::string_view name) { return find_in(kConstants, name); }

}  // namespace comrad::doom
