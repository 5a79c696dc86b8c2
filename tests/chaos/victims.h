// Processes of running trainings that are killed and stopped at random.
#pragma once

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "tests/integration/running_program.h"

namespace comrad::test {

/// COMRAD_CHAOS_SEED, or another one each time; printed.
inline uint64_t chosen_seed() {
  const auto seed =
      static_cast<uint64_t>(number_of("COMRAD_CHAOS_SEED", static_cast<double>(std::random_device()())));
  std::printf("COMRAD_CHAOS_SEED=%lu\n", static_cast<unsigned long>(seed));
  return seed;
}

/// The supervisor gives a worker up that dies ten times in a minute.
constexpr double kDeathsWindowSeconds = 60;
constexpr std::size_t kMostDeathsInWindow = 7;

/// One kind of a run's workers.
struct VictimKind {
  std::string run_dir, program, word;
  int weight = 1;                 ///< how often it is chosen
  bool may_be_terminated = true;  ///< SIGTERM as well as SIGKILL; one that ends a run must not get it
};

class Victims {
 public:
  Victims(std::vector<VictimKind> kinds, Rng& rng) : kinds_(std::move(kinds)), rng_(rng) {
    for (const VictimKind& kind : kinds_) weights_ += kind.weight;
  }
  Victims(const Victims&) = delete;
  Victims& operator=(const Victims&) = delete;
  ~Victims() { let_go_on(); }

  /// Kills or stops one process.
  void strike() {
    std::erase_if(stopped_,
                  [](const auto& one) { return one.first < now_s() && (kill(one.second, SIGCONT), true); });
    const VictimKind& kind = choose();
    const std::vector<pid_t> alive = processes_of(kind.run_dir, kind.program);
    if (alive.empty()) return;
    const pid_t victim = alive[rng_.below(static_cast<uint32_t>(alive.size()))];
    if (rng_.below(3) == 0) {
      kill(victim, SIGSTOP);
      stopped_.emplace_back(now_s() + 0.001 * rng_.below(4000), victim);
      ++stops;
      return;
    }
    std::deque<double>& past = deaths_[kind.word];  // of a kind rather than a worker: on the safe side
    while (!past.empty() && now_s() - past.front() > kDeathsWindowSeconds) past.pop_front();
    if (past.size() >= kMostDeathsInWindow) return;
    past.push_back(now_s());
    kill(victim, kind.may_be_terminated && rng_.below(4) == 0 ? SIGTERM : SIGKILL);
    ++kills[kind.word];
  }
  void let_go_on() {
    for (const auto& [when, pid] : stopped_) kill(pid, SIGCONT);
    stopped_.clear();
  }
  /// "3 sim, 2 learner".
  std::string kills_text() const {
    std::string text;
    for (const auto& [word, count] : kills)
      text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + word;
    return text;
  }

  std::map<std::string, int> kills;
  int stops = 0;

 private:
  const VictimKind& choose() {
    auto left = static_cast<int>(rng_.below(static_cast<uint32_t>(weights_)));
    for (const VictimKind& kind : kinds_)
      if ((left -= kind.weight) < 0) return kind;
    return kinds_.back();
  }

  const std::vector<VictimKind> kinds_;
  Rng& rng_;
  int weights_ = 0;
  std::map<std::string, std::deque<double>> deaths_;
  std::vector<std::pair<double, pid_t>> stopped_;  // when each continues
};

}  // namespace comrad::test
