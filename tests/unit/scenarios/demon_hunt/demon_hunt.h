// Smart Enemies and Dumb Enemies in tests: the same hunters, weapon, floor and supplies; the demons differ.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "sim_workers/engine/play/placement.h"
#include "tests/support/scenario_stage.h"

namespace comrad::sim::test {

constexpr int kLivingVariable = 31, kSpawnsVariable = 34;  // exported globals that both scenarios have

/// One of the two on its default map.
struct DemonHunt : ScenarioGame {
  explicit DemonHunt(const std::string& scenario, uint64_t seed = 1, const Parameters& parameters = {},
                     int agents = 2)
      : ScenarioGame(scenario, seed, parameters, agents) {
    decide();
  }
  doom::Actor* demon(int slot = 0) { return world().find_thing(10000 + slot); }
  int shells(int agent) { return doom::count_item(world(), agent, *world().catalog().find("Shell")); }
  /// The demon of slot 0 held at a place, with the agents so far from it (along y = 0; nobody collides).
  void arrange(int first_distance, int second_distance) {
    doom::Actor& actor = *demon();
    for (int agent = 0; agent < 2; ++agent) world().body_of(agent)->set(doom::ActorFlag::kNoClip);
    actor.set(doom::ActorFlag::kNoClip);
    for (int i = 0; i < 3; ++i) {  // it walks on between the script's looks
      set_position(world(), actor.id, 0, 0, actor.z);
      put(0, first_distance, 0), put(1, 0, second_distance);
      decide();
    }
  }
  void hurt(doom::Actor& actor, int amount, int by = -1) {
    doom::Actor* source = by < 0 ? nullptr : world().body_of(by);
    doom::damage_actor(world(), actor, source, source, amount);
  }
};

}  // namespace comrad::sim::test
