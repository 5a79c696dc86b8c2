#include "sim_workers/engine/acs/hud.h"

#include <algorithm>
#include <array>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/strings.h"

namespace comrad::doom::acs {
namespace {

constexpr int32_t kTicRateHz = 35;
constexpr Fixed kHalfSecond = kFracUnit / 2, kTypeSeconds = 3277;  // 0.05 a letter
constexpr int32_t kPrintTics = 3 * kTicRateHz;
constexpr Fixed kPrintX = kFracUnit + kFracUnit / 2, kPrintY = 3 * kFracUnit / 8;
constexpr int32_t kColorGold = 5, kColorBrown = 4;

// Bits of HudMessage's first argument.
constexpr uint32_t kKindMask = 0xFF, kLayerMask = 0xF000, kNoWrap = 0x08000000, kAlphaGiven = 0x10000000,
                   kAdditive = 0x20000000, kColorByName = 0x40000000;
constexpr int kLayerShift = 12;

constexpr std::array<std::string_view, 26> kColors = {
    "Brick",     "Tan",    "Gray",         "Green", "Brown",     "Gold",  "Red",      "Blue",      "Orange",
    "White",     "Yellow", "Untranslated", "Black", "LightBlue", "Cream", "Olive",    "DarkGreen", "DarkRed",
    "DarkBrown", "Purple", "DarkGray",     "Cyan",  "Ice",       "Fire",  "Sapphire", "Teal"};

int32_t seconds_to_tics(Fixed seconds) {
  return static_cast<int32_t>(
      std::clamp<int64_t>((int64_t{seconds} * kTicRateHz) >> kFracBits, 0, INT32_MAX));
}

}  // namespace

int32_t find_text_color(std::string_view name) {
  if (same_ignoring_case(name, "Grey")) return 2;
  if (same_ignoring_case(name, "DarkGrey")) return 20;
  for (std::size_t i = 0; i < kColors.size(); ++i)
    if (same_ignoring_case(kColors[i], name)) return static_cast<int32_t>(i);
  return -1;
}

void show_message(World& world, HudMessage message) {
  std::vector<HudMessage>& messages = world.state().scripts.hud_messages;
  if (message.id != 0) {
    for (std::size_t i = 0; i < messages.size();) {
      const bool same_screen =
          message.player < 0 || messages[i].player == message.player || messages[i].player < 0;
      if (messages[i].id != message.id || !same_screen) {
        ++i;
        continue;
      }
      const HudMessage old = std::move(messages[i]);
      messages.erase(messages.begin() + static_cast<std::ptrdiff_t>(i));
      if (old.player >= 0 || message.player < 0) continue;
      for (int player = 0; player < world.player_count(); ++player) {  // it stays on the others' screens
        if (player == message.player) continue;
        HudMessage copy = old;
        copy.player = player;
        messages.insert(messages.begin() + static_cast<std::ptrdiff_t>(i++), std::move(copy));
      }
    }
  }
  if (messages.size() >= kHudMessagesMax) messages.erase(messages.begin());
  const auto place = std::find_if(messages.begin(), messages.end(),
                                  [&](const HudMessage& other) { return other.id < message.id; });
  messages.insert(place, std::move(message));
}

void show_hud_message(const Caller& caller, std::string text, std::span<const int32_t> args,
                      std::span<const int32_t> options, bool bold) {
  const auto flags = static_cast<uint32_t>(args[0]);
  const auto option = [&](std::size_t index, Fixed fallback) {
    return index < options.size() ? options[index] : fallback;
  };
  HudMessage message;
  message.player = bold || caller.activator() == nullptr ? -1 : caller.activator_player();
  if (!bold && caller.activator() != nullptr && message.player < 0) return;  // nobody's screen
  message.kind = static_cast<int32_t>(flags & kKindMask);
  message.id = args[1];
  message.color = (flags & kColorByName) != 0 ? std::max(find_text_color(caller.text(args[2])), 0) : args[2];
  if (message.color < 0 || message.color >= static_cast<int32_t>(kColors.size())) message.color = 11;
  message.x = args[3], message.y = args[4];
  message.hold_tics = seconds_to_tics(args[5]);
  std::size_t alpha_option = 0;
  switch (message.kind) {
    case 1:
      message.fade_out_tics = seconds_to_tics(option(0, kHalfSecond));
      alpha_option = 1;
      break;
    case 2:
      message.type_tics = static_cast<int32_t>(
          std::clamp<int64_t>(int64_t{option(0, kTypeSeconds)} * kTicRateHz, 0, INT32_MAX));
      message.fade_out_tics = seconds_to_tics(option(1, kHalfSecond));
      alpha_option = 2;
      break;
    case 3:
      message.fade_in_tics = seconds_to_tics(option(0, kHalfSecond));
      message.fade_out_tics = seconds_to_tics(option(1, kHalfSecond));
      alpha_option = 2;
      break;
    default:
      message.kind = 0;
      break;
  }
  if ((flags & kAlphaGiven) != 0)
    message.alpha = std::clamp(to_float(option(alpha_option, kFracUnit)), 0.0f, 1.0f);
  message.additive = (flags & kAdditive) != 0;
  message.no_wrap = (flags & kNoWrap) != 0;
  message.layer = static_cast<int32_t>((flags & kLayerMask) >> kLayerShift);
  message.text = std::move(text);
  message.font = caller.thread.font;
  message.hud_width = caller.thread.hud_width, message.hud_height = caller.thread.hud_height;
  message.hud_covers_bar = caller.thread.hud_covers_bar;
  std::copy(std::begin(caller.thread.clip), std::end(caller.thread.clip), message.clip.begin());
  message.wrap_width = caller.thread.wrap_width;
  show_message(caller.world, std::move(message));
}

void show_print(const Caller& caller, std::string text, bool bold) {
  HudMessage message;
  const Actor* actor = caller.activator();
  if (!bold && actor != nullptr) {
    // A missile's message goes to the actor that fired it.
    if (actor->player_index < 0 && actor->has(ActorFlag::kMissile))
      actor = caller.world.actor(actor->target_id);
    if (actor == nullptr || actor->player_index < 0 || actor->player_index >= caller.world.player_count())
      return;
    message.player = actor->player_index;
  }
  message.id = kPrintMessageId;
  message.text = std::move(text);
  message.font = caller.thread.font;
  message.color = bold ? kColorBrown : kColorGold;
  message.x = kPrintX, message.y = kPrintY;
  message.hold_tics = kPrintTics;
  show_message(caller.world, std::move(message));
}

int64_t message_life_tics(const HudMessage& message) {
  if (message.hold_tics == 0) return 0;
  const int64_t typing =
      (int64_t{message.type_tics} * static_cast<int64_t>(message.text.size())) >> kFracBits;
  return int64_t{message.hold_tics} + message.fade_in_tics + message.fade_out_tics + typing;
}

void tic_hud_messages(World& world) {
  std::vector<HudMessage>& messages = world.state().scripts.hud_messages;
  std::erase_if(messages, [](HudMessage& message) {
    if (message.age_tics < INT32_MAX) ++message.age_tics;
    const int64_t life = message_life_tics(message);
    return life != 0 && message.age_tics >= life;
  });
}

}  // namespace comrad::doom::acs
