#include "rollout_buffer/settings/algorithms.h"

#include <algorithm>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/text.h"

namespace comrad {
namespace {

constexpr AlgorithmRow kAlgorithmRows[] = {
    {.name = "ippo", .other_names = {"appo"}, .can_use_vtrace = true, .can_follow_kl = true},
    {.name = "mappo", .critic = CriticKind::kCentral, .can_use_vtrace = true, .can_follow_kl = true},
    // Its joint critic has one value for all, so they need one reward.
    {.name = "happo",
     .critic = CriticKind::kJoint,
     .separate_agents = true,
     .reward_share = RewardShare::kTeam,
     .versions_by_agent = true},
    {.name = "idqn",
     .other_names = {"dqn"},
     .family = Family::kQLearning,
     .critic = CriticKind::kNone,
     .reward_share = RewardShare::kOwn},
    // Mixers add the rewards up themselves.
    {.name = "vdn",
     .family = Family::kQLearning,
     .critic = CriticKind::kNone,
     .mixer = MixerKind::kVdn,
     .mixer_name = "vdn",
     .reward_share = RewardShare::kOwn},
    {.name = "qmix",
     .family = Family::kQLearning,
     .critic = CriticKind::kNone,
     .mixer = MixerKind::kQmix,
     .mixer_name = "qmix",
     .reward_share = RewardShare::kOwn},
    {.name = "qplex_d",
     .other_names = {"qplex"},
     .family = Family::kQLearning,
     .critic = CriticKind::kNone,
     .mixer = MixerKind::kQplexDuelling,
     .mixer_name = "dmaq",
     .reward_share = RewardShare::kOwn},
    {.name = "qplex_q",
     .family = Family::kQLearning,
     .critic = CriticKind::kNone,
     .mixer = MixerKind::kQplexAttention,
     .mixer_name = "dmaq_qatten",
     .reward_share = RewardShare::kOwn},
};

std::vector<const AlgorithmRow*>& rows() {
  static std::vector<const AlgorithmRow*> all = [] {
    std::vector<const AlgorithmRow*> built_in;
    for (const AlgorithmRow& row : kAlgorithmRows) built_in.push_back(&row);
    return built_in;
  }();
  return all;
}

}  // namespace

const std::vector<const AlgorithmRow*>& algorithm_rows() { return rows(); }

std::vector<std::string> algorithm_names() {
  std::vector<std::string> names;
  for (const AlgorithmRow* row : rows()) names.emplace_back(row->name);
  return names;
}

const AlgorithmRow* find_algorithm(std::string_view name) {
  for (const AlgorithmRow* row : rows()) {
    if (same_ignoring_case(row->name, name)) return row;
    for (const std::string_view other : row->other_names)
      if (!other.empty() && same_ignoring_case(other, name)) return row;
  }
  return nullptr;
}

Expected<const AlgorithmRow*> algorithm_named(std::string_view name) {
  if (const AlgorithmRow* row = find_algorithm(name)) return row;
  return Error{ErrorCode::kBadInput, unknown_word("algorithm", name, algorithm_names())};
}

void add_algorithm(const AlgorithmRow& row) {
  COMRAD_CHECK(find_algorithm(row.name) == nullptr, "an algorithm's name must be new");
  rows().push_back(&row);
}

AlgorithmName::AlgorithmName(std::string_view name) : row_(find_algorithm(name)) {
  COMRAD_CHECK(row_ != nullptr, "the algorithm must be one of algorithm_rows()");
}

}  // namespace comrad
