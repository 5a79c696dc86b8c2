// Which policy plays each agent of an evaluation whose team is made of several players: the launcher writes the list into the run
// directory, the learner (weights) and the policy workers (networks, draws) read it. Stage: before a run.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/words.h"

namespace comrad {

/// Where the list lies in a run directory.
constexpr const char* kSeatPlanFile = "seats.toml";

enum class SeatPlayer {
  kNetwork,  ///< a trained network
  kOracle,   ///< this seat of the scenario's scripted team; the simulator presses its buttons
  kRandom,   ///< uniform over the allowed choices of each head
  kNoop,     ///< never presses anything
};

template <>
struct Words<SeatPlayer> {
  static constexpr std::array words = {"network", "oracle", "random", "noop"};
};

/// One of the networks that play.
struct SeatNetwork {
  std::string settings;    ///< TOML file of its settings, absolute
  std::string checkpoint;  ///< file, absolute
};

struct Seat {
  SeatPlayer player = SeatPlayer::kNoop;
  int network = -1;  ///< index in SeatPlan::networks; -1 where no network plays
};

struct SeatPlan {
  std::vector<SeatNetwork> networks;
  std::vector<Seat> seats;  ///< [N], by agent index

  /// The agents that `player` plays, ascending.
  std::vector<int> seats_of(SeatPlayer player) const;
  /// The agents that network number `network` plays, ascending.
  std::vector<int> seats_of_network(int network) const;
};

/// The plan as a TOML document that parse_seat_plan() reads back without loss.
std::string seat_plan_text(const SeatPlan& plan);

/// Errors: kBadFormat as "label:line:column: what", or naming the seat or network.
Expected<SeatPlan> parse_seat_plan(std::string_view text, const std::string& label);

/// Reads `<run_dir>/seats.toml`, which must name `num_agents` seats. Errors: kNotFound, and those of parse_seat_plan().
Expected<SeatPlan> read_seat_plan(const std::string& run_dir, int num_agents);

}  // namespace comrad
