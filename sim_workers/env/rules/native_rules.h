// Scenario rules that run natively until the script machine takes over: each one does what its scenario's ACS
// script does, behind the engine's ScriptHost, and is deleted when its script arrives. They stand here rather
// than in scenarios/ because they call the engine, and includes point the other way.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "scenarios/spec/layout_info.h"
#include "sim_workers/engine/play/world.h"

namespace comrad::sim {

/// One world's rules. on_open() starts them anew, so that one object serves every episode of its environment.
class NativeRules : public doom::ScriptHost {
 public:
  /// Hash of everything the rules remember, for determinism tests.
  virtual uint64_t state_hash() const = 0;
};

/// How to set up one scenario's rules.
struct NativeRulesEntry {
  const char* scenario;
  void (*add_actors)(doom::ActorCatalog& catalog);  ///< the scenario's own actor types
  std::unique_ptr<NativeRules> (*make)(const scenarios::LayoutInfo& layout,
                                       const doom::ActorCatalog& catalog);
};

/// Null where this build has no rules for the scenario: then its map's scripts are all there is.
const NativeRulesEntry* find_native_rules(const std::string& scenario);

}  // namespace comrad::sim
