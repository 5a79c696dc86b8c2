#include "sim_workers/engine/world/world_hash.h"

#include <gtest/gtest.h>

#include <memory>

#include "sim_workers/engine/tic/tic.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace world_hash_test {

WorldState state_with_some_of_everything() {
  World world(test::one_room(), std::make_shared<const ActorCatalog>());
  reset_world(world, {.player_count = 2, .seed = 1});
  WorldState& state = world.state();
  state.players[0].inventory.push_back({});
  state.players[0].powers.push_back({});
  state.movers.sectors.push_back({});
  state.movers.lights.push_back({});
  state.movers.scrollers.push_back({});
  state.movers.switches.push_back({});
  state.movers.polyobjects.emplace_back().position.push_back({0, 0});
  acs::Thread& thread = state.scripts.threads.push_back({});
  thread.stack.push_back(1), thread.calls.push_back({});
  state.scripts.hud_messages.push_back({});
  state.scripts.plane_watchers.push_back({});
  return state;
}

struct Change {
  const char* what;
  void (*apply)(WorldState&);
};

// What the compiler cannot see to: that each kind of field reaches the sum, inside lists and lists of lists too.
constexpr Change kChanges[] = {
    {"exit", [](WorldState& w) { w.exited_secretly = true; }},
    {"an argument of a line", [](WorldState& w) { w.lines[1].args[4] = 1; }},
    {"transparency of a line", [](WorldState& w) { w.lines[1].alpha = 0.5f; }},
    {"texture of a side", [](WorldState& w) { w.sides[3].middle = "BRICK7"; }},
    {"a side's texture changes parts", [](WorldState& w) { w.sides[3].top.swap(w.sides[3].middle); }},
    {"scrolling of a side", [](WorldState& w) { w.sides[3].scroll_y = 1; }},
    {"an argument of an actor", [](WorldState& w) { w.actors[1].args[4] = 1; }},
    {"transparency of an actor", [](WorldState& w) { w.actors[1].alpha = 0.5f; }},
    {"a flag of an actor", [](WorldState& w) { w.actors[1].set(ActorFlag::kAmbush); }},
    {"damage of an actor", [](WorldState& w) { w.actors[1].damage.exact = true; }},
    {"order in a cell", [](WorldState& w) { w.links[0].next = 1; }},
    {"an item", [](WorldState& w) { w.players[0].inventory[0].max_amount += 1; }},
    {"a power", [](WorldState& w) { w.players[0].powers[0].type = 1; }},
    {"a button", [](WorldState& w) { w.players[1].buttons.up_delta = 1; }},
    {"a weapon's flash", [](WorldState& w) { w.players[1].weapon_sprites[1].own_x = 1; }},
    {"a flat", [](WorldState& w) { w.sectors[0].floor_texture = "FLAT1"; }},
    {"how a flat lies", [](WorldState& w) { w.sectors[0].ceiling_placement.rotation_degrees = 1; }},
    {"a plane under way", [](WorldState& w) { w.movers.sectors[0].growth = 1; }},
    {"a light", [](WorldState& w) { w.movers.lights[0].bright_tics = 1; }},
    {"a scroller", [](WorldState& w) { w.movers.scrollers[0].dy = 1; }},
    {"a switch", [](WorldState& w) { w.movers.switches[0].back_texture = "SW1"; }},
    {"a polyobject's corner", [](WorldState& w) { w.movers.polyobjects[0].position[0][1] = 1; }},
    {"a script's stack", [](WorldState& w) { w.scripts.threads[0].stack[0] = 2; }},
    {"a script's caller", [](WorldState& w) { w.scripts.threads[0].calls[0].local_count = 1; }},
    {"a script's clip", [](WorldState& w) { w.scripts.threads[0].clip[3] = 1; }},
    {"a message", [](WorldState& w) { w.scripts.hud_messages[0].text = "nine bytes"; }},
    {"a watched plane", [](WorldState& w) { w.scripts.plane_watchers[0].args[0] = 1; }},
    {"an export", [](WorldState& w) { w.globals[60] = 1; }},
    {"the air", [](WorldState& w) { w.air_control = 1; }},
    {"the brain", [](WorldState& w) { w.brain.easy_skip = true; }},
    {"chance", [](WorldState& w) { w.rng.next(); }},
};

TEST(WorldHash, CoversEachPartOfAWorld) {
  const uint64_t start = hash_of(state_with_some_of_everything());
  EXPECT_EQ(hash_of(state_with_some_of_everything()), start);
  for (const Change& change : kChanges) {
    WorldState changed = state_with_some_of_everything();
    change.apply(changed);
    EXPECT_NE(hash_of(changed), start) << change.what;
  }
}

TEST(WorldHash, ValuesDoNotMoveFromOneListIntoTheNext) {
  WorldState first, second;
  first.scripts.map_arrays = {{1, 2}, {}};
  second.scripts.map_arrays = {{1}, {2}};
  EXPECT_NE(hash_of(first), hash_of(second));
}

TEST(WorldHash, ScratchDoesNotCount) {
  WorldState state = state_with_some_of_everything();
  const uint64_t start = hash_of(state);
  state.sound_blocks.push_back(1), state.sound_queue.push_back(1), state.sound_queue_later.push_back(1);
  EXPECT_EQ(hash_of(state), start);
}

}  // namespace world_hash_test
}  // namespace comrad::doom
