#include "scenarios/spec/rewards.h"

#include <algorithm>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/text.h"

namespace comrad::scenarios {

std::vector<std::string> reward_kinds() { return {"delta", "rise", "fall", "new_max", "value", "event"}; }
std::vector<std::string> reward_scopes() { return {"own", "team"}; }

Status change_weights(ScenarioSpec& spec, const std::vector<RewardWeight>& weights) {
  for (const auto& [name, weight] : weights) {
    const auto term = std::ranges::find(spec.rewards, name, &RewardTerm::name);
    if (term == spec.rewards.end()) {
      std::vector<std::string> known;
      for (const RewardTerm& one : spec.rewards) known.push_back(one.name);
      return Error{ErrorCode::kBadInput,
                   "scenario " + spec.name + ": " + unknown_word("reward term", name, known)};
    }
    term->weight = weight;
  }
  if (!weights.empty() && spec.score == "return") spec.ceiling = 0, spec.maps_say_ceiling = false;
  return {};
}

RewardTracker::RewardTracker(const std::vector<RewardTerm>& terms, int num_agents) : num_agents_(num_agents) {
  const std::vector<std::string> kinds = reward_kinds();  // in the order of Kind
  for (const RewardTerm& term : terms) {
    const auto kind = std::find(kinds.begin(), kinds.end(), term.kind);
    COMRAD_CHECK(kind != kinds.end(), "the loader refuses unknown reward kinds");
    terms_.push_back({.kind = static_cast<Kind>(kind - kinds.begin()),
                      .weight = 0,
                      .cap = term.cap,
                      .schedule = term.weight,
                      .shared_by = term.per_agent ? num_agents : 1});
  }
  set_env_frames(0);
  before_.resize(terms_.size() * num_agents_);
  parts_.resize(before_.size());
}

void RewardTracker::set_env_frames(double env_frames) {
  for (Term& term : terms_) term.weight = term.schedule.at(env_frames) / term.shared_by;
}

void RewardTracker::reset(std::span<const double> value) {
  COMRAD_DCHECK(value.size() == before_.size(), "one value per term and agent");
  std::copy(value.begin(), value.end(), before_.begin());
  std::fill(parts_.begin(), parts_.end(), 0.0);
}

void RewardTracker::step(std::span<const double> value, std::span<double> reward,
                         std::span<const uint8_t> pays) {
  COMRAD_DCHECK(value.size() == before_.size() && static_cast<int>(reward.size()) == num_agents_ &&
                    (pays.empty() || pays.size() == value.size()),
                "one value per term and agent");
  for (int agent = 0; agent < num_agents_; ++agent) {
    double sum = 0.0;
    for (std::size_t i = 0; i < terms_.size(); ++i) {
      const Term& term = terms_[i];
      double& before = before_[i * num_agents_ + agent];
      const double now = value[i * num_agents_ + agent], change = now - before;
      double amount = 0.0;
      switch (term.kind) {
        case Kind::kDelta:
          amount = change;
          break;
        case Kind::kRise:
          amount = std::max(0.0, change);
          break;
        case Kind::kFall:
          amount = std::max(0.0, -change);
          break;
        case Kind::kNewMax:
          amount = std::max(0.0, change);
          break;
        case Kind::kValue:
          amount = now;
          break;
        case Kind::kEvent:
          amount = change > 0.0 ? 1.0 : 0.0;
          break;
      }
      before = term.kind == Kind::kNewMax ? std::max(before, now) : now;
      const bool pays_now = pays.empty() || pays[i * num_agents_ + agent] != 0;
      if (term.cap > 0.0) amount = std::clamp(amount, -term.cap, term.cap);
      sum += parts_[i * num_agents_ + agent] = pays_now ? term.weight * amount : 0.0;
    }
    reward[agent] = sum;
  }
}

}  // namespace comrad::scenarios
