#include "sim_workers/engine/play/inventory.h"

#include <algorithm>
#include <array>
#include <optional>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/play/actions.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/weapons.h"

namespace comrad::doom {
namespace {

constexpr int32_t kAmountMax = INT32_MAX;
constexpr int32_t kPowerRefreshTics = 128;  // a power that lasts longer is not taken again
constexpr int32_t kItemReturnTics = 1050;   // of a deathmatch: 30 s
constexpr int kPickupStatesMax = 256;       // of a Pickup or Use sequence
constexpr std::size_t kInventoryReserve = 64;
constexpr int32_t kHealthMax = 100;

// Lock numbers of doors; the keys by class name, cards before skulls.
constexpr std::array<std::string_view, 6> kKeyNames = {"RedCard",  "BlueCard",  "YellowCard",
                                                       "RedSkull", "BlueSkull", "YellowSkull"};
constexpr int32_t kLockAny = 100, kLockAll = 101, kLockEitherFirst = 129, kLockEitherLast = 134,
                  kLockAnyToo = 228, kLockEachColor = 229;

// How an item comes to a player.
struct Giving {
  int32_t amount = 0;         ///< of the item
  bool exact = false;         ///< no skill factor
  bool by_script = false;     ///< GiveInventory: what is in the hand stays there
  bool from_monster = false;  ///< dropped: half of a weapon's ammunition
  bool without_ammo = false;  ///< start items: weapons come empty
  bool stays = false;         ///< of the map, in cooperative play
};

InventoryItem* find_item(Player& player, uint32_t type) {
  for (InventoryItem& item : player.inventory)
    if (item.type == type) return &item;
  return nullptr;
}

int32_t added(int32_t amount, int32_t more, int32_t limit) {
  return static_cast<int32_t>(std::min<int64_t>(int64_t{amount} + more, std::max(amount, limit)));
}

int32_t with_skill_factor(const World& world, int32_t amount, bool exact) {
  const bool doubles = !exact && (world.options().skill <= 1 || world.options().skill >= 5 ||
                                  world.has(wad::GameFlag::kDoubleAmmo));
  return doubles ? static_cast<int32_t>(std::min<int64_t>(int64_t{amount} * 2, kAmountMax)) : amount;
}

void set_health(World& world, Player& player, int32_t health) {
  player.health = health;
  if (Actor* body = world.actor(player.actor_id)) body->health = health;
}

InventoryItem& add_ammo_slot(World& world, Player& player, uint32_t type) {
  if (InventoryItem* item = find_item(player, type)) return *item;
  const ActorType& info = world.catalog()[type];
  const int32_t limit =
      player.has_backpack ? std::max(info.max_amount, info.backpack_max_amount) : info.max_amount;
  player.inventory.push_back({.type = type, .amount = 0, .max_amount = limit});
  return player.inventory.back();
}

/// Adds ammunition. False where there is no room for any.
bool give_ammo(World& world, int player_index, uint32_t type, int32_t amount, bool exact) {
  if (type == kNoType) return false;
  Player& player = player_at(world, player_index);
  const uint32_t base = ammo_base(world.catalog(), type);
  const bool is_new = find_item(player, base) == nullptr;
  InventoryItem& item = add_ammo_slot(world, player, base);
  if (!is_new && item.amount >= item.max_amount) return false;
  const int32_t before = item.amount;
  item.amount = added(before, with_skill_factor(world, std::max(amount, 0), exact), item.max_amount);
  if (!is_new && before == 0 && item.amount > 0) switch_for_ammo(world, player_index, base);
  return true;
}

bool give_weapon(World& world, int player_index, uint32_t type, const Giving& giving) {
  Player& player = player_at(world, player_index);
  const ActorType& info = world.catalog()[type];
  const bool exact = giving.exact || info.flags.has(ActorFlag::kIgnoreSkill);
  const auto ammo_of = [&](int32_t amount) {
    return giving.from_monster          ? amount / 2
           : world.options().deathmatch ? clamped_fixed(int64_t{amount} * 5 / 2)
                                        : amount;
  };
  InventoryItem* owned = find_item(player, type);
  if (owned != nullptr && owned->amount > 0) {
    // A second one is only its ammunition; one that stays for others is nothing.
    if (giving.stays || giving.without_ammo) return false;
    bool took = false;
    if (info.weapon.ammo_give > 0)
      took |= give_ammo(world, player_index, info.weapon.ammo_type, ammo_of(info.weapon.ammo_give), exact);
    if (info.weapon.ammo_give_2 > 0)
      took |=
          give_ammo(world, player_index, info.weapon.ammo_type_2, ammo_of(info.weapon.ammo_give_2), exact);
    if (owned->amount < owned->max_amount) {
      owned = find_item(player, type);
      owned->amount = added(owned->amount, giving.amount, owned->max_amount);
      took = true;
    }
    return took;
  }
  const bool had_weapon = player.ready_weapon != kNoType;
  if (owned == nullptr) {
    player.inventory.push_back({type, 0, std::max(info.max_amount, 1)});
    owned = &player.inventory.back();
  }
  owned->amount = std::clamp(giving.amount, 1, owned->max_amount);
  const uint32_t pending = player.pending_weapon;
  for (const auto& [ammo, amount] : {std::pair{info.weapon.ammo_type, info.weapon.ammo_give},
                                     std::pair{info.weapon.ammo_type_2, info.weapon.ammo_give_2}}) {
    if (ammo == kNoType) continue;
    InventoryItem& item = add_ammo_slot(world, player, ammo_base(world.catalog(), ammo));
    if (!giving.without_ammo)
      item.amount =
          added(item.amount, with_skill_factor(world, std::max(ammo_of(amount), 0), exact), item.max_amount);
  }
  // Scripts do not change what is in the hand, unless that is empty.
  player.pending_weapon = giving.by_script && had_weapon ? pending : type;
  return true;
}

bool give_health(World& world, Player& player, const ActorType& info, int32_t amount) {
  if (!player.alive || player.health <= 0) return false;
  int32_t limit = info.max_amount;
  if (limit <= 0) {
    const Actor* body = world.find_actor(player.actor_id);
    limit = body != nullptr && world.type_of(*body).is_player ? world.type_of(*body).health : kHealthMax;
  }
  if (amount < 0) {
    // A quirk of negative health: at least that many per cent of the limit.
    const auto least = static_cast<int32_t>(int64_t{limit} * -int64_t{amount} / 100);
    if (player.health >= least) return false;
    set_health(world, player, least);
    return true;
  }
  if (amount == 0 || player.health >= limit) return false;
  set_health(world, player, added(player.health, amount, limit));
  return true;
}

bool give_armor(World& world, Player& player, uint32_t type, int32_t count) {
  const ActorType& info = world.catalog()[type];
  const auto points =
      static_cast<int32_t>(std::min<int64_t>(int64_t{info.save_amount} * std::max(count, 1), 1'000'000));
  if (info.item_class == ItemClass::kArmorBonus) {
    const int32_t bonus = std::min(points, info.max_save_amount);
    if (bonus <= 0) return true;
    if (player.armor >= info.max_save_amount) return false;
    if (player.armor <= 0) player.armor = 0, player.armor_save = info.save_percent, player.armor_type = type;
    player.armor = added(player.armor, bonus, info.max_save_amount);
    return true;
  }
  if (player.armor >= points) return false;
  player.armor = points;
  player.armor_save = info.save_percent;
  player.armor_type = type;
  return true;
}

void start_power(World& world, Player& player, PowerKind kind) {
  Actor* body = world.actor(player.actor_id);
  if (body == nullptr) return;
  if (kind == PowerKind::kInvulnerable) body->set(ActorFlag::kInvulnerable);
  if (kind == PowerKind::kInvisibility) {
    body->set(ActorFlag::kShadow);
    body->render_style = RenderStyle::kFuzzy;
  }
  if (kind == PowerKind::kFlight) body->set(ActorFlag::kFly), body->set(ActorFlag::kNoGravity);
}

void end_power(World& world, Player& player, PowerKind kind) {
  Actor* body = world.actor(player.actor_id);
  if (body == nullptr || player.has_power(kind)) return;
  const ActorType& type = world.type_of(*body);
  const auto restore = [&](ActorFlag flag) { body->set(flag, type.flags.has(flag)); };
  if (kind == PowerKind::kInvulnerable) restore(ActorFlag::kInvulnerable);
  if (kind == PowerKind::kInvisibility) {
    restore(ActorFlag::kShadow);
    body->render_style = type.render_style;
  }
  if (kind == PowerKind::kFlight) restore(ActorFlag::kFly), restore(ActorFlag::kNoGravity);
}

bool give_power(World& world, int player_index, uint32_t type) {
  Player& player = player_at(world, player_index);
  const ActorType& info = world.catalog()[type];
  if (info.power == PowerKind::kNone) return false;
  // Strength and the map last for ever.
  const bool endless =
      info.power_tics <= 0 || info.power == PowerKind::kStrength || info.power == PowerKind::kAllMap;
  const int32_t tics = endless ? -1 : info.power_tics;
  if (info.power == PowerKind::kStrength && world.catalog().is_a(type, "Berserk")) {
    // Where Berserk is one item and not a chain of states: its healing and its fist.
    if (player.alive && player.health < kHealthMax) set_health(world, player, kHealthMax);
    const uint32_t fist = world.catalog().known().fist;
    if (fist != kNoType) select_weapon(world, player_index, fist);
  }
  for (Power& power : player.powers) {
    if (power.kind != info.power) continue;
    if (power.tics < 0) return true;
    if (tics < 0) {
      power.tics = tics;
    } else if (info.flags.has(ActorFlag::kAdditiveTime)) {
      power.tics = added(power.tics, tics, kAmountMax);
    } else if (power.tics > kPowerRefreshTics && !info.flags.has(ActorFlag::kAlwaysPickup)) {
      return false;
    } else {
      power.tics = std::max(power.tics, tics);
    }
    return true;
  }
  player.powers.push_back({info.power, type, tics});
  start_power(world, player, info.power);
  return true;
}

bool give_backpack(World& world, Player& player, bool depleted) {
  const ActorCatalog& catalog = world.catalog();
  player.has_backpack = true;
  for (uint32_t type = 0; type < catalog.size(); ++type) {
    const ActorType& info = catalog[type];
    if (info.item_class != ItemClass::kAmmo || info.backpack_max_amount <= 0) continue;
    if (ammo_base(catalog, type) != type) continue;
    InventoryItem& item = add_ammo_slot(world, player, type);
    item.max_amount = std::max(item.max_amount, info.backpack_max_amount);
    if (!depleted)
      item.amount = added(item.amount, with_skill_factor(world, std::max(info.backpack_amount, 0), false),
                          item.max_amount);
  }
  return true;
}

/// Questions and messages are no use of an item.
bool is_idle(ActionId action) {
  const std::string_view name = action_name(action);
  return name.starts_with("Jump") || name == "Log" || name.starts_with("Print");
}

/// Runs the actions of a sequence of states at once. True where one of them did something and it did not end with "fail".
bool run_sequence(World& world, int player_index, uint32_t state) {
  Player& player = player_at(world, player_index);
  Actor* body = world.actor(player.actor_id);
  if (body == nullptr) return false;
  bool succeeded = false;
  for (int left = kPickupStatesMax; left > 0 && state < world.catalog().state_count(); --left) {
    const State& entered = world.catalog().state(state);
    uint32_t next = entered.next;
    if (entered.action != ActionId::kNone) {
      ActionCall call{.world = world,
                      .self = *body,
                      .player = &player,
                      .layer = 0,
                      .state = entered,
                      .args = world.catalog().args(entered)};
      run_action(call);
      succeeded |= call.succeeded && !is_idle(entered.action);
      if (call.has_jump) next = call.jump;
    }
    if (entered.fails && next == kNoState) return false;
    if (next == state) break;
    state = next;
  }
  return succeeded;
}

bool give_kept(World& world, int player_index, uint32_t type, int32_t amount) {
  Player& player = player_at(world, player_index);
  const ActorType& info = world.catalog()[type];
  const bool used_at_once = info.flags.has(ActorFlag::kAutoActivate);
  if (info.max_amount <= 0) return used_at_once;
  InventoryItem* item = find_item(player, type);
  if (item == nullptr) {
    player.inventory.push_back({type, 0, info.max_amount});
    item = &player.inventory.back();
  } else if (item->amount >= item->max_amount) {
    return false;
  }
  item->amount = added(item->amount, std::max(amount, 1), item->max_amount);
  if (used_at_once) use_item(world, player_index, type);
  return true;
}

bool give(World& world, int player_index, uint32_t type, const Giving& giving) {
  Player& player = player_at(world, player_index);
  const ActorType& info = world.catalog()[type];
  switch (info.item_class) {
    case ItemClass::kNone:
      return false;
    case ItemClass::kHealth:
    case ItemClass::kMaxHealth:
      return give_health(world, player, info, giving.amount);
    case ItemClass::kArmor:
    case ItemClass::kArmorBonus:
      return give_armor(world, player, type, giving.amount);
    case ItemClass::kAmmo:
      return give_ammo(world, player_index, type, giving.amount,
                       giving.exact || info.flags.has(ActorFlag::kIgnoreSkill));
    case ItemClass::kWeapon:
      return give_weapon(world, player_index, type, giving);
    case ItemClass::kKey: {
      if (InventoryItem* key = find_item(player, type); key != nullptr && key->amount > 0)
        return !giving.stays;
      player.inventory.push_back({type, 1, 1});
      return true;
    }
    case ItemClass::kPowerup:
      if (info.flags.has(ActorFlag::kInvBar) && !info.flags.has(ActorFlag::kAutoActivate) &&
          info.max_amount > 0)
        return give_kept(world, player_index, type, giving.amount);
      return give_power(world, player_index, type);
    case ItemClass::kBackpack:
      return give_backpack(world, player, false);
    case ItemClass::kMap:
      if (!player.has_power(PowerKind::kAllMap)) player.powers.push_back({PowerKind::kAllMap, type, -1});
      return true;
    case ItemClass::kCustomInventory: {
      const uint32_t pickup = info.state(StateLabel::kPickup);
      const bool useful = pickup == kNoState || run_sequence(world, player_index, pickup);
      if (useful && info.state(StateLabel::kUse) != kNoState)
        return give_kept(world, player_index, type, giving.amount);
      return useful && pickup != kNoState;
    }
    case ItemClass::kInventory:
      return give_kept(world, player_index, type, giving.amount);
  }
  return false;
}

bool in_bar(const World& world, const InventoryItem& item) {
  return item.type < world.catalog().size() && world.catalog()[item.type].flags.has(ActorFlag::kInvBar);
}

/// Where the selected item of the inventory bar is: the first taken, unless a key chose another.
std::optional<std::size_t> selected_place(const World& world, const Player& player) {
  std::optional<std::size_t> first;
  for (std::size_t i = 0; i < player.inventory.size(); ++i) {
    if (player.inventory[i].type == player.selected_item) return i;
    if (!first && in_bar(world, player.inventory[i])) first = i;
  }
  return first;
}

/// Where a selected item goes, what was taken before it is selected next, else what was taken after it.
void remove_entry(const World& world, Player& player, uint32_t type) {
  if (type == player.selected_item) {
    uint32_t before = kNoType, after = kNoType;
    bool passed = false;
    for (const InventoryItem& item : player.inventory) {
      if (item.type == type) {
        passed = true;
      } else if (in_bar(world, item)) {
        if (!passed) before = item.type;
        if (passed && after == kNoType) after = item.type;
      }
    }
    player.selected_item = before != kNoType ? before : after;
  }
  std::erase_if(player.inventory, [type](const InventoryItem& item) { return item.type == type; });
}

bool holds_key(const Player& player, const ActorCatalog& catalog, std::size_t key) {
  for (const InventoryItem& item : player.inventory)
    if (item.amount > 0 && item.type < catalog.size() && catalog[item.type].item_class == ItemClass::kKey &&
        catalog.is_a(item.type, kKeyNames[key]))
      return true;
  return false;
}

bool in_range(const World& world, int player, uint32_t type) {
  return player >= 0 && player < world.player_count() && type < world.catalog().size();
}

/// Place of `type` among what a class begins with.
std::optional<std::size_t> start_place(const std::vector<DropItem>& start_items, uint32_t type) {
  for (std::size_t i = 0; i < start_items.size(); ++i)
    if (start_items[i].type == type) return i;
  return std::nullopt;
}

/// What `player` has again of what it had before it died: all but powers, and but what the game's flags take.
void keep_items(const World& world, const Player& before, const std::vector<DropItem>& start_items,
                Player& player) {
  using enum wad::GameFlag;
  const auto start_amount = [&](uint32_t type) {
    const auto place = start_place(start_items, type);
    return place ? std::max(start_items[*place].amount, 1) : 0;
  };
  player.has_backpack = before.has_backpack;
  if (!world.has(kLoseArmor))
    player.armor = before.armor, player.armor_save = before.armor_save, player.armor_type = before.armor_type;
  for (InventoryItem item : before.inventory) {
    const ItemClass kind = world.catalog()[item.type].item_class;
    if (kind == ItemClass::kKey && world.has(kLoseKeys)) continue;
    if (kind == ItemClass::kWeapon && world.has(kLoseWeapons) && start_amount(item.type) == 0) continue;
    if (kind == ItemClass::kAmmo) {
      if (world.has(kLoseAmmo)) item.amount = start_amount(item.type);
      if (world.has(kHalveAmmo)) item.amount = std::max(item.amount / 2, start_amount(item.type));
    }
    player.inventory.push_back(item);
  }
}

/// Whether ClearInventory, which begins with what was taken last, comes to another weapon after that in the hand. Of what a player
/// begins with the last counts as the first taken.
bool loses_others_after(const World& world, const Player& player) {
  const Actor* body = world.find_actor(player.actor_id);
  if (body == nullptr) return false;
  const auto order = [&](std::size_t index) {
    const auto place = start_place(world.type_of(*body).start_items, player.inventory[index].type);
    return place ? -static_cast<int64_t>(*place) - 1 : static_cast<int64_t>(index);
  };
  std::optional<int64_t> held, first;
  for (std::size_t i = 0; i < player.inventory.size(); ++i) {
    const InventoryItem& item = player.inventory[i];
    if (item.amount <= 0 || world.catalog()[item.type].item_class != ItemClass::kWeapon) continue;
    if (item.type == player.ready_weapon) held = order(i);
    first = std::min(first.value_or(order(i)), order(i));
  }
  return held && *first < *held;
}

/// Of the map, not of a script or a monster: an entry of THINGS stands where it was born.
bool is_of_the_map(const World& world, const Actor& item) {
  if (item.has(ActorFlag::kDropped) || item.has(ActorFlag::kTossed)) return false;
  for (const MapThing& thing : world.level().things) {
    if (thing.x != item.spawn_x || thing.y != item.spawn_y) continue;
    const std::optional<uint32_t> placed = world.catalog().find_editor_number(thing.editor_number);
    if (placed && (*placed == item.type || world.catalog().replacement(*placed) == item.type)) return true;
  }
  return false;
}

/// Out of sight and reach for half a minute.
void hide_item(Actor& item) {
  item.set(ActorFlag::kSpecial, false);
  item.set(ActorFlag::kNoGravity);
  item.render_style = RenderStyle::kNone;
  item.state = kNoState;
  item.tics = kItemReturnTics;
}

}  // namespace

bool within_reach(const Actor& body, const Actor& item) {
  return int64_t{item.z} - body.z <= body.height && body.z < item.top();
}

bool stays_for_others(const World& world, const Actor& item) {
  const ItemClass kind = world.type_of(item).item_class;
  const bool stays = kind == ItemClass::kWeapon
                         ? world.is_multiplayer() || world.has(wad::GameFlag::kWeaponsStay)
                         : kind == ItemClass::kKey && world.is_multiplayer();
  return stays && is_of_the_map(world, item);
}

bool touch_item(World& world, Actor& body, Actor& item) {
  if (item.removed || body.player_index < 0 || !within_reach(body, item)) return false;
  const int player_index = body.player_index;
  Player& player = player_at(world, player_index);
  if (!player.alive) return false;
  const ActorType& type = world.type_of(item);
  const bool stays = stays_for_others(world, item);
  const bool dropped = item.has(ActorFlag::kDropped);
  bool taken =
      give(world, player_index, item.type,
           {.amount = item.amount,
            .from_monster = dropped && !item.has(ActorFlag::kTossed) && !item.has(ActorFlag::kScriptSpawned),
            .without_ammo = item.has(ActorFlag::kTossed) && type.item_class == ItemClass::kWeapon,
            .stays = stays});
  if (!taken && type.flags.has(ActorFlag::kAlwaysPickup) && !stays) taken = true;
  if (!taken) return false;

  if (!item.has(ActorFlag::kQuiet) && !item.has(ActorFlag::kNoScreenFlash))
    player.bonus_flash += kBonusFlashTics;
  ++player.pickup_count;
  if (item.has(ActorFlag::kCountItem)) {
    ++player.item_count;
    ++world.state().item_taken;
    item.set(ActorFlag::kCountItem, false);
  }
  if (item.has(ActorFlag::kCountSecret)) {
    ++player.secret_count;
    ++world.state().secret_found;
    item.set(ActorFlag::kCountSecret, false);
  }
  // The special is an item's message to scripts. It may move and remove things: the item leaves first.
  if (!stays) {
    const bool returns = world.has(wad::GameFlag::kItemsReturn) &&
                         (!type.flags.has(ActorFlag::kBigPowerup) || world.has(wad::GameFlag::kPowersReturn));
    if (returns && is_of_the_map(world, item))
      hide_item(item);
    else
      world.remove(item.id);
  }
  if (item.special != 0) run_actor_special(world, item, &body);
  return true;
}

void return_item(World& world, Actor& item) {
  const ActorType& type = world.type_of(item);
  if (!type.flags.has(ActorFlag::kSpecial) || item.has(ActorFlag::kSpecial) || item.tics != 0) return;
  item.set(ActorFlag::kSpecial);
  item.set(ActorFlag::kNoGravity, type.flags.has(ActorFlag::kNoGravity));
  item.render_style = type.render_style;
  const Fixed x = item.x, y = item.y, z = item.z;
  set_label(world, item, StateLabel::kSpawn);
  if (world.catalog().known().item_fog != kNoType)
    world.spawn_unchecked(world.catalog().known().item_fog, x, y, z);
}

bool give_item(World& world, int player_index, uint32_t type, int32_t amount) {
  if (!in_range(world, player_index, type)) return false;
  const ActorType& info = world.catalog()[type];
  const bool armor = info.item_class == ItemClass::kArmor || info.item_class == ItemClass::kArmorBonus;
  if (amount == 0) amount = armor ? 1 : info.amount;
  const bool given = give(world, player_index, type, {.amount = amount, .by_script = true});
  return given || info.flags.has(ActorFlag::kAlwaysPickup);
}

int32_t take_item(World& world, int player_index, uint32_t type, int32_t amount) {
  if (!in_range(world, player_index, type) || amount < 0) return 0;
  Player& player = player_at(world, player_index);
  const ActorType& info = world.catalog()[type];
  const auto part = [amount](int32_t held) { return amount == 0 ? held : std::min(held, amount); };
  if (same_ignoring_case(info.name, "BasicArmor") || same_ignoring_case(info.name, "Armor") ||
      info.item_class == ItemClass::kArmor || info.item_class == ItemClass::kArmorBonus) {
    const int32_t taken = part(player.armor);
    player.armor -= taken;
    if (player.armor == 0) player.armor_save = 0, player.armor_type = kNoType;
    return taken;
  }
  if (info.power != PowerKind::kNone && find_item(player, type) == nullptr) {
    for (std::size_t i = 0; i < player.powers.size(); ++i) {
      if (player.powers[i].type != type && player.powers[i].kind != info.power) continue;
      player.powers.erase(player.powers.begin() + static_cast<std::ptrdiff_t>(i));
      end_power(world, player, info.power);
      return 1;
    }
    return 0;
  }
  InventoryItem* item = find_item(player, type);
  if (item == nullptr || item->amount <= 0) return 0;
  const int32_t taken = part(item->amount);
  item->amount -= taken;
  if (item->amount > 0 || info.item_class == ItemClass::kAmmo || info.flags.has(ActorFlag::kKeepDepleted))
    return taken;
  remove_entry(world, player, type);
  if (info.item_class == ItemClass::kWeapon) forget_weapon(world, player_index, type);
  return taken;
}

int32_t count_item(const World& world, int player_index, uint32_t type) {
  if (!in_range(world, player_index, type)) return 0;
  const Player& player = world.player(player_index);
  for (const InventoryItem& item : player.inventory)
    if (item.type == type) return item.amount;
  const ActorType& info = world.catalog()[type];
  if (info.item_class == ItemClass::kAmmo || info.item_class == ItemClass::kWeapon ||
      info.item_class == ItemClass::kKey)
    return 0;
  if (same_ignoring_case(info.name, "Health")) return player.health;
  if (same_ignoring_case(info.name, "Armor") || same_ignoring_case(info.name, "BasicArmor"))
    return player.armor;
  if (info.item_class == ItemClass::kBackpack) return player.has_backpack ? 1 : 0;
  // What gives a power is used up at once; the power is what a player has.
  if (world.catalog().is_a(type, "PowerupGiver") || world.catalog().is_a(type, "MapRevealer")) return 0;
  for (const Power& power : player.powers)
    if (power.tics != 0 &&
        (power.type == type || (info.power != PowerKind::kNone && power.kind == info.power)))
      return 1;
  return 0;
}

int32_t max_item(const World& world, int player_index, uint32_t type) {
  if (!in_range(world, player_index, type)) return 0;
  for (const InventoryItem& item : world.player(player_index).inventory)
    if (item.type == type) return item.max_amount;
  return world.catalog()[type].max_amount;
}

void set_max_item(World& world, int player_index, uint32_t type, int32_t max_amount) {
  if (!in_range(world, player_index, type) || world.catalog()[type].item_class != ItemClass::kAmmo) return;
  add_ammo_slot(world, player_at(world, player_index), type).max_amount = std::max(max_amount, 0);
}

void clear_inventory(World& world, int player_index) {
  if (player_index < 0 || player_index >= world.player_count()) return;
  Player& player = player_at(world, player_index);
  const ActorCatalog& catalog = world.catalog();
  const bool had_others = loses_others_after(world, player);
  // Ammunition stays as an entry of none, so that its limit is kept; a backpack's room goes with it.
  std::erase_if(player.inventory, [&](const InventoryItem& item) {
    const ActorType& info = catalog[item.type];
    return info.item_class != ItemClass::kAmmo && !info.flags.has(ActorFlag::kUndroppable);
  });
  for (InventoryItem& item : player.inventory) {
    const ActorType& info = catalog[item.type];
    if (info.item_class != ItemClass::kAmmo || info.flags.has(ActorFlag::kUndroppable)) continue;
    item.amount = 0;
    if (player.has_backpack && item.max_amount == info.backpack_max_amount) item.max_amount = info.max_amount;
  }
  player.has_backpack = false;
  player.armor = 0, player.armor_save = 0, player.armor_type = kNoType;
  while (!player.powers.empty()) {
    const PowerKind kind = player.powers.back().kind;
    player.powers.pop_back();
    end_power(world, player, kind);
  }
  player.pending_weapon = kNoType;
  empty_hand(world, player_index, had_others);
}

void give_start_items(World& world, int player_index, const Player* before) {
  Player& player = player_at(world, player_index);
  const Actor* body = world.actor(player.actor_id);
  if (body == nullptr) return;
  player.inventory.reserve(kInventoryReserve);
  player.powers.reserve(static_cast<std::size_t>(PowerKind::kCount));
  const std::vector<DropItem>& start_items = world.type_of(*body).start_items;
  if (before != nullptr) {
    keep_items(world, *before, start_items, player);
  } else {
    for (const DropItem& start : start_items) {
      if (start.type >= world.catalog().size()) continue;
      const ActorType& info = world.catalog()[start.type];
      const bool armor = info.item_class == ItemClass::kArmor || info.item_class == ItemClass::kArmorBonus;
      const int32_t amount = armor ? 1 : start.amount > 0 ? start.amount : info.amount;
      give(world, player_index, start.type, {.amount = amount, .exact = true, .without_ammo = true});
    }
  }
  if (world.options().deathmatch)
    for (const std::string_view key : kKeyNames)
      if (const std::optional<uint32_t> type = world.catalog().find(key))
        give(world, player_index, *type, {.amount = 1, .exact = true});
  player.ready_weapon = kNoType;
  player.pending_weapon = best_weapon(world, player_index);
}

bool has_key(const World& world, const Actor& actor, int32_t lock) {
  if (lock == 0) return true;
  if (actor.player_index < 0) return false;
  const Player& player = world.player(actor.player_index);
  const auto holds = [&](std::size_t key) { return holds_key(player, world.catalog(), key); };
  if (lock >= 1 && lock <= 6) return holds(static_cast<std::size_t>(lock - 1));
  int held = 0, colors = 0;
  for (std::size_t color = 0; color < 3; ++color) {
    held += holds(color) + holds(color + 3);
    colors += holds(color) || holds(color + 3);
  }
  if (lock == kLockAny || lock == kLockAnyToo) return held > 0;
  if (lock == kLockAll) return held == 6;
  if (lock == kLockEachColor) return colors == 3;
  if (lock < kLockEitherFirst || lock > kLockEitherLast) return false;  // a lock that nobody has a key for
  const auto color = static_cast<std::size_t>((lock - kLockEitherFirst) % 3);
  return holds(color) || holds(color + 3);
}

void tic_powers(World& world, int player_index, bool fresh) {
  Player& player = player_at(world, player_index);
  for (std::size_t i = 0; i < player.powers.size();) {
    Power& power = player.powers[i];
    const bool counts = power.is_fresh == fresh;
    power.is_fresh = power.is_fresh && !counts;
    if (counts && power.tics > 0) --power.tics;
    if (power.tics != 0) {
      ++i;
      continue;
    }
    const PowerKind kind = power.kind;
    player.powers.erase(player.powers.begin() + static_cast<std::ptrdiff_t>(i));
    end_power(world, player, kind);
  }
}

int32_t absorb_damage(World& world, int player_index, int32_t damage, DamageType type) {
  Player& player = player_at(world, player_index);
  if (damage <= 0) return damage;
  if (type == DamageType::kDrowning || player.armor <= 0) return damage;
  const auto part = static_cast<int32_t>((int64_t{damage} * player.armor_save) >> kFracBits);
  const int32_t saved = std::clamp(part, 0, player.armor);
  player.armor -= saved;
  if (player.armor == 0) player.armor_save = 0, player.armor_type = kNoType;
  return damage >= kTelefragDamage ? damage : damage - saved;
}

bool use_item(World& world, int player_index, uint32_t type) {
  if (!in_range(world, player_index, type)) return false;
  Player& player = player_at(world, player_index);
  if (!player.alive || count_item(world, player_index, type) <= 0) return false;
  const ActorType& info = world.catalog()[type];
  InventoryItem* item = find_item(player, type);
  if (item == nullptr) return false;
  bool used = false;
  switch (info.item_class) {
    case ItemClass::kWeapon:
      if (player.ready_weapon != type) player.pending_weapon = type;
      return true;  // and is kept
    case ItemClass::kHealth:
    case ItemClass::kMaxHealth:
      used = give_health(world, player, info, info.amount);
      break;
    case ItemClass::kPowerup:
      used = give_power(world, player_index, type);
      break;
    case ItemClass::kCustomInventory:
      used = run_sequence(world, player_index, info.state(StateLabel::kUse));
      break;
    default:
      return false;
  }
  if (!used) return false;
  item = find_item(player, type);
  if (world.has(wad::GameFlag::kInfiniteInventory)) return true;
  if (item != nullptr && --item->amount <= 0 && !info.flags.has(ActorFlag::kKeepDepleted))
    remove_entry(world, player, type);
  return true;
}

void choose_item(World& world, int player_index, const Buttons& before, const Buttons& pressed) {
  constexpr int32_t kBarTics = 175;
  Player& player = player_at(world, player_index);
  if (player.item_bar_tics > 0) --player.item_bar_tics;
  const bool uses = pressed.use_item && !before.use_item;
  const bool next = pressed.select_next_item && !before.select_next_item;
  const bool previous = pressed.select_previous_item && !before.select_previous_item;
  if (!uses && !next && !previous) return;
  if (uses && !player.totally_frozen) {
    // While the bar is open the key only closes it.
    if (player.item_bar_tics > 0) {
      player.item_bar_tics = 0;
    } else if (const auto place = selected_place(world, player)) {
      use_item(world, player_index, player.inventory[*place].type);
    }
  }
  if (!next && !previous) return;
  player.item_bar_tics = kBarTics;
  // The next one is what was taken before it, as in ZDoom's list; behind the last comes the first.
  const std::size_t count = player.inventory.size(), step = next ? count - 1 : 1;
  if (const auto place = selected_place(world, player)) {
    std::size_t to = (*place + step) % count;
    while (!in_bar(world, player.inventory[to])) to = (to + step) % count;
    player.selected_item = player.inventory[to].type;
  }
}

Actor* drop_item(World& world, Actor& dropper, uint32_t type, int32_t amount, int32_t chance) {
  if (type >= world.catalog().size() || world.random_byte() > chance) return nullptr;
  type = world.catalog().replacement(type);
  const auto z =
      static_cast<Fixed>(std::min<int64_t>(int64_t{dropper.z} + dropper.height / 2, kOnCeiling - 1));
  Actor& item = world.spawn_unchecked(type, dropper.x, dropper.y, z);
  const ActorType& info = world.type_of(item);
  item.set(ActorFlag::kDropped);
  item.set(ActorFlag::kNoGravity, false);
  // Tossed up a little.
  item.velocity_x = world.random_triangle() * (1 << 8);
  item.velocity_y = world.random_triangle() * (1 << 8);
  item.velocity_z = to_fixed(5) + world.random_byte() * (1 << 10);
  if (amount > 0) {
    item.amount = amount;
  } else if (info.item_class == ItemClass::kAmmo) {
    item.amount = info.drop_amount > 0 ? info.drop_amount : std::max(1, info.amount / 2);
  }
  return &item;
}

uint32_t ammo_base(const ActorCatalog& catalog, uint32_t type) {
  if (type >= catalog.size()) return kNoType;
  return catalog[type].ammo_base == kNoType ? type : catalog[type].ammo_base;
}

}  // namespace comrad::doom
