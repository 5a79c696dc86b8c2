#include "sim_workers/engine/play/pickups.h"

#include <algorithm>

namespace comrad::doom {

bool within_reach(const Actor& body, const Actor& item) {
  const int64_t above = int64_t{item.z} - body.z;
  return above <= body.height && above >= -int64_t{to_fixed(32)};
}

bool take_item(Player& player, const ActorType& item) {
  if (!player.alive) return false;
  if (item.heal_amount > 0) {
    if (player.health >= item.heal_limit && !item.always_taken) return false;
    player.health = std::max(player.health, std::min(player.health + item.heal_amount, item.heal_limit));
  }
  player.bonus_flash += kBonusFlashTics;
  ++player.pickup_count;
  return true;
}

}  // namespace comrad::doom
