// A small world that runs the scripts of a BehaviorBuilder.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/behavior_builder.h"
#include "tests/support/level_builder.h"

namespace comrad::doom::acs::test {

constexpr int kOpen = static_cast<int>(ScriptType::kOpen), kEnter = static_cast<int>(ScriptType::kEnter);

inline std::shared_ptr<const ActorCatalog> shared_catalog() {
  static const auto catalog = std::make_shared<const ActorCatalog>();
  return catalog;
}

inline std::shared_ptr<const Behavior> load(const BehaviorBuilder& builder) {
  auto behavior = Behavior::load(builder.build(), "TEST");
  EXPECT_TRUE(behavior.has_value()) << (behavior ? "" : behavior.error().message);
  return behavior ? *behavior : nullptr;
}

/// The room of one_room() with whatever a test requires in it. Scripts of type OPEN and ENTER have started; the
/// first tic() runs them.
class ScriptWorld {
 public:
  explicit ScriptWorld(const BehaviorBuilder& builder, int player_count = 1,
                       std::shared_ptr<const Level> level = doom::test::one_room(), uint64_t seed = 1)
      : world(std::move(level), shared_catalog(), load(builder)) {
    WorldOptions options;
    options.player_count = player_count;
    options.seed = seed;
    reset_world(world, options);
  }
  ScriptWorld& tic(int count = 1) {
    for (int i = 0; i < count; ++i) run_tic(world, {});
    return *this;
  }
  int32_t global(std::size_t index) const { return world.state().globals[index]; }
  const MachineState& machine() const { return world.state().scripts; }
  const std::string& error() const { return world.state().scripts.last_error; }
  Actor& player_body(int player = 0) { return *world.body_of(player); }

  World world;
};

/// What an OPEN script leaves in global 1, in the requested container; errors fail the test.
template <typename Write>
int32_t evaluate(Container container, Write write) {
  BehaviorBuilder code(container);
  code.script(1, kOpen);
  write(code);
  code.store_global(1).end();
  ScriptWorld game(code);
  game.tic();
  EXPECT_EQ(game.error(), "");
  return game.global(1);
}

}  // namespace comrad::doom::acs::test
