// What a player does with its body each tic before bodies move: turn, thrust, jump, eye height. Stage: tic.
#pragma once

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

class PlayerThinker {
 public:
  explicit PlayerThinker(World& world) : world_(world) {}

  /// One player's tic up to the use key. A dead player's body is left to inertia; its eye sinks to the ground. True where it
  /// lived, and so feels the floor on which it stands and then has a tic of its hand.
  bool think(int player_index, const Buttons& buttons);
  /// The rest of that tic: its weapon, after what the floor does (measured: a shot that teleports from a floor leaves its secret
  /// for the next tic).
  void tic_hand(int player_index);

  /// True where the buttons push the body: opposite directions cancel.
  static bool pushes(const Buttons& buttons);
  /// Push of the keys and deltas together, in 1/32 unit per tic^2; forward and right are positive.
  static int32_t forward_units(const Buttons& buttons);
  static int32_t side_units(const Buttons& buttons);
  /// Turn of the keys and deltas together, in 65536ths of a circle; left and up are positive.
  static int32_t yaw_units(const Player& player, const Buttons& buttons);
  static int64_t pitch_units(const Buttons& buttons);
  /// As far up or down as a player looks; positive is down.
  static Angle clamped_pitch(int64_t pitch);
  /// True in the four states of its walk.
  static bool is_walking(const World& world, const Actor& body);

 private:
  void turn(Player& player, Actor& body, const Buttons& buttons);
  void look(Actor& body, const Buttons& buttons);
  void crouch(Player& player, Actor& body, const Buttons& buttons);
  static Fixed eye_height(const Player& player);
  void push(Player& player, Actor& body, const Buttons& buttons);
  void move_eye(Player& player, const Actor& body);
  void think_dead(int player_index, Player& player, Actor& body);

  World& world_;
};

}  // namespace comrad::doom
