// The settings of one run as the program reads them: a struct for every subject, whose members are the rows of the .def
// file of that name. A row is all there is to a setting: type, name, default, limits and help stand nowhere else, and
// setting.h makes flags, TOML, help and checks from them. The launcher merges the layers and writes config.toml; every
// worker reads that file (layers.h) and nothing else. Stage: before a run.
#pragma once

#include <cstdint>
#include <string>

#include "rollout_buffer/settings/algorithms.h"
#include "rollout_buffer/settings/schedule.h"
#include "rollout_buffer/settings/words.h"

namespace comrad {

#define SETTING(TYPE, NAME, DEFAULT, ...) TYPE NAME = DEFAULT;

struct RunSettings {
#include "rollout_buffer/settings/run.def"
};
struct EnvironmentSettings {
#include "rollout_buffer/settings/environment.def"
};
struct CollectionSettings {
#include "rollout_buffer/settings/collection.def"
};
struct NetworkSettings {
#include "rollout_buffer/settings/network.def"
};
struct OptimisationSettings {
#include "rollout_buffer/settings/optimisation.def"
};
struct OnPolicySettings {
#include "rollout_buffer/settings/on_policy.def"
};
struct QLearningSettings {
#include "rollout_buffer/settings/q_learning.def"
};
struct ReplaySettings {
#include "rollout_buffer/settings/replay.def"
};
struct MixerSettings {
#include "rollout_buffer/settings/mixers.def"
};
struct CurriculumSettings {
#include "rollout_buffer/settings/curriculum.def"
};
struct HostSettings {
#include "rollout_buffer/settings/hosts.def"
};

#undef SETTING

/// The merged settings of one run. Defaults are the built-in layer; 0 means "auto" where a setting's help notes it.
struct RunConfig {
  RunSettings run;
  EnvironmentSettings environment;
  CollectionSettings collection;
  NetworkSettings network;
  OptimisationSettings optimisation;
  OnPolicySettings on_policy;
  QLearningSettings q_learning;
  ReplaySettings replay;
  MixerSettings mixers;
  CurriculumSettings curriculum;
  HostSettings hosts;
};

/// Whether the team's critic or mixer is shown the world's true state.
inline bool sees_global_state(const RunConfig& config) {
  return config.network.critic_state == CriticState::kGlobal && config.run.algo->can_see_global_state();
}

/// Whether the network has layer normalisation behind its linear layers and its core.
inline bool has_layer_norm(const RunConfig& config) {
  return config.network.q_layer_norm && config.run.algo->learns_q_values();
}

}  // namespace comrad
