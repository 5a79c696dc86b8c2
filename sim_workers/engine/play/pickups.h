// What happens when a body touches an item: reach, what it gives, whether it is taken. Stage: tic.
#pragma once

#include "sim_workers/engine/play/world.h"

namespace comrad::doom {

constexpr int32_t kBonusFlashTics = 6;  ///< gold flash that every item taken adds

/// True where `item`, which `body` overlaps seen from above, is within the reach of its hands: from 32 units
/// below its feet to the top of its head.
bool within_reach(const Actor& body, const Actor& item);

/// Gives the item to the player if it can use it: heals up to the item's limit and flashes. False where the
/// item stays, as a Stimpack does at 100 HP. New kinds of items (ammunition, armour, keys) get their case
/// here.
bool take_item(Player& player, const ActorType& item);

}  // namespace comrad::doom
