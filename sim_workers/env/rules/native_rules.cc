#include "sim_workers/env/rules/native_rules.h"

#include "sim_workers/env/rules/coop_health_gathering.h"

namespace comrad::sim {
namespace {

constexpr NativeRulesEntry kEntries[] = {
    {"coop_health_gathering", CoopHealthGatheringRules::add_actors, CoopHealthGatheringRules::make},
};

}  // namespace

const NativeRulesEntry* find_native_rules(const std::string& scenario) {
  for (const NativeRulesEntry& entry : kEntries)
    if (scenario == entry.scenario) return &entry;
  return nullptr;
}

}  // namespace comrad::sim
