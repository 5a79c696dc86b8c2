// Texts and pictures that scripts put into the frame: what replaces what, and how they age. Drawing them is
// engine/render's. Stage: tic.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "sim_workers/engine/acs/caller.h"

namespace comrad::doom::acs {

constexpr std::size_t kHudMessagesMax = 256;

/// Shows a message; one with the same id on the same screen goes. Lower ids are drawn later, over the others.
void show_message(World& world, HudMessage message);

/// HudMessage(type, id, color, x, y, hold; options) with the text that the script has built. `bold`:
/// for everyone.
void show_hud_message(const Caller& caller, std::string text, std::span<const int32_t> args,
                      std::span<const int32_t> options, bool bold);

/// Print and PrintBold: in the middle, for three seconds.
void show_print(const Caller& caller, std::string text, bool bold);

/// Tics that a message stands; 0: for ever.
int64_t message_life_tics(const HudMessage& message);

/// A tic of every message.
void tic_hud_messages(World& world);

/// The number of a text colour ("Gold" -> 5); -1 for names of none.
int32_t find_text_color(std::string_view name);

}  // namespace comrad::doom::acs
