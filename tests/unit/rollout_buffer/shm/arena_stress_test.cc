// Kills peers of an arena half way, again and again, and shows that nothing they held stays lost and nothing
// that arrives is damaged. Simulators, the policy worker and the learner are their own processes; each
// takes a random moment to die by SIGKILL. The parent plays the supervisor.
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/journal.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/patience.h"
#include "tests/support/small_arena.h"

namespace comrad::shm {
namespace arena_stress_test {

constexpr int kPolicyWorker = 2, kLearner = 3, kPeers = 4;  // 0 and 1 are the simulators
constexpr std::size_t kWeightsBytes = 60'000;

/// What row `step` of a rollout must hold; the reader recomputes it from the header.
float tag_of(uint32_t env, uint64_t rollout, int step, int agent) {
  return static_cast<float>(mix64(env * 1'000'003ull + rollout * 1009 + static_cast<uint64_t>(step) * 17 +
                                  static_cast<uint64_t>(agent)) >>
                            44);
}

[[noreturn]] void broken(const char* what) {
  (void)!write(2, what, std::strlen(what));
  (void)!write(2, "\n", 1);
  _exit(99);
}

[[noreturn]] void play_simulator(const Arena& arena, int index) {
  const int envs = arena.shape().envs_per_worker, steps = arena.shape().trajectory.rollout_steps;
  for (;;) {
    for (int local = 0; local < envs; ++local) {
      const int env = index * envs + local;
      std::optional<uint32_t> slab_index;
      while (!(slab_index = arena.slabs().acquire(index))) {
        const uint32_t heard = listen(arena.control().slab_released);
        wait(arena.control().slab_released, heard, 1000);
      }
      SlabHeader& header = arena.slabs().header(static_cast<int>(*slab_index));
      header.env_index = static_cast<uint32_t>(env);
      header.rollout_index = arena.journals().header(env).rollout_index;
      const SlabView slab = arena.slabs().view(static_cast<int>(*slab_index));
      StepSlot& slot = arena.step_slots().slot(env);
      for (int step = 0; step < steps; ++step) {
        if (slot.state.load() != SlotState::kIdle) broken("a slot was not idle before its commit");
        slot.slab_index = *slab_index;
        slot.step = static_cast<uint32_t>(step);
        slot.step_id = ++arena.journals().header(env).step_id;
        Doorbell& acted = arena.step_slots().acted(index, 0);
        slot.state.store(SlotState::kReady, std::memory_order_release);
        ring(arena.step_slots().ready(0));
        for (;;) {
          const uint32_t heard = listen(acted);
          if (advance(slot, SlotState::kActed, SlotState::kIdle)) break;
          wait(acted, heard, 1000);
        }
        if (slab.value(step, 0) != static_cast<float>(slot.step_id % 100'000))
          broken("an answer is not ours");
        for (int agent = 0; agent < 2; ++agent)
          slab.reward(step, agent) = tag_of(header.env_index, header.rollout_index, step, agent);
        arena.accounts().of(env).made.fetch_add(1);
        header.length = static_cast<uint32_t>(step + 1);
      }
      ++arena.journals().header(env).rollout_index;
      EpisodeRecord record{};
      record.env_index = static_cast<uint32_t>(env);
      record.episode_id = record.episode_seed = arena.journals().header(env).rollout_index;
      arena.episodes().write(record);
      arena.slabs().seal(*slab_index);
    }
  }
}

[[noreturn]] void play_policy(const Arena& arena) {
  for (;;) {
    Doorbell& ready = arena.step_slots().ready(0);
    const uint32_t heard = listen(ready);
    bool found = false;
    for (int env = 0; env < arena.shape().env_count(); ++env) {
      StepSlot& slot = arena.step_slots().slot(env);
      if (!advance(slot, SlotState::kReady, SlotState::kInBatch)) continue;
      found = true;
      if (slot.slab_index >= static_cast<uint32_t>(arena.shape().slab_count)) broken("a slot names no slab");
      const SlabHeader& header = arena.slabs().header(static_cast<int>(slot.slab_index));
      if (header.state.load() != SlabState::kFilling || header.env_index != static_cast<uint32_t>(env))
        broken("a request names another simulator's slab");
      arena.slabs().view(static_cast<int>(slot.slab_index)).value(static_cast<int>(slot.step), 0) =
          static_cast<float>(slot.step_id % 100'000);
      if (!advance(slot, SlotState::kInBatch, SlotState::kActed)) broken("a slot left a batch by itself");
      ring(arena.step_slots().acted(env / arena.shape().envs_per_worker, 0));
    }
    if (!found) wait(ready, heard, 1000);
  }
}

[[noreturn]] void play_learner(const Arena& arena) {
  std::vector<std::byte> weights(kWeightsBytes);
  for (;;) {
    const uint32_t heard = listen(arena.control().slab_sealed);
    const std::vector<uint32_t> drained = arena.slabs().drain(3);
    for (const uint32_t index : drained) {
      const SlabHeader& header = arena.slabs().header(static_cast<int>(index));
      const SlabView slab = arena.slabs().view(static_cast<int>(index));
      if (header.length != 8 || header.owner.load() != 0) broken("a sealed slab is not whole");
      for (int step = 0; step < 8; ++step)
        for (int agent = 0; agent < 2; ++agent)
          if (slab.reward(step, agent) != tag_of(header.env_index, header.rollout_index, step, agent))
            broken("a sealed slab holds foreign rows");
      arena.learner_counters().decisions.fetch_add(
          8 * 2);  // before it lets go: what is lost with it is still there
      arena.slabs().release(index);
    }
    if (drained.empty()) wait(arena.control().slab_sealed, heard, 1000);
    const PolicyVersion version = arena.weights().version() + 1;
    Rng rng(uint64_t{version});
    for (std::size_t word = 0; word + 8 <= weights.size(); word += 8) {
      const uint64_t bits = rng.next();
      std::memcpy(weights.data() + word, &bits, 8);
    }
    arena.weights().publish(weights, version);
    arena.learner_counters().batches.fetch_add(1);
    usleep(200);
  }
}

pid_t start_peer(const Arena& arena, int peer) {
  const pid_t child = fork();
  if (child != 0) return child;
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // a failed test leaves no process behind
  if (peer == kPolicyWorker) play_policy(arena);
  if (peer == kLearner) play_learner(arena);
  play_simulator(arena, peer);
}

/// SIGKILLs a peer and collects it. False if it had already left by itself, which none of them does
/// in health.
bool kill_peer(pid_t peer) {
  int status = 0;
  if (waitpid(peer, &status, WNOHANG) != 0) return false;
  kill(peer, SIGKILL);
  return waitpid(peer, &status, 0) == peer && WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
}

void reclaim(const Arena& arena, int peer) {
  if (peer == kPolicyWorker) {
    (void)arena.reclaim_policy_worker(0);
  } else if (peer == kLearner) {
    (void)arena.reclaim_learner();
  } else {
    (void)arena.reclaim_sim_worker(peer);
  }
}

TEST(ArenaStress, NothingIsLostWhenPeersAreKilledHalfWay) {
  ArenaShape shape = test::small_arena_shape();
  shape.splits_per_worker = 1;
  shape.slab_count = 5;  // fewer than environments, so that every slab is fought for
  shape.weights_bytes = static_cast<int64_t>(kWeightsBytes);
  const Arena arena = *Arena::create(shape, 1);
  Rng rng(uint64_t{2024});
  pid_t peers[kPeers];
  for (int peer = 0; peer < kPeers; ++peer) peers[peer] = start_peer(arena, peer);

  std::vector<std::byte> weights, expected(kWeightsBytes);
  uint64_t weights_read = 0, episodes = 0, kills = 0;
  uint64_t lost_with_learners = 0;
  PolicyVersion newest = 0;
  // To the decision: what the learner took is trained on or lost with one of its lives, three slabs at most.
  const auto check_learner = [&] {
    const uint64_t taken = arena.accounts().counts().taken,
                   learned = arena.learner_counters().decisions.load();
    ASSERT_GE(taken, learned + lost_with_learners);
    ASSERT_LE(taken - learned - lost_with_learners, 3u * 8 * 2);
    lost_with_learners = taken - learned;
  };
  const double end_s = test::deadline_s();
  while ((kills < 1500 || episodes < 200 || weights_read < 200) && monotonic_s() < end_s) {
    usleep(rng.below(4000));
    int victim = static_cast<int>(rng.below(kPeers));
    ASSERT_TRUE(kill_peer(peers[victim]))
        << "peer " << victim << " stopped by itself, after " << kills << " kills";
    ++kills;
    // Now and then the policy worker dies together with a simulator: the supervisor then reclaims it first.
    const bool is_double = victim < kPolicyWorker && rng.below(4) == 0;
    if (is_double) {
      ASSERT_TRUE(kill_peer(peers[kPolicyWorker]));
      reclaim(arena, kPolicyWorker);
    }
    reclaim(arena, victim);
    if (victim == kLearner) check_learner();
    if (victim < kPolicyWorker) {
      const uint32_t dead = static_cast<uint32_t>(victim) + 1;
      for (int slab = 0; slab < shape.slab_count; ++slab)
        EXPECT_NE(arena.slabs().header(slab).owner.load(), dead);
      for (int local = 0; local < shape.envs_per_worker; ++local)
        EXPECT_EQ(arena.step_slots().slot(victim * shape.envs_per_worker + local).state.load(),
                  SlotState::kIdle);
    }
    peers[victim] = start_peer(arena, victim);
    if (is_double) peers[kPolicyWorker] = start_peer(arena, kPolicyWorker);

    while (const std::optional<EpisodeRecord> record = arena.episodes().read(EpisodeReader::kSupervisor)) {
      ASSERT_EQ(record->episode_id, record->episode_seed) << "a record is damaged";
      ++episodes;
    }
    if (!arena.weights().has_any()) continue;
    const Expected<PolicyVersion> version = arena.weights().read(weights);
    ASSERT_TRUE(version) << version.error().message;
    ASSERT_GE(*version, newest) << "versions do not fall";
    newest = *version;
    Rng content(uint64_t{*version});
    for (std::size_t word = 0; word + 8 <= expected.size(); word += 8) {
      const uint64_t bits = content.next();
      std::memcpy(expected.data() + word, &bits, 8);
    }
    ASSERT_TRUE(weights == expected) << "version " << *version << " is torn";
    ++weights_read;
  }

  // All processes die; after the supervisor's last look every slab and slot is free again.
  for (const int peer : {kPolicyWorker, kLearner, 0, 1})
    EXPECT_TRUE(kill_peer(peers[peer])) << "peer " << peer;
  for (const int peer : {kPolicyWorker, kLearner, 0, 1}) reclaim(arena, peer);
  check_learner();
  const DecisionCounts counts = arena.accounts().counts();
  const auto sealed = static_cast<uint64_t>(arena.slabs().sealed_count()) * 8 * 2;
  EXPECT_EQ(counts.made,
            arena.learner_counters().decisions.load() + lost_with_learners + sealed + counts.lost);
  EXPECT_EQ(counts.sealed, counts.taken + sealed);
  for (const uint32_t slab : arena.slabs().drain(shape.slab_count)) arena.slabs().release(slab);
  for (int env = 0; env < shape.env_count(); ++env)
    EXPECT_EQ(arena.step_slots().slot(env).state.load(), SlotState::kIdle);
  for (int count = 0; count < shape.slab_count; ++count)
    EXPECT_TRUE(arena.slabs().acquire(0)) << "a slab is lost";

  std::printf("%lu decisions made, %lu learned from, %lu lost with simulators, %lu with learners\n",
              static_cast<unsigned long>(counts.made),
              static_cast<unsigned long>(arena.learner_counters().decisions.load()),
              static_cast<unsigned long>(counts.lost), static_cast<unsigned long>(lost_with_learners));
  EXPECT_GT(counts.lost, 0u);
  std::printf("%lu kills, %lu rollouts, %lu episodes, weights read %lu times up to version %u\n",
              static_cast<unsigned long>(kills),
              static_cast<unsigned long>(arena.control().slabs_sealed.load()),
              static_cast<unsigned long>(episodes), static_cast<unsigned long>(weights_read), newest);
  EXPECT_GE(kills, 1500u);
  EXPECT_GE(episodes, 200u);
  EXPECT_GE(weights_read, 200u);
}

}  // namespace arena_stress_test
}  // namespace comrad::shm
