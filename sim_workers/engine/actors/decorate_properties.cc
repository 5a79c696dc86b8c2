#include "sim_workers/engine/actors/decorate_properties.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <unordered_map>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/actors/flag_names.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;
using Kind = DecorateValue::Kind;

constexpr std::size_t kListMax = 64;  // drop items, start items
constexpr int32_t kTicsPerSecond = 35;
constexpr Fixed kLengthMax = to_fixed(8192);

/// A property's values while its handler reads them. The first mistake is kept.
class Values {
 public:
  Values(PropertyTarget* target, std::span<const DecorateValue> values) : target_(*target), values_(values) {}

  ActorType& type() { return *target_.type; }
  ActorCatalog& catalog() { return *target_.catalog; }
  PropertyTarget& target() { return target_; }
  std::size_t count() const { return values_.size(); }
  bool is_text(std::size_t index) const {
    return index < values_.size() && values_[index].kind == Kind::kText;
  }
  const DecorateValue& value(std::size_t index) const { return values_[index]; }

  int32_t integer(std::size_t index = 0) { return number(index) ? values_[index].integer() : 0; }
  int32_t integer_from(int32_t lowest, int32_t highest, std::size_t index = 0) {
    return std::clamp(integer(index), lowest, highest);
  }
  Fixed fixed(std::size_t index = 0) { return number(index) ? values_[index].fixed() : 0; }
  /// Of lengths: not below zero.
  Fixed size(std::size_t index = 0) { return std::max(fixed(index), 0); }
  /// Of bodies: two of them, one after the other, stay within what a Fixed can say.
  Fixed length(std::size_t index = 0) { return std::min(size(index), kLengthMax); }
  float real(std::size_t index = 0) {
    return number(index) ? static_cast<float>(std::clamp(values_[index].number, -65536.0, 65536.0)) : 0.0f;
  }
  std::string_view text(std::size_t index = 0) {
    // "None" is a number to action functions and a word here.
    if (index < values_.size() && (is_text(index) || values_[index].name)) return values_[index].text;
    fail("a word is missing");
    return {};
  }
  /// kNoType for "None", "" and unknown names; the latter are warned about.
  uint32_t class_named(std::size_t index = 0) {
    const std::string_view name = text(index);
    if (name.empty() || same_ignoring_case(name, "none")) return kNoType;
    if (const std::optional<uint32_t> found = target_.catalog->find(name)) return *found;
    target_.warn("unknown actor '" + std::string(name) + "'");
    return kNoType;
  }
  std::optional<DamageType> damage_type(std::size_t index = 0) {
    const std::string_view name = text(index);
    if (error) return std::nullopt;
    const std::optional<DamageType> type = target_.catalog->add_damage_type(name);
    if (!type)
      target_.warn("damage type '" + std::string(name) + "' is one more than the 16 of a lump's own");
    return type;
  }
  void fail(const std::string& what) {
    if (!error) error = what;
  }

  std::optional<std::string> error;

 private:
  bool number(std::size_t index) {
    if (index < values_.size() && values_[index].kind != Kind::kText) return true;
    fail("a number is missing");
    return false;
  }

  PropertyTarget& target_;
  std::span<const DecorateValue> values_;
};

using Handler = void (*)(Values&);

struct Property {
  Handler apply;  ///< null: read and left alone
  PropertyShape shape = PropertyShape::kValues;
};

void set_all(ActorType* type, std::initializer_list<ActorFlag> flags) {
  for (const ActorFlag flag : flags) type->flags.set(flag);
}

void set_damage(Values& values) {
  // "Damage 3" is 3 times a draw of 1 to 8, "Damage (40)" is 40.
  if (values.count() == 0) return values.fail("a number is missing");
  const DecorateValue& value = values.value(0);
  if (value.kind == Kind::kRandom) {
    const double factor = std::abs(value.step);
    if (value.number == factor && value.high == 8 * factor) {
      values.type().damage = {static_cast<int32_t>(std::clamp(factor, 0.0, 1e6)), false};
      return;
    }
    values.target().warn("Damage with a draw other than 1 to 8: its mean is dealt");
    values.type().damage = {static_cast<int32_t>(std::clamp((value.number + value.high) / 2, 0.0, 1e6)),
                            true};
    return;
  }
  values.type().damage = {values.integer_from(0, 1000000), value.in_parentheses};
}

