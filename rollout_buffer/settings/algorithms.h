// The learning algorithms, one row each: its names and all that the rest of the system needs of it. No code compares names;
// settings, network, replay and learner read the row's traits. The losses are in learner/algorithms. Stage: before a run.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

enum class Family {
  kOnPolicy,   ///< policy and value from every batch once
  kQLearning,  ///< Q-values from a replay
};

/// Where values come from.
enum class CriticKind {
  kOwn,      ///< the agent's own features to one value
  kCentral,  ///< the features of all N agents of a world to a value for each, by mappo_critic_view
  kJoint,    ///< N encoders (and cores) of the critic's own, side by side, to one value for all
  kNone,     ///< Q-learning: logits are Q-values, the value of a row is the sum of its heads' maxima
};

/// How the agents' Q-values become the team's.
enum class MixerKind { kNone, kVdn, kQmix, kQplexDuelling, kQplexAttention };

/// Which part of the team's reward an agent gets where no share is set.
enum class RewardShare { kOfTheScenario, kTeam, kOwn };

/// One algorithm. `name` is the spelling that travels through the system.
struct AlgorithmRow {
  std::string_view name;
  std::array<std::string_view, 2> other_names = {};  ///< accepted as well, in any case
  Family family = Family::kOnPolicy;
  CriticKind critic = CriticKind::kOwn;
  MixerKind mixer = MixerKind::kNone;
  std::string_view mixer_name = "";  ///< what --mixer calls it
  bool separate_agents = false;      ///< always one network per agent
  RewardShare reward_share = RewardShare::kOfTheScenario;
  bool versions_by_agent = false;  ///< a batch makes a version for every agent and one for the critic
  bool can_use_vtrace = false;
  bool can_follow_kl = false;       ///< has one policy whose KL an adaptive learning rate can follow
  std::string_view recipe_of = "";  ///< the row whose recipes it takes, besides those under its name

  bool learns_q_values() const { return family == Family::kQLearning; }
  bool mixes_q_values() const { return mixer != MixerKind::kNone; }
  /// Q-learning agents that learn from their own rewards alone.
  bool learns_alone() const { return learns_q_values() && !mixes_q_values(); }
  /// Its critic is the team's, or its mixer's weights are made from a state.
  bool can_see_global_state() const {
    return critic == CriticKind::kCentral || critic == CriticKind::kJoint ||
           (mixes_q_values() && mixer != MixerKind::kVdn);
  }
  /// Policy versions that one batch makes.
  int64_t versions_per_batch(int64_t num_agents) const { return versions_by_agent ? num_agents + 1 : 1; }
};

/// Every known algorithm, in the order of messages. Rows stay where they are for the life of the process.
const std::vector<const AlgorithmRow*>& algorithm_rows();
std::vector<std::string> algorithm_names();

/// The row of a name in any case or of another name ("APPO", "DQN", "QPLEX"); null where no row has it.
const AlgorithmRow* find_algorithm(std::string_view name);
/// As find_algorithm. Errors: kBadInput for an unknown name, naming the nearest and the known ones.
Expected<const AlgorithmRow*> algorithm_named(std::string_view name);

/// Makes an algorithm of one's own known to the settings. `row` must outlive the process's use of settings; its names must
/// be new. learner/algorithms/registry.h gives it a learner. Threads: one, before settings are read.
void add_algorithm(const AlgorithmRow& row);

/// The value of the setting `algo`: a known algorithm.
class AlgorithmName {
 public:
  /// `name` must be known (find_algorithm).
  AlgorithmName(std::string_view name);  // NOLINT: a name is one
  AlgorithmName(const char* name) : AlgorithmName(std::string_view(name)) {}
  AlgorithmName(const std::string& name) : AlgorithmName(std::string_view(name)) {}
  AlgorithmName(const AlgorithmRow& row) : row_(&row) {}

  const AlgorithmRow* operator->() const { return row_; }
  const AlgorithmRow& operator*() const { return *row_; }
  std::string name() const { return std::string(row_->name); }
  bool operator==(const AlgorithmName& other) const { return row_ == other.row_; }

 private:
  const AlgorithmRow* row_;
};

}  // namespace comrad
