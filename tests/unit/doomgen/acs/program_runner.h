// Compiles ACS source and runs it in our machine, in a room with one player.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "doomgen/acs/compiler.h"
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/level_builder.h"

namespace comrad::acs_compiler::test {

inline std::shared_ptr<const doom::ActorCatalog> shared_catalog() {
  static const auto catalog = std::make_shared<const doom::ActorCatalog>();
  return catalog;
}

inline std::shared_ptr<const doom::acs::Behavior> load(const std::vector<uint8_t>& lump,
                                                       const doom::acs::LibraryReader& libraries = nullptr,
                                                       const std::vector<std::string>& loadacs = {}) {
  auto behavior = doom::acs::Behavior::load(lump, "TEST", libraries, loadacs);
  EXPECT_TRUE(behavior.has_value()) << (behavior ? "" : behavior.error().message);
  return behavior ? *behavior : nullptr;
}

/// The lump of a source that has to compile.
inline std::vector<uint8_t> compiled(const std::string& source, const CompileOptions& options = {}) {
  Expected<CompiledScript> script = compile(source, "test.acs", options);
  EXPECT_TRUE(script.has_value()) << (script ? "" : script.error().message) << "\n" << source;
  if (!script) return compile("script 999 (void) {}", "empty.acs")->behavior;
  return script->behavior;
}

/// A world whose OPEN and ENTER scripts have started; the first tic() runs them.
class ProgramRunner {
 public:
  explicit ProgramRunner(const std::string& source, const CompileOptions& options = {}, int player_count = 1,
                         std::shared_ptr<const doom::Level> level = doom::test::one_room())
      : ProgramRunner(load(compiled(source, options)), player_count, std::move(level)) {}
  explicit ProgramRunner(std::shared_ptr<const doom::acs::Behavior> behavior, int player_count = 1,
                         std::shared_ptr<const doom::Level> level = doom::test::one_room())
      : world(std::move(level), shared_catalog(), std::move(behavior)) {
    doom::WorldOptions world_options;
    world_options.player_count = player_count;
    world_options.seed = 1;
    reset_world(world, world_options);
  }
  ProgramRunner& tic(int count = 1) {
    for (int i = 0; i < count; ++i) run_tic(world, {});
    return *this;
  }
  int32_t global(std::size_t index) const { return world.state().globals[index]; }
  const doom::acs::MachineState& machine() const { return world.state().scripts; }
  const std::string& error() const { return machine().last_error; }
  std::string message(std::size_t index = 0) const {
    return index < machine().hud_messages.size() ? machine().hud_messages[index].text : "nothing";
  }

  doom::World world;
};

/// What `body`, run in an OPEN script, leaves in global 1, declared as `result`.
inline int32_t run(const std::string& body, const std::string& outside = {}) {
  ProgramRunner game("global int 1:result;\n" + outside + "\nscript 1 OPEN\n{\n" + body + "\n}\n");
  game.tic();
  EXPECT_EQ(game.error(), "") << body;
  return game.global(1);
}
inline int32_t evaluate(const std::string& expression, const std::string& outside = {}) {
  return run("result = " + expression + ";", outside);
}

/// The message of a source that must not compile.
inline std::string failure(const std::string& source, const CompileOptions& options = {}) {
  Expected<CompiledScript> script = compile(source, "test.acs", options);
  EXPECT_FALSE(script.has_value()) << source;
  return script ? "" : script.error().message;
}

}  // namespace comrad::acs_compiler::test