void set_damage_factor(Values& values) {
  if (values.count() == 1 && !values.is_text(0)) {
    values.type().general_damage_factor = values.size();
    return;
  }
  const std::optional<DamageType> kind = values.damage_type(0);
  const Fixed factor = values.size(1);
  if (!kind) return;
  values.type().damage_factor[static_cast<std::size_t>(*kind)] = factor;
}

void set_pain_chance(Values& values) {
  if (values.is_text(0)) {
    const std::optional<DamageType> kind = values.damage_type(0);
    const int32_t chance = values.integer_from(0, 256, 1);
    if (!kind || values.error) return;
    for (auto& [type, own] : values.type().pain_chances)
      if (type == *kind) {
        own = chance;
        return;
      }
    values.type().pain_chances.emplace_back(*kind, chance);
    return;
  }
  values.type().pain_chance = values.integer_from(0, 256);
}

void add_drop_item(Values& values) {
  if (!values.target().own_drops) values.type().drop_items.clear();
  values.target().own_drops = true;
  const uint32_t item = values.class_named();
  if (item == kNoType || values.type().drop_items.size() >= kListMax) return;
  values.type().drop_items.push_back({.type = item,
                                      .chance = values.count() > 1 ? values.integer(1) : 255,
                                      .amount = values.count() > 2 ? values.integer(2) : -1});
}

void add_start_item(Values& values) {
  if (!values.target().own_start_items) values.type().start_items.clear();
  values.target().own_start_items = true;
  const uint32_t item = values.class_named();
  if (item == kNoType || values.type().start_items.size() >= kListMax) return;
  values.type().start_items.push_back({.type = item, .amount = values.count() > 1 ? values.integer(1) : 1});
}

void set_weapon_slot(Values& values) {
  const int32_t slot = values.integer_from(0, 9);
  for (std::size_t index = 1; index < values.count() && index <= kListMax; ++index) {
    const uint32_t weapon = values.class_named(index);
    if (weapon == kNoType) continue;
    WeaponInfo& info = values.catalog().edit(weapon).weapon;
    info.slot = slot, info.slot_priority = static_cast<int32_t>(index), info.slot_of_player = true;
  }
}

/// One colour: "rr gg bb", "#rrggbb" or three numbers. False where it is neither.
bool read_color(Values& values, std::size_t* index, std::array<uint8_t, 3>* color) {
  if (!values.is_text(*index)) {
    for (std::size_t part = 0; part < 3; ++part)
      (*color)[part] = static_cast<uint8_t>(values.integer_from(0, 255, *index + part));
    *index += 3;
    return !values.error;
  }
  std::string digits;
  const std::string& text = values.value((*index)++).text;
  std::size_t in_group = 0;
  for (const char letter : text) {
    const bool is_hex =
        (letter >= '0' && letter <= '9') || (lower_case(letter) >= 'a' && lower_case(letter) <= 'f');
    if (is_hex) {
      digits += letter, ++in_group;
    } else {
      if (in_group == 1) digits.insert(digits.size() - 1, "0");
      in_group = 0;
    }
  }
  if (in_group == 1) digits.insert(digits.size() - 1, "0");
  if (digits.size() < 6) return false;
  for (std::size_t part = 0; part < 3; ++part)
    std::from_chars(digits.data() + 2 * part, digits.data() + 2 * part + 2, (*color)[part], 16);
  return true;
}

void set_blood_color(Values& values) {
  std::size_t index = 0;
  if (!read_color(values, &index, &values.type().blood_color) && !values.error)
    values.target().warn("colour '" + std::string(values.text()) + "'");
}

void set_power_color(Values& values) {
  std::array<uint8_t, 3> color{};
  std::size_t index = 0;
  if (!read_color(values, &index, &color)) {
    if (!values.error) values.target().warn("colour '" + std::string(values.text()) + "'");
    return;
  }
  const float strength = index < values.count() ? values.real(index) : 1.0f / 3.0f;
  values.type().power_color = {color[0], color[1], color[2],
                               static_cast<uint8_t>(std::clamp(strength, 0.0f, 1.0f) * 255.0f)};
}

