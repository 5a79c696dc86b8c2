#include "sim_workers/engine/play/weapons.h"

#include <algorithm>
#include <array>

#include "sim_workers/engine/play/actions.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/sight.h"

namespace comrad::doom {
namespace {

constexpr int kSlotCount = 10;
constexpr std::size_t kSlotWeaponsMax = 16;  // of one slot; more are out of reach of its key
constexpr int kZeroTicStatesMax = 64;        // in a row: a circle of them ends here
constexpr int kStateDepthMax = 16;           // of states that actions enter inside of each other
constexpr uint8_t kStatePermissions = kMayFire | kMayBob | kMaySwitch | kMayFireAlternately;

uint32_t label_of(const World& world, uint32_t weapon, StateLabel label) {
  return weapon < world.catalog().size() ? world.catalog()[weapon].state(label) : kNoState;
}

bool has_flag(const World& world, uint32_t weapon, ActorFlag flag) {
  return weapon < world.catalog().size() && world.catalog()[weapon].flags.has(flag);
}

/// The weapons of a slot in the order of their definition, as in ViZDoom.
struct Slot {
  std::array<uint32_t, kSlotWeaponsMax> types{};
  std::size_t count = 0;
};

Slot weapons_in(const ActorCatalog& catalog, int number) {
  Slot slot;
  const auto before = [&](uint32_t a, uint32_t b) {
    const WeaponInfo &left = catalog[a].weapon, &right = catalog[b].weapon;
    if (left.slot_priority != right.slot_priority) return left.slot_priority < right.slot_priority;
    return a < b;
  };
  for (uint32_t type = 0; type < catalog.size(); ++type) {
    if (catalog[type].item_class != ItemClass::kWeapon || catalog[type].weapon.slot != number) continue;
    if (slot.count == slot.types.size()) break;
    std::size_t place = slot.count++;
    for (; place > 0 && before(type, slot.types[place - 1]); --place)
      slot.types[place] = slot.types[place - 1];
    slot.types[place] = type;
  }
  return slot;
}

/// For either of its fires.
bool has_any_ammo_for(const World& world, int player, uint32_t type) {
  return has_ammo_for(world, player, type) ||
         (label_of(world, type, StateLabel::kAltFire) != kNoState && has_ammo_for(world, player, type, true));
}

bool usable(const World& world, int player, uint32_t type) {
  return owns_weapon(world, player, type) && has_any_ammo_for(world, player, type);
}

/// What a slot key requests: in the slot of the weapon in the hand the one before it, in a circle; elsewhere
/// the last one. kNoType: nothing usable.
uint32_t pick_from_slot(const World& world, int player_index, int number) {
  const Slot slot = weapons_in(world.catalog(), number);
  const uint32_t ready = world.player(player_index).ready_weapon;
  for (std::size_t i = 0; i < slot.count; ++i) {
    if (slot.types[i] != ready) continue;
    for (std::size_t step = 1; step < slot.count; ++step) {
      const uint32_t type = slot.types[(i + slot.count - step) % slot.count];
      if (usable(world, player_index, type)) return type;
    }
  }
  for (std::size_t i = slot.count; i-- > 0;)
    if (usable(world, player_index, slot.types[i])) return slot.types[i];
  return kNoType;
}

/// The weapon after (+1) or before (-1) the one in the hand, or on its way there instead of it, over all slots in a circle.
uint32_t pick_neighbour(const World& world, int player_index, int direction) {
  const Player& player = world.player(player_index);
  const uint32_t present = player.ready_weapon != kNoType && player.pending_weapon != kNoType
                               ? player.pending_weapon
                               : player.ready_weapon;
  int number = present == kNoType ? 0 : world.catalog()[present].weapon.slot;
  if (number < 0 || number >= kSlotCount) return kNoType;
  Slot slot = weapons_in(world.catalog(), number);
  std::size_t place = 0;
  while (place < slot.count && slot.types[place] != present) ++place;
  if (present != kNoType && place == slot.count) return kNoType;
  if (present == kNoType) place = direction > 0 ? slot.count : 0;  // before the first step
  if (present == kNoType && direction > 0) {
    number = kSlotCount - 1;
    slot.count = place = 0;
  }
  for (int slots_left = kSlotCount + 1; slots_left > 0;) {
    if (direction > 0 ? place + 1 < slot.count : place > 0 && slot.count > 0) {
      place = direction > 0 ? place + 1 : place - 1;
    } else {
      number = (number + kSlotCount + direction) % kSlotCount;
      slot = weapons_in(world.catalog(), number);
      --slots_left;
      if (slot.count == 0) continue;
      place = direction > 0 ? 0 : slot.count - 1;
    }
    const uint32_t type = slot.types[place];
    if (type == present) return kNoType;
    if (usable(world, player_index, type)) return type;
  }
  return kNoType;
}

/// The weapon with the lowest selection order that has ammunition for its first fire; with `ammo_type` only those that use it.
uint32_t best_of(const World& world, int player_index, uint32_t ammo_type) {
  uint32_t best = kNoType;
  for (const InventoryItem& item : world.player(player_index).inventory) {
    if (item.amount <= 0 || item.type >= world.catalog().size()) continue;
    const ActorType& type = world.catalog()[item.type];
    if (type.item_class != ItemClass::kWeapon || type.flags.has(ActorFlag::kWeaponCheatNotWeapon)) continue;
    if (ammo_type != kNoType && ammo_base(world.catalog(), type.weapon.ammo_type) != ammo_type) continue;
    if (best != kNoType && type.weapon.selection_order >= world.catalog()[best].weapon.selection_order)
      continue;
    if (has_ammo_for(world, player_index, item.type)) best = item.type;
  }
  return best;
}

/// Another weapon, because this one cannot continue.
void pick_new_weapon(World& world, int player_index) {
  Player& player = player_at(world, player_index);
  const uint32_t best = best_of(world, player_index, kNoType);
  if (best == kNoType) return;
  player.pending_weapon = best;  // perhaps the same one: it goes down and comes up again
  if (player.ready_weapon != kNoType) {
    drop_weapon(world, player_index);
  } else {
    raise_weapon(world, player_index);
  }
}

/// The weapon swings with its player's steps: what WeaponSprite::x and y add to own_x and own_y.
void bob_sprite(const World& world, Player& player) {
  constexpr Fixed kStep = kFracUnit;
  const bool bobs = (player.weapon_permissions & kMayBob) != 0 &&
                    !has_flag(world, player.ready_weapon, ActorFlag::kWeaponDontBob);
  const int64_t target = bobs ? player.bob : 0;
  const int64_t missing = target - player.weapon_bob;
  // No jump: a unit a tic, or a fortieth of what is missing.
  const int64_t step = std::max<int64_t>(kStep, (missing < 0 ? -missing : missing) / 40);
  player.weapon_bob = static_cast<Fixed>(player.weapon_bob + std::clamp<int64_t>(missing, -step, step));
  const auto phase = static_cast<Angle>((world.tic_count() + 1) * 128) << 19;
  WeaponSprite& weapon = player.weapon_sprites[0];
  weapon.x = weapon.own_x + fixed_mul(player.weapon_bob, fine_cosine(phase));
  weapon.y = weapon.own_y + fixed_mul(player.weapon_bob, fine_sine(phase & (kAngle180 - 1)));
}

/// A tic of one layer.
void tic_layer(World& world, int player_index, int layer) {
  WeaponSprite& sprite = player_at(world, player_index).weapon_sprites[static_cast<std::size_t>(layer)];
  if (sprite.state == kNoState || sprite.tics < 0) return;
  if (--sprite.tics > 0) return;
  set_weapon_state(world, player_index, layer, world.catalog().state(sprite.state).next);
}

}  // namespace

void set_weapon_state(World& world, int player_index, int layer, uint32_t state) {
  Player& player = player_at(world, player_index);
  WeaponSprite& sprite = player.weapon_sprites[static_cast<std::size_t>(layer)];
  if (player.weapon_state_depth >= kStateDepthMax) {
    sprite.tics = std::max(sprite.tics, 1);  // states that fire each other without end: one tic of rest
    return;
  }
  ++player.weapon_state_depth;
  int states_left = kZeroTicStatesMax;
  for (;;) {
    if (layer == 0) {
      player.weapon_permissions &= static_cast<uint8_t>(~kStatePermissions);
      player.weapon_ready = false;
    }
    sprite.state = state < world.catalog().state_count() ? state : kNoState;
    if (sprite.state == kNoState) {
      sprite.tics = -1;
      break;
    }
    const State& entered = world.catalog().state(state);
    sprite.tics = entered.tics;
    if (entered.random_tics > 0)
      sprite.tics += static_cast<int32_t>(world.rng().below(static_cast<uint32_t>(entered.random_tics) + 1));
    if (entered.offset_x != 0) sprite.own_x = to_fixed(entered.offset_x);
    if (entered.offset_y != 0) sprite.own_y = to_fixed(entered.offset_y);
    if (--states_left == 0) {
      sprite.tics = std::max(sprite.tics, 1);
      break;
    }
    Actor* body = world.body_of(player_index);
    if (entered.action != ActionId::kNone && body != nullptr) {
      ActionCall call{.world = world,
                      .self = *body,
                      .player = &player,
                      .layer = layer,
                      .state = entered,
                      .args = world.catalog().args(entered)};
      run_action(call);
      if (call.has_jump) {
        state = call.jump;
        continue;
      }
      if (sprite.state == kNoState) break;
    }
    // An action may have entered another state of this layer; whatever it is in, no tics mean: continue.
    if (sprite.tics != 0) break;
    state = world.catalog().state(sprite.state).next;
  }
  --player.weapon_state_depth;
}

void raise_weapon(World& world, int player_index) {
  Player& player = player_at(world, player_index);
  if (player.pending_weapon != kNoType) {
    player.ready_weapon = player.pending_weapon;
    player.pending_weapon = kNoType;
    player.refire = 0;
  }
  if (player.ready_weapon == kNoType) {
    set_weapon_state(world, player_index, 0, kNoState);
    return;
  }
  WeaponSprite& sprite = player.weapon_sprites[0];
  sprite.own_x = 0;
  sprite.own_y = player.instant_switch ? kWeaponTop : kWeaponBottom;
  set_weapon_state(world, player_index, 0, label_of(world, player.ready_weapon, StateLabel::kSelect));
  sprite.x = sprite.own_x, sprite.y = sprite.own_y;
}

void drop_weapon(World& world, int player_index) {
  Player& player = player_at(world, player_index);
  player.weapon_permissions &= static_cast<uint8_t>(~kNoSwitch);
  if (player.ready_weapon != kNoType)
    set_weapon_state(world, player_index, 0, label_of(world, player.ready_weapon, StateLabel::kDeselect));
}

void choose_weapon(World& world, int player_index, const Buttons& buttons) {
  Player& player = player_at(world, player_index);
  const int8_t slot = buttons.select_weapon;
  const bool slot_pressed = slot >= 0 && slot < kSlotCount && slot != player.select_weapon_down;
  // A key counts when it goes down while the other is up, or with it.
  const bool next = buttons.select_next_weapon, previous = buttons.select_previous_weapon;
  const bool goes_down = (next && !player.next_weapon_down) || (previous && !player.previous_weapon_down);
  const bool stays_down = (next && player.next_weapon_down) || (previous && player.previous_weapon_down);
  const bool cycle_pressed = goes_down && !stays_down;
  player.select_weapon_down = slot;
  player.next_weapon_down = next, player.previous_weapon_down = previous;
  if (!player.alive) return;
  uint32_t chosen = kNoType;
  if (slot_pressed) chosen = pick_from_slot(world, player_index, slot);
  if (cycle_pressed) chosen = pick_neighbour(world, player_index, previous ? -1 : 1);
  if (chosen != kNoType && chosen != player.ready_weapon) player.pending_weapon = chosen;
}

bool select_weapon(World& world, int player_index, uint32_t type, bool by_script) {
  Player& player = player_at(world, player_index);
  if (!owns_weapon(world, player_index, type)) return false;
  if (player.ready_weapon == type) {
    if (by_script) player.pending_weapon = kNoType;  // it stays; an item lets it go as was requested before
    return true;
  }
  if (!has_any_ammo_for(world, player_index, type)) return false;
  player.pending_weapon = type;
  return true;
}

void fire_weapon(World& world, int player_index, bool alternately) {
  Player& player = player_at(world, player_index);
  if (player.ready_weapon == kNoType || !check_ammo(world, player_index, true, alternately)) return;
  player.fires_alternately = alternately;
  const uint32_t weapon = player.ready_weapon;
  Actor* body = world.body_of(player_index);
  if (body == nullptr) return;
  if (world.type_of(*body).state(StateLabel::kMissile) != kNoState)
    set_label(world, *body, StateLabel::kMissile);
  uint32_t state = player.refire > 0 && !alternately ? label_of(world, weapon, StateLabel::kHold) : kNoState;
  if (state == kNoState)
    state = label_of(world, weapon, alternately ? StateLabel::kAltFire : StateLabel::kFire);
  set_weapon_state(world, player_index, 0, state);
  if (!has_flag(world, weapon, ActorFlag::kWeaponNoAlert)) alert_monsters(world, *body, *body);
}

bool check_ammo(World& world, int player_index, bool switches, bool alternately) {
  const Player& player = world.player(player_index);
  if (player.ready_weapon == kNoType) return false;
  if (has_ammo_for(world, player_index, player.ready_weapon, alternately)) return true;
  if (switches) pick_new_weapon(world, player_index);
  return false;
}

bool use_ammo(World& world, int player_index) {
  Player& player = player_at(world, player_index);
  if (player.ready_weapon == kNoType) return false;
  if (world.options().infinite_ammo) return true;
  const ActorType& type = world.catalog()[player.ready_weapon];
  if (!has_ammo_for(world, player_index, player.ready_weapon, player.fires_alternately)) return false;
  const auto take = [&](uint32_t ammo_type, int32_t amount) {
    if (ammo_type == kNoType || amount <= 0) return;
    const uint32_t base = ammo_base(world.catalog(), ammo_type);
    for (InventoryItem& item : player.inventory)
      if (item.type == base) item.amount = std::max(0, item.amount - amount);
  };
  if (!player.fires_alternately) take(type.weapon.ammo_type, type.weapon.ammo_use);
  if (player.fires_alternately || type.flags.has(ActorFlag::kWeaponPrimaryUsesBoth))
    take(type.weapon.ammo_type_2, type.weapon.ammo_use_2);
  return true;
}

void tic_weapon(World& world, int player_index) {
  Player& player = player_at(world, player_index);
  if (player.ready_weapon == kNoType) {
    set_weapon_state(world, player_index, 0, kNoState);
    set_weapon_state(world, player_index, 1, kNoState);
    if (player.pending_weapon != kNoType && player.alive) raise_weapon(world, player_index);
    return;
  }
  for (int layer = 0; layer < 2; ++layer) tic_layer(world, player_index, layer);

  // A change, or death, comes before the trigger.
  if ((player.weapon_permissions & kMaySwitch) != 0 && (player.pending_weapon != kNoType || !player.alive))
    drop_weapon(world, player_index);
  const Buttons buttons = player.effective_buttons();
  const bool fires = buttons.attack && (player.weapon_permissions & kMayFire) != 0;
  const bool fires_alternately =
      !fires && buttons.alt_attack && (player.weapon_permissions & kMayFireAlternately) != 0;
  if (fires || fires_alternately) {
    if ((player.weapon_permissions & kTriggerHeld) == 0 ||
        !has_flag(world, player.ready_weapon, ActorFlag::kWeaponNoAutoFire)) {
      player.weapon_permissions |= kTriggerHeld;  // also by the trigger of an AltFire that it has not
      if (fires || label_of(world, player.ready_weapon, StateLabel::kAltFire) != kNoState)
        fire_weapon(world, player_index, fires_alternately);
    }
  } else if ((player.weapon_permissions & (kMayFire | kMayFireAlternately)) != 0) {
    player.weapon_permissions &= static_cast<uint8_t>(~kTriggerHeld);
  }
  bob_sprite(world, player);
  WeaponSprite& flash = player.weapon_sprites[1];
  flash.x = player.weapon_sprites[0].x, flash.y = player.weapon_sprites[0].y;
}

uint32_t best_weapon(const World& world, int player_index) { return best_of(world, player_index, kNoType); }

int selected_slot(const World& world, int player_index) {
  const uint32_t ready = world.player(player_index).ready_weapon;
  if (ready == kNoType) return -1;
  const int slot = world.catalog()[ready].weapon.slot;
  return slot >= 0 && slot < kSlotCount ? slot : -1;
}

int selected_ammo(const World& world, int player_index) {
  const uint32_t ready = world.player(player_index).ready_weapon;
  if (ready == kNoType) return -1;
  const uint32_t ammo_type = world.catalog()[ready].weapon.ammo_type;
  return ammo_type == kNoType ? 0 : count_item(world, player_index, ammo_base(world.catalog(), ammo_type));
}

int ammo_of_slot(const World& world, int player_index, int number) {
  const Slot slot = weapons_in(world.catalog(), number);
  if (slot.count == 0) return 0;
  const uint32_t ammo_type = world.catalog()[slot.types[0]].weapon.ammo_type;
  return ammo_type == kNoType ? 0 : count_item(world, player_index, ammo_base(world.catalog(), ammo_type));
}

int weapons_of_slot(const World& world, int player_index, int number) {
  const Slot slot = weapons_in(world.catalog(), number);
  int owned = 0;
  for (std::size_t i = 0; i < slot.count; ++i) owned += owns_weapon(world, player_index, slot.types[i]);
  return owned;
}

bool owns_weapon(const World& world, int player_index, uint32_t type) {
  for (const InventoryItem& item : world.player(player_index).inventory)
    if (item.type == type && item.amount > 0)
      return type < world.catalog().size() && world.catalog()[type].item_class == ItemClass::kWeapon;
  return false;
}

bool has_ammo_for(const World& world, int player_index, uint32_t weapon_type, bool alternately) {
  const ActorType& type = world.catalog()[weapon_type];
  if (world.options().infinite_ammo ||
      type.flags.has(alternately ? ActorFlag::kWeaponAltAmmoOptional : ActorFlag::kWeaponAmmoOptional))
    return true;
  const auto enough = [&](uint32_t ammo_type, int32_t amount) {
    return ammo_type == kNoType || amount <= 0 ||
           count_item(world, player_index, ammo_base(world.catalog(), ammo_type)) >= amount;
  };
  if (alternately) return enough(type.weapon.ammo_type_2, type.weapon.ammo_use_2);
  return enough(type.weapon.ammo_type, type.weapon.ammo_use) &&
         (!type.flags.has(ActorFlag::kWeaponPrimaryUsesBoth) ||
          enough(type.weapon.ammo_type_2, type.weapon.ammo_use_2));
}

void switch_for_ammo(World& world, int player_index, uint32_t ammo_type) {
  Player& player = player_at(world, player_index);
  if (player.pending_weapon != kNoType) return;
  const uint32_t ready = player.ready_weapon;
  if (ready != kNoType && !has_flag(world, ready, ActorFlag::kWeaponWimpy)) return;
  const uint32_t best = best_of(world, player_index, ammo_type);
  if (best == kNoType) return;
  if (ready == kNoType ||
      world.catalog()[best].weapon.selection_order < world.catalog()[ready].weapon.selection_order)
    player.pending_weapon = best;
}

void empty_hand(World& world, int player_index, bool had_others) {
  Player& player = player_at(world, player_index);
  const bool ready = player.weapon_ready;
  const uint8_t permissions = player.weapon_permissions;
  player.ready_weapon = kNoType;
  player.refire = 0;
  for (int layer = 0; layer < 2; ++layer) set_weapon_state(world, player_index, layer, kNoState);
  // The last weapon's readiness outlives it by the rest of the tic, as in ViZDoom.
  if (!had_others) player.weapon_ready = ready, player.weapon_permissions = permissions;
}

void forget_weapon(World& world, int player_index, uint32_t type) {
  Player& player = player_at(world, player_index);
  if (player.pending_weapon == type) player.pending_weapon = kNoType;
  if (player.ready_weapon != type) return;
  empty_hand(world, player_index, best_weapon(world, player_index) != kNoType);
  if (player.pending_weapon == kNoType && player.alive) pick_new_weapon(world, player_index);
}

}  // namespace comrad::doom
