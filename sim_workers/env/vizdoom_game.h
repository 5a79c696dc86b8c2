// A ViZDoom .cfg as a game for one player: its WAD, its rewards, its endings. Stage: tic > step.
//
//   reward of a step = (change of ACS global variable 0) / 65536 + living_reward * tics
//                      - death_penalty + death_reward   in the step in which the player dies
//                      + map_exit_reward                in the step that ends the map
//                      + each counting reward * the change of its variable
//
// An episode ends when the player dies, the map ends, or episode_timeout tics have passed since its
// first step.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/vizdoom_config.h"
#include "sim_workers/engine/world/world.h"
#include "sim_workers/env/game_content.h"

namespace comrad::sim {

/// What all episodes of a cfg share; immutable.
struct VizdoomGame {
  scenarios::VizdoomConfig config;
  GameContent content;
  std::vector<std::string> art_paths;  ///< PWADs for the renderer
  std::string iwad_path;               ///< empty: the renderer's own search
};

/// Reads the WAD that the cfg names, or the IWAD's map where it names none. `wad_path` replaces the cfg's WAD
/// where it is not empty. Errors: kNotFound, kBadFormat; warnings are in content.warnings.
Expected<std::shared_ptr<const VizdoomGame>> load_vizdoom_game(scenarios::VizdoomConfig config,
                                                               const std::string& wad_path = {});

/// One player's episodes.
class VizdoomEpisode {
 public:
  explicit VizdoomEpisode(std::shared_ptr<const VizdoomGame> game);

  /// Starts anew and runs the tics before the first step.
  void reset(uint64_t seed);
  /// Holds `buttons` for `tics` tics, fewer when the episode ends. Returns the reward.
  double step(const doom::Buttons& buttons, int tics = 1);

  bool finished() const { return finished_; }
  double total_reward() const { return total_reward_; }
  const doom::World& world() const { return world_; }
  doom::World& world() { return world_; }
  const VizdoomGame& game() const { return *game_; }
  /// As read_variable(), but HEALTH is the body's, which is below 0 after a death, as ViZDoom says it.
  double variable(const scenarios::GameVariable& variable) const;

 private:
  /// What counting rewards compare.
  struct Counts {
    int32_t map_reward = 0;  ///< 16.16
    int32_t kills = 0, secrets = 0, items = 0, frags = 0, hits = 0, damage_made = 0, hits_taken = 0,
            damage_taken = 0, health = 0, armor = 0;
  };
  Counts counts() const;

  std::shared_ptr<const VizdoomGame> game_;
  doom::World world_;
  Counts before_;
  uint64_t first_tic_ = 0;
  bool finished_ = false;
  double total_reward_ = 0;
};

}  // namespace comrad::sim