void set_power_type(Values& values) {
  const std::string_view name = values.text();
  if (const std::optional<PowerKind> kind = find_power(name)) {
    values.type().power = *kind;
    // Lasts and looks like the power itself, until the giver changes it.
    for (uint32_t index = 0; index < values.catalog().size(); ++index) {
      const ActorType& power = values.catalog()[index];
      if (power.power != *kind || power.item_class != ItemClass::kPowerup || !power.name.starts_with("Power"))
        continue;
      values.type().power_tics = power.power_tics, values.type().power_color = power.power_color;
      return;
    }
    return;
  }
  std::string full(name);
  if (!values.catalog().find(full)) full = "Power" + full;
  const std::optional<uint32_t> own = values.catalog().find(full);
  if (!own || values.catalog()[*own].power == PowerKind::kNone)
    return values.target().warn("power '" + std::string(name) + "'");
  const ActorType& power = values.catalog()[*own];
  values.type().power = power.power;
  values.type().power_tics = power.power_tics, values.type().power_color = power.power_color;
}

void set_power_duration(Values& values) {
  // Below zero: seconds.
  const int64_t duration = values.integer();
  const int64_t tics = duration < 0 ? -duration * kTicsPerSecond : duration;
  values.type().power_tics = tics >= INT32_MAX ? -1 : static_cast<int32_t>(tics);
}

void set_bounce_type(Values& values) {
  const std::string_view kind = values.text();
  const bool bounces = !same_ignoring_case(kind, "none");
  if (bounces) values.target().warn("BounceType: nothing bounces here");
  values.type().flags.set(kBounceOnFloors, bounces);
  values.type().flags.set(kBounceOnWalls, bounces && !same_ignoring_case(kind, "doomcompat"));
  if (values.type().bounce_factor == kFracUnit)
    values.type().bounce_factor = values.type().wall_bounce_factor = static_cast<Fixed>(0.7 * kFracUnit);
}

/// Reads "a:b=c:d" into `table`. False where it is something else.
bool read_range(std::string_view text, std::array<uint8_t, 256>* table) {
  std::array<int, 4> numbers{};
  constexpr std::string_view kBetween = ":=:";
  const char* place = text.data();
  const char* end = text.data() + text.size();
  for (std::size_t index = 0; index < numbers.size(); ++index) {
    while (place < end && *place == ' ') ++place;
    const auto [after, error] = std::from_chars(place, end, numbers[index]);
    if (error != std::errc() || numbers[index] < 0 || numbers[index] > 255) return false;
    place = after;
    while (place < end && *place == ' ') ++place;
    if (index < 3 && (place == end || *place++ != kBetween[index])) return false;
  }
  if (place != end) return false;
  auto [from, to, first, last] = numbers;
  if (from > to) std::swap(from, to), std::swap(first, last);
  for (int color = from; color <= to; ++color)
    (*table)[static_cast<std::size_t>(color)] =
        static_cast<uint8_t>(to == from ? first : first + (last - first) * (color - from) / (to - from));
  return true;
}

void set_translation(Values& values) {
  std::array<uint8_t, 256> table = values.catalog().translation(0);
  if (!values.is_text(0)) {
    // The players' green becomes grey, brown or red.
    constexpr std::array<uint8_t, 3> kFirst = {0x60, 0x40, 0x20};
    const int32_t number = values.integer();
    if (number < 0 || number > 2) return values.target().warn(fmt::format("Translation {}", number));
    for (uint8_t shade = 0; shade < 16; ++shade)
      table[0x70u + shade] = static_cast<uint8_t>(kFirst[static_cast<std::size_t>(number)] + shade);
  } else {
    if (same_ignoring_case(values.text(), "none") || values.text().empty()) {
      values.type().translation = 0;
      return;
    }
    for (std::size_t index = 0; index < values.count(); ++index) {
      const std::string_view text = values.text(index);
      for (std::size_t start = 0; start <= text.size();) {
        const std::size_t comma = std::min(text.find(',', start), text.size());
        if (!read_range(text.substr(start, comma - start), &table)) {
          values.target().warn("Translation \"" + std::string(text) + "\"");
          break;
        }
        start = comma + 1;
      }
    }
  }
  const uint8_t added = values.catalog().add_translation(table);
  if (added == 0 && table != values.catalog().translation(0))
    values.target().warn("one more Translation than the 255 there may be");
  values.type().translation = added;
}

void set_render_style(Values& values) {
  const std::optional<RenderStyle> style = find_render_style(values.text());
  if (!style) return values.target().warn("RenderStyle '" + std::string(values.text()) + "'");
  values.type().render_style = *style;
}

