// What the fuzz targets share: a world in play for some tics, with its scripts on a short leash.
#pragma once

#include <spdlog/spdlog.h>

#include <array>
#include <cstdlib>
#include <memory>

#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::fuzz {

/// One warning per thing is right for a player, not for a million inputs.
inline void be_quiet() {
  static const bool kDone = [] {
    spdlog::set_level(spdlog::level::off);
    return true;
  }();
  (void)kDone;
}

inline const std::shared_ptr<const doom::ActorCatalog>& catalog() {
  static const auto kCatalog = std::make_shared<const doom::ActorCatalog>();
  return kCatalog;
}

/// Each player runs, turns, shoots and uses; `salt` decides when.
inline std::array<doom::Buttons, 2> pressed(int tic, uint32_t salt) {
  std::array<doom::Buttons, 2> buttons;
  const uint32_t bits = (salt >> (tic % 24)) ^ static_cast<uint32_t>(tic);
  buttons[0].forward = true, buttons[0].attack = (bits & 1) != 0, buttons[0].use = (bits & 2) != 0;
  buttons[0].turn_left = (bits & 4) != 0;
  buttons[1].left = (bits & 8) != 0, buttons[1].jump = (bits & 16) != 0, buttons[1].backward = true;
  buttons[1].select_weapon = static_cast<int8_t>(bits % 9);
  return buttons;
}

inline void play(doom::World& world, int tics, uint32_t salt = 0x5A5A33) {
  for (int tic = 0; tic < tics; ++tic) run_tic(world, pressed(tic, salt));
}

inline void start(doom::World& world, int64_t instructions_per_tic = 20'000) {
  reset_world(world, {.player_count = 2, .seed = 7});
  world.state().scripts.instructions_per_tic = instructions_per_tic;
}

/// What must hold whatever the input was.
inline void require(bool holds) {
  if (!holds) std::abort();
}

}  // namespace comrad::fuzz