void make_monster(Values& values) {
  set_all(&values.type(),
          {kSolid, kShootable, kCountKill, kIsMonster, kCanPass, kCanUseWalls, kPushWall, kActivateCross});
}

void make_projectile(Values& values) {
  set_all(&values.type(),
          {kNoBlockmap, kNoGravity, kDropOff, kMissile, kActivateImpact, kActivateCross, kNoTeleport});
}

const std::unordered_map<std::string_view, Property>& properties() {
  static const std::unordered_map<std::string_view, Property> all = [] {
    std::unordered_map<std::string_view, Property> table = {
        // The body.
        {"health", {[](Values& v) { v.type().health = v.integer(); }}},
        {"gibhealth",
         {[](Values& v) { v.type().gib_health = -std::abs(v.integer_from(-1000000, 1000000)); }}},
        {"radius", {[](Values& v) { v.type().radius = v.length(); }}},
        {"height", {[](Values& v) { v.type().height = v.length(); }}},
        {"deathheight", {[](Values& v) { v.type().death_height = v.length(); }}},
        {"projectilepassheight", {[](Values& v) { v.type().projectile_pass_height = v.fixed(); }}},
        {"mass", {[](Values& v) { v.type().mass = v.integer_from(1, INT32_MAX); }}},
        {"speed", {[](Values& v) { v.type().speed = v.fixed(); }}},
        {"fastspeed", {[](Values& v) { v.type().fast_speed = v.fixed(); }}},
        {"floatspeed", {[](Values& v) { v.type().float_speed = v.fixed(); }}},
        {"gravity", {[](Values& v) { v.type().gravity = v.size(); }}},
        {"maxstepheight", {[](Values& v) { v.type().max_step_height = v.length(); }}},
        {"maxdropoffheight", {[](Values& v) { v.type().max_dropoff_height = v.length(); }}},
        {"bouncefactor", {[](Values& v) { v.type().bounce_factor = v.size(); }}},
        {"wallbouncefactor", {[](Values& v) { v.type().wall_bounce_factor = v.size(); }}},
        {"bouncecount", {[](Values& v) { v.type().bounce_count = v.integer_from(0, 100000); }}},
        {"bouncetype", {set_bounce_type}},
        {"args", {[](Values& v) {
           for (std::size_t i = 0; i < std::min<std::size_t>(v.count(), 5); ++i)
             v.type().args[i] = v.integer(i);
           v.type().keeps_args = true;
         }}},
        {"conversationid", {[](Values& v) { v.type().conversation_id = v.integer(); }}},
        {"spawnid", {[](Values& v) { v.type().spawn_id = v.integer_from(0, 65535); }}},
        // Harm.
        {"damage", {set_damage}},
        {"damagetype",
         {[](Values& v) { v.type().damage_type = v.damage_type().value_or(DamageType::kNormal); }}},
        {"damagefactor", {set_damage_factor}},
        {"painchance", {set_pain_chance}},
        {"painthreshold", {[](Values& v) { v.type().pain_threshold = v.integer(); }}},
        {"bloodtype", {[](Values& v) { v.type().blood_type = v.class_named(); }}},
        {"bloodcolor", {set_blood_color}},
        {"dropitem", {add_drop_item}},
        // Monsters.
        {"reactiontime", {[](Values& v) { v.type().reaction_tics = v.integer_from(0, 1000000); }}},
        {"meleerange", {[](Values& v) { v.type().melee_range = v.size(); }}},
        {"maxtargetrange", {[](Values& v) { v.type().max_target_range = v.size(); }}},
        {"meleethreshold", {[](Values& v) { v.type().melee_threshold = v.size(); }}},
        {"minmissilechance", {[](Values& v) { v.type().min_missile_chance = v.integer_from(0, 256); }}},
        {"meleedamage", {[](Values& v) { v.type().melee_damage = v.integer_from(0, 1000000); }}},
        {"species", {[](Values& v) {
           const std::string_view name = v.text();
           if (const std::optional<uint32_t> found = v.catalog().find(name)) {
             v.type().species = *found;
           } else if (!v.error) {
             v.target().warn("Species '" + std::string(name) + "', which is no actor");
           }
         }}},
        {"monster", {make_monster, PropertyShape::kNoValues}},
        {"projectile", {make_projectile, PropertyShape::kNoValues}},
        {"clearflags", {[](Values& v) { v.type().flags = {}; }, PropertyShape::kNoValues}},
        // Pictures.
        {"scale", {[](Values& v) { v.type().scale_x = v.type().scale_y = v.real(); }}},
        {"xscale", {[](Values& v) { v.type().scale_x = v.real(); }}},
        {"yscale", {[](Values& v) { v.type().scale_y = v.real(); }}},
        {"alpha", {[](Values& v) { v.type().alpha = std::clamp(v.real(), 0.0f, 1.0f); }}},
        {"defaultalpha", {[](Values& v) { v.type().alpha = 0.6f; }, PropertyShape::kNoValues}},
        {"renderstyle", {set_render_style}},
        {"translation", {set_translation}},
        // Items.
        {"inventory.amount", {[](Values& v) { v.type().amount = v.integer(); }}},
        {"inventory.maxamount", {[](Values& v) { v.type().max_amount = v.integer(); }}},
        {"inventory.defmaxamount", {[](Values& v) { v.type().max_amount = 25; }, PropertyShape::kNoValues}},
        {"inventory.interhubamount", {[](Values& v) { v.type().inter_hub_amount = v.integer(); }}},
        {"inventory.respawntics", {[](Values& v) { v.type().respawn_tics = v.integer_from(0, INT32_MAX); }}},
        {"armor.saveamount", {[](Values& v) { v.type().save_amount = v.integer_from(0, 1000000); }}},
        {"armor.maxsaveamount", {[](Values& v) { v.type().max_save_amount = v.integer_from(0, 1000000); }}},
        {"armor.savepercent", {[](Values& v) {
           v.type().save_percent =
               static_cast<Fixed>(std::clamp<int64_t>(v.fixed() / int64_t{100}, 0, kFracUnit));
         }}},
        {"ammo.backpackamount", {[](Values& v) { v.type().backpack_amount = v.integer_from(0, INT32_MAX); }}},
        {"ammo.backpackmaxamount",
         {[](Values& v) { v.type().backpack_max_amount = v.integer_from(0, INT32_MAX); }}},
        {"ammo.dropamount", {[](Values& v) { v.type().drop_amount = v.integer_from(0, INT32_MAX); }}},
        {"powerup.type", {set_power_type}},
        {"powerup.duration", {set_power_duration}},
        {"powerup.color", {set_power_color}},
        // Weapons.
        {"weapon.ammotype", {[](Values& v) { v.type().weapon.ammo_type = v.class_named(); }}},
        {"weapon.ammotype2", {[](Values& v) { v.type().weapon.ammo_type_2 = v.class_named(); }}},
        {"weapon.ammouse", {[](Values& v) { v.type().weapon.ammo_use = v.integer_from(0, 1000000); }}},
        {"weapon.ammouse2", {[](Values& v) { v.type().weapon.ammo_use_2 = v.integer_from(0, 1000000); }}},
        {"weapon.ammogive", {[](Values& v) { v.type().weapon.ammo_give = v.integer_from(0, 1000000); }}},
        {"weapon.ammogive2", {[](Values& v) { v.type().weapon.ammo_give_2 = v.integer_from(0, 1000000); }}},
        {"weapon.selectionorder", {[](Values& v) { v.type().weapon.selection_order = v.integer(); }}},
        {"weapon.slotnumber", {[](Values& v) {
           WeaponInfo& weapon = v.type().weapon;
           weapon.slot = v.integer_from(-1, 9), weapon.slot_of_player = false;
           if (weapon.slot_priority < kFracUnit / 2) weapon.slot_priority = INT32_MAX;
         }}},
        {"weapon.slotpriority", {[](Values& v) { v.type().weapon.slot_priority = v.fixed(); }}},
        {"weapon.kickback", {[](Values& v) { v.type().weapon.kickback = v.integer_from(0, 100000); }}},
        {"weapon.defaultkickback",
         {[](Values& v) { v.type().weapon.kickback = 100; }, PropertyShape::kNoValues}},
        {"weapon.yadjust", {[](Values& v) { v.type().weapon.y_adjust = v.fixed(); }}},
        // Players.
        {"player.jumpz", {[](Values& v) { v.type().jump_speed = v.fixed(); }}},
        {"player.viewheight", {[](Values& v) { v.type().view_height = v.length(); }}},
        {"player.attackzoffset", {[](Values& v) { v.type().attack_z_offset = v.fixed(); }}},
        {"player.maxhealth", {[](Values& v) { v.type().health = v.integer_from(1, 1000000); }}},
        {"player.forwardmove", {[](Values& v) {
           v.type().forward_move = {v.fixed(), v.count() > 1 ? v.fixed(1) : v.fixed()};
         }}},
        {"player.sidemove", {[](Values& v) {
           v.type().side_move = {v.fixed(), v.count() > 1 ? v.fixed(1) : v.fixed()};
         }}},
        {"player.startitem", {add_start_item}},
        {"player.weaponslot", {set_weapon_slot}},
    };
    table["weapon.ammotype1"] = table["weapon.ammotype"];
    table["weapon.ammouse1"] = table["weapon.ammouse"];
    table["weapon.ammogive1"] = table["weapon.ammogive"];
    // Sounds, words on the screen, other games: read and left alone.
    for (const std::string_view name : {"tag",
                                        "obituary",
                                        "hitobituary",
                                        "seesound",
                                        "deathsound",
                                        "painsound",
                                        "activesound",
                                        "attacksound",
                                        "bouncesound",
                                        "wallbouncesound",
                                        "crushpainsound",
                                        "meleesound",
                                        "howlsound",
                                        "game",
                                        "decal",
                                        "activation",
                                        "stencilcolor",
                                        "explosionradius",
                                        "explosiondamage",
                                        "distancecheck",
                                        "spritefile",
                                        "burnheight",
                                        "cameraheight",
                                        "visibleangles",
                                        "visiblepitch",
                                        "designatedteam",
                                        "vspeed",
                                        "woundhealth",
                                        "poisondamage",
                                        "radiusdamagefactor",
                                        "selfdamagefactor",
                                        "telefogsourcetype",
                                        "telefogdesttype",
                                        "ripperlevel",
                                        "ripperlevelmin",
                                        "ripperlevelmax",
                                        "pushfactor",
                                        "accuracy",
                                        "stamina",
                                        "inventory.pickupmessage",
                                        "inventory.pickupsound",
                                        "inventory.pickupflash",
                                        "inventory.usesound",
                                        "inventory.icon",
                                        "inventory.giverquest",
                                        "inventory.forbiddento",
                                        "inventory.restrictedto",
                                        "inventory.althudicon",
                                        "armor.maxbonus",
                                        "armor.maxbonusmax",
                                        "health.lowmessage",
                                        "healthpickup.autouse",
                                        "weapon.readysound",
                                        "weapon.upsound",
                                        "weapon.sisterweapon",
                                        "weapon.bobstyle",
                                        "weapon.bobspeed",
                                        "weapon.bobrangex",
                                        "weapon.bobrangey",
                                        "weapon.minselectionammo1",
                                        "weapon.minselectionammo2",
                                        "weapon.preferredskin",
                                        "powerup.colormap",
                                        "powerup.mode",
                                        "powerup.strength",
                                        "puzzleitem.number",
                                        "puzzleitem.failmessage",
                                        "player.displayname",
                                        "player.soundclass",
                                        "player.face",
                                        "player.portrait",
                                        "player.scoreicon",
                                        "player.colorrange",
                                        "player.colorset",
                                        "player.colorsetfile",
                                        "player.clearcolorset",
                                        "player.damagescreencolor",
                                        "player.crouchsprite",
                                        "player.spawnclass",
                                        "player.runhealth",
                                        "player.aircapacity",
                                        "player.flechettetype",
                                        "player.gruntspeed",
                                        "player.fallingscreamspeed",
                                        "player.healradiustype",
                                        "player.hexenarmor",
                                        "player.invulnerabilitymode",
                                        "player.morphweapon",
                                        "player.teleportfreezetime",
                                        "player.viewbob",
                                        "player.userange"})
      table.emplace(name, Property{nullptr});
    return table;
  }();
  return all;
}

}  // namespace

PropertyShape property_shape(std::string_view name) {
  const auto found = properties().find(name);
  return found == properties().end() ? PropertyShape::kUnknown : found->second.shape;
}

std::optional<std::string> apply_property(PropertyTarget* target, std::string_view name,
                                          std::span<const DecorateValue> values) {
  const auto found = properties().find(name);
  if (found == properties().end() || found->second.apply == nullptr) return std::nullopt;
  Values reader(target, values);
  found->second.apply(reader);
  return reader.error;
}

}  // namespace comrad::doom
