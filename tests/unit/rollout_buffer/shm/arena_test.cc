#include "rollout_buffer/shm/arena.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <set>
#include <thread>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/journal.h"
#include "rollout_buffer/shm/layout_mailbox.h"
#include "rollout_buffer/shm/learner_report.h"
#include "rollout_buffer/shm/remote_worker_slot.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"
#include "rollout_buffer/shm/weight_buffers.h"
#include "tests/support/small_arena.h"

namespace comrad::shm {
namespace arena_test {

using test::sealed_copy;
using test::small_arena_shape;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

Arena make_arena(const ArenaShape& shape = small_arena_shape()) {
  Expected<Arena> arena = Arena::create(shape, 7);
  EXPECT_TRUE(arena) << arena.error().message;
  return *std::move(arena);
}

SlabState state_of(const Arena& arena, uint32_t slab) {
  return arena.slabs().header(static_cast<int>(slab)).state.load();
}

std::vector<std::byte> weights_of(PolicyVersion version, std::size_t count) {
  Rng rng(uint64_t{version});
  std::vector<std::byte> bytes(count);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(rng.next());
  return bytes;
}

TEST(Arena, StartsIdleFreeAndWithoutWeights) {
  const Arena arena = make_arena();
  for (int env = 0; env < arena.shape().env_count(); ++env)
    EXPECT_EQ(arena.step_slots().slot(env).state.load(), SlotState::kIdle);
  for (uint32_t slab = 0; slab < 24; ++slab) EXPECT_EQ(state_of(arena, slab), SlabState::kFree);
  EXPECT_EQ(arena.control().run_state.load(), RunState::kStarting);
  EXPECT_EQ(arena.control().rollouts_allowed.load(), 0u);
  EXPECT_EQ(arena.control().episodes_per_run.load(), UINT64_MAX);
  EXPECT_FALSE(arena.weights().has_any());
  EXPECT_FALSE(arena.episodes().read(EpisodeReader::kSupervisor));
  EXPECT_EQ(arena.run_id(), 7u);
}

TEST(Arena, APeerThatAdoptsItSeesTheSameParts) {
  const Arena arena = make_arena();
  const Expected<Arena> peer = Arena::adopt(dup(arena.descriptor()));
  ASSERT_TRUE(peer) << peer.error().message;
  EXPECT_EQ(peer->run_id(), 7u);
  EXPECT_EQ(peer->shape().slab_count, 24);
  arena.step_slots().slot(5).step_id = 99;
  arena.slabs().view(23).frame(8, 1)[71] = 200;
  arena.step_slots().recurrent(7, 1)[9] = 1.5f;
  arena.journals().action(7, 63)[3] = 2;
  arena.step_slots().round(1, 1).request_count.store(3);
  EXPECT_EQ(peer->step_slots().slot(5).step_id, 99u);
  EXPECT_EQ(peer->slabs().view(23).frame(8, 1)[71], 200);
  EXPECT_EQ(peer->step_slots().recurrent(7, 1)[9], 1.5f);
  EXPECT_EQ(peer->journals().action(7, 63)[3], 2);
  EXPECT_EQ(peer->step_slots().round(1, 1).request_count.load(), 3u);
}

TEST(Arena, PartsDoNotOverlap) {
  const Arena arena = make_arena();
  std::vector<std::pair<const void*, std::size_t>> parts = {
      {&arena.control(), sizeof(ControlBlock)},
      {&arena.learner_counters(), sizeof(WorkerCounters)},
      {&arena.step_slots().ready(0), sizeof(Doorbell)}};
  for (int worker = 0; worker < 2; ++worker) {
    parts.emplace_back(&arena.sim_counters(worker), sizeof(WorkerCounters));
    for (int split = 0; split < 2; ++split) {
      parts.emplace_back(&arena.step_slots().acted(worker, split), sizeof(Doorbell));
      parts.emplace_back(&arena.step_slots().round(worker, split), sizeof(SplitRound));
    }
  }
  parts.emplace_back(&arena.policy_counters(0), sizeof(WorkerCounters));
  for (int env = 0; env < 8; ++env) {
    parts.emplace_back(&arena.step_slots().slot(env), sizeof(StepSlot));
    parts.emplace_back(&arena.journals().header(env), sizeof(JournalHeader));
    parts.emplace_back(&arena.layout_mailboxes().of(env), sizeof(LayoutMailbox));
    parts.emplace_back(&arena.accounts().of(env), sizeof(EnvAccount));
    for (uint64_t parity = 0; parity < 2; ++parity)
      parts.emplace_back(arena.step_slots().recurrent(env, parity).data(),
                         arena.step_slots().recurrent(env, parity).size_bytes());
    for (int step = 0; step < 64; ++step)
      parts.emplace_back(arena.journals().action(env, step).data(),
                         arena.journals().action(env, step).size());
  }
  for (int slab = 0; slab < 24; ++slab) {
    parts.emplace_back(&arena.slabs().header(slab), sizeof(SlabHeader));
    parts.emplace_back(arena.slabs().view(slab).frames(0).data(),
                       static_cast<std::size_t>(arena.slabs().offsets().slab_bytes));
  }
  std::sort(parts.begin(), parts.end());
  for (std::size_t index = 1; index < parts.size(); ++index)
    EXPECT_LE(static_cast<const std::byte*>(parts[index - 1].first) + parts[index - 1].second,
              parts[index].first);
}

TEST(LayoutMailbox, AnAssignmentIsTakenOnceAndAMissingOneIsCountedAsLate) {
  const Arena arena = make_arena();
  LayoutMailbox& mailbox = arena.layout_mailboxes().of(3);
  mailbox.take_assignment();
  EXPECT_EQ(mailbox.late.load(), 1u);
  EXPECT_TRUE(mailbox.is_due());
  mailbox.assign(5);
  EXPECT_FALSE(mailbox.is_due());
  EXPECT_EQ(mailbox.playing.load(), 0u);
  mailbox.take_assignment();
  EXPECT_EQ(mailbox.playing.load(), 5u);
  EXPECT_TRUE(mailbox.is_due());
  mailbox.take_assignment();
  EXPECT_EQ(mailbox.playing.load(), 5u) << "it is played once more";
  EXPECT_EQ(mailbox.late.load(), 2u);
}

TEST(Arena, CreateRefusesBadShapes) {
  const auto expect_refusal = [](auto spoil, const char* words) {
    ArenaShape shape = small_arena_shape();
    spoil(shape);
    const Expected<Arena> arena = Arena::create(shape, 1);
    ASSERT_FALSE(arena) << words;
    EXPECT_THAT(arena.error().message, HasSubstr(words));
  };
  expect_refusal([](ArenaShape& s) { s.trajectory.env.num_agents = 0; }, "num_agents");
  expect_refusal([](ArenaShape& s) { s.splits_per_worker = 3; }, "splits_per_worker");
  expect_refusal([](ArenaShape& s) { s.envs_per_worker = 1; }, "splits_per_worker is 2");
  expect_refusal([](ArenaShape& s) { s.slab_count = 0; }, "slab_count");
  expect_refusal([](ArenaShape& s) { s.weights_bytes = -1; }, "weights_bytes");
  expect_refusal(
      [](ArenaShape& s) { s.trajectory.env.width = s.trajectory.env.height = 4096, s.slab_count = 1 << 20; },
      "--trajectory_slabs");
}

TEST(Arena, AdoptTrustsNoNumberOfTheHeader) {
  const Arena arena = make_arena();
  const int64_t size = Arena::size_bytes(arena.shape());
  const Expected<Segment> whole = Segment::adopt(dup(arena.descriptor()));
  ASSERT_TRUE(whole);
  const std::byte* const bytes = whole->data();  // the header is the segment's first part
  ASSERT_TRUE(Arena::adopt(sealed_copy(bytes, static_cast<std::size_t>(size), size)))
      << "an honest copy is fine";
  EXPECT_FALSE(Arena::adopt(sealed_copy(bytes, 8, 8))) << "no room for a header";
  EXPECT_FALSE(Arena::adopt(sealed_copy(bytes, static_cast<std::size_t>(size), size - 4096)))
      << "shorter than its shapes";
  EXPECT_FALSE(Arena::adopt(sealed_copy(bytes, static_cast<std::size_t>(size), size + 4096)))
      << "longer than its shapes";

  // Any damage to the header's words is either noticed or leaves sizes that fit the segment.
  const std::size_t header_bytes = 24 + sizeof(ArenaShape);
  int refused = 0, tried = 0;
  for (std::size_t word = 0; word + 4 <= header_bytes; word += 4) {
    for (const uint32_t value : {0u, 1u, 0x7FFFFFFFu, 0x80000000u, 0xFFFFFFFFu, 0x10000u}) {
      std::vector<std::byte> copy(bytes, bytes + size);
      std::memcpy(copy.data() + word, &value, 4);
      const Expected<Arena> adopted = Arena::adopt(sealed_copy(copy.data(), copy.size(), size));
      ++tried;
      if (!adopted) {
        EXPECT_EQ(adopted.error().code, ErrorCode::kBadFormat);
        ++refused;
        continue;
      }
      EXPECT_EQ(Arena::size_bytes(adopted->shape()), size);
      adopted->slabs()
          .view(adopted->shape().slab_count - 1)
          .valid(adopted->shape().trajectory.rollout_steps - 1) = 1;
    }
  }
  EXPECT_GT(refused, tried / 2);
}

TEST(Arena, WrongVersionReportsWhatToDo) {
  const Arena arena = make_arena();
  const Expected<Segment> whole = Segment::adopt(dup(arena.descriptor()));
  ASSERT_TRUE(whole);
  std::vector<std::byte> copy(whole->data(), whole->data() + whole->size_bytes());
  const uint32_t version = kArenaVersion + 1;
  std::memcpy(copy.data() + 4, &version, 4);
  const Expected<Arena> adopted = Arena::adopt(sealed_copy(copy.data(), copy.size(), whole->size_bytes()));
  ASSERT_FALSE(adopted);
  EXPECT_THAT(adopted.error().message, HasSubstr("start all programs of a run from one build"));
}

TEST(StepSlot, AdvanceMovesOnlyFromTheNamedState) {
  const Arena arena = make_arena();
  StepSlot& slot = arena.step_slots().slot(0);
  EXPECT_FALSE(advance(slot, SlotState::kReady, SlotState::kInBatch)) << "nothing was committed";
  slot.state.store(SlotState::kReady);
  EXPECT_TRUE(advance(slot, SlotState::kReady, SlotState::kInBatch));
  EXPECT_FALSE(advance(slot, SlotState::kReady, SlotState::kInBatch)) << "two gatherers, one wins";
  EXPECT_TRUE(advance(slot, SlotState::kInBatch, SlotState::kActed));
  EXPECT_TRUE(advance(slot, SlotState::kActed, SlotState::kIdle));
}

TEST(Slabs, WalkThroughTheirWholeLife) {
  const Arena arena = make_arena();
  const std::optional<uint32_t> slab = arena.slabs().acquire(1);
  ASSERT_TRUE(slab);
  EXPECT_EQ(state_of(arena, *slab), SlabState::kFilling);
  EXPECT_EQ(arena.slabs().header(static_cast<int>(*slab)).owner.load(), 2u);
  EXPECT_TRUE(arena.slabs().drain(10).empty()) << "not sealed yet";
  const uint32_t heard = listen(arena.control().slab_sealed);
  arena.slabs().seal(*slab);
  EXPECT_NE(listen(arena.control().slab_sealed), heard);
  EXPECT_EQ(state_of(arena, *slab), SlabState::kSealed);
  EXPECT_EQ(arena.slabs().sealed_count(), 1);
  EXPECT_THAT(arena.slabs().drain(10), ElementsAre(*slab));
  EXPECT_EQ(state_of(arena, *slab), SlabState::kLearning);
  EXPECT_TRUE(arena.slabs().drain(10).empty()) << "drained once";
  const uint32_t freed = listen(arena.control().slab_released);
  arena.slabs().release(*slab);
  EXPECT_NE(listen(arena.control().slab_released), freed);
  EXPECT_EQ(state_of(arena, *slab), SlabState::kFree);
}

TEST(Slabs, RunOutAndComeBack) {
  const Arena arena = make_arena();
  std::set<uint32_t> taken;
  while (const std::optional<uint32_t> slab = arena.slabs().acquire(0)) taken.insert(*slab);
  EXPECT_EQ(taken.size(), 24u) << "every slab once";
  EXPECT_FALSE(arena.slabs().acquire(1)) << "back-pressure";
  arena.slabs().abandon(13);
  EXPECT_EQ(arena.slabs().acquire(1), 13u);
}

TEST(Slabs, AreDrainedInSealingOrderWhateverTheirIndex) {
  const Arena arena = make_arena();
  std::vector<uint32_t> order;
  for (int count = 0; count < 24; ++count) order.push_back(*arena.slabs().acquire(0));
  std::reverse(order.begin(), order.end());
  std::swap(order[3], order[17]);
  for (const uint32_t slab : order) arena.slabs().seal(slab);
  std::vector<uint32_t> drained = arena.slabs().drain(5);
  EXPECT_EQ(drained, std::vector<uint32_t>(order.begin(), order.begin() + 5));
  EXPECT_EQ(arena.slabs().sealed_count(), 19);
  drained = arena.slabs().drain(100);
  EXPECT_EQ(drained, std::vector<uint32_t>(order.begin() + 5, order.end()));
}

TEST(Slabs, AShareOfTheEnvironmentsIsDrainedByItsReaderAlone) {
  const Arena arena = make_arena();
  std::vector<uint32_t> slabs;
  for (uint32_t env = 0; env < 8; ++env) {
    slabs.push_back(*arena.slabs().acquire(0));
    arena.slabs().header(static_cast<int>(slabs.back())).env_index = env;
    arena.slabs().seal(slabs.back());
  }
  // Blocks of four environments, the first two of each are reader 0's.
  const EnvShare first{.rank = 0, .count = 2, .block = 4}, second{.rank = 1, .count = 2, .block = 4};
  EXPECT_THAT(arena.slabs().drain(10, second), ElementsAre(slabs[2], slabs[3], slabs[6], slabs[7]));
  EXPECT_THAT(arena.slabs().drain(3, first), ElementsAre(slabs[0], slabs[1], slabs[4]));
  EXPECT_THAT(arena.slabs().drain(10), ElementsAre(slabs[5])) << "without a share all that is left";
  for (uint32_t env = 0, place = 0; env < 8; ++env)
    if (second.has(env)) {
      EXPECT_EQ(second.place_of(env), place++) << env;
    }
  EXPECT_EQ(EnvShare{}.place_of(7), 7);
}

TEST(Accounts, ReadersSideBySideNeverLowerWhatWasTaken) {
  const Arena arena = make_arena();
  constexpr uint64_t kSlabs = 40000;
  std::vector<std::thread> readers;
  for (int reader = 0; reader < 2; ++reader)
    readers.emplace_back([&] {
      while (arena.accounts().of(3).taken.load() < kSlabs)
        for (const uint32_t slab : arena.slabs().drain(1)) arena.slabs().release(slab);
    });
  for (uint64_t position = 0; position < kSlabs;) {
    const std::optional<uint32_t> slab = arena.slabs().acquire(0);
    if (!slab) continue;
    SlabHeader& header = arena.slabs().header(static_cast<int>(*slab));
    header.env_index = 3;
    header.position = position++;
    header.length = 1;
    arena.slabs().seal(*slab);
  }
  for (std::thread& reader : readers) reader.join();  // for ever, where the last slab's word was lost
  EXPECT_EQ(arena.accounts().of(3).taken.load(), kSlabs);
}

TEST(Slabs, ManyAcquirersNeverShareOne) {
  ArenaShape shape = small_arena_shape();
  shape.slab_count = 3;
  const Arena arena = make_arena(shape);
  std::array<std::atomic<int>, 3> holders{};
  std::atomic<int> clashes{0};
  std::vector<std::thread> threads;
  for (int worker = 0; worker < 4; ++worker)
    threads.emplace_back([&, worker] {
      for (int round = 0; round < 20000; ++round) {
        const std::optional<uint32_t> slab = arena.slabs().acquire(worker % 2);
        if (!slab) continue;
        if (holders[*slab].fetch_add(1) != 0) ++clashes;
        holders[*slab].fetch_sub(1);
        if (round % 2 == 0) {
          arena.slabs().abandon(*slab);
        } else {
          arena.slabs().seal(*slab);
          for (const uint32_t drained : arena.slabs().drain(2)) arena.slabs().release(drained);
        }
      }
    });
  for (std::thread& thread : threads) thread.join();
  for (const uint32_t drained : arena.slabs().drain(3)) arena.slabs().release(drained);
  EXPECT_EQ(clashes.load(), 0);
  for (int count = 0; count < 3; ++count) EXPECT_TRUE(arena.slabs().acquire(0)) << "none was lost";
}

constexpr std::array kReaders = {EpisodeReader::kSupervisor, EpisodeReader::kLearner,
                                 EpisodeReader::kCurriculum};

TEST(Episodes, ReachEveryReaderOnceAndInOrder) {
  const Arena arena = make_arena();
  for (uint64_t id = 0; id < 5; ++id) {
    EpisodeRecord record{.episode_id = id, .env_index = 6, .agent_count = 8};
    record.agent_return[7] = static_cast<float>(id);
    arena.episodes().write(record);
  }
  for (const EpisodeReader reader : kReaders) {
    for (uint64_t id = 0; id < 5; ++id) {
      const std::optional<EpisodeRecord> record = arena.episodes().read(reader);
      ASSERT_TRUE(record);
      EXPECT_EQ(record->episode_id, id);
      EXPECT_EQ(record->env_index, 6u);
      EXPECT_EQ(record->returns().back(), static_cast<float>(id));
    }
    EXPECT_FALSE(arena.episodes().read(reader));
  }
}

TEST(Episodes, AReaderThatFallsBehindLosesTheOldestAndNoOtherReaderDoes) {
  const Arena arena = make_arena();  // 128 records over two simulators: 64 each
  ASSERT_EQ(arena.episodes().capacity(), 64);
  uint64_t id = 0, supervisor_next = 0;
  for (int lap = 0; lap < 3; ++lap) {
    for (int count = 0; count < 70; ++count, ++id) {
      arena.episodes().write({.episode_id = id});
      const std::optional<EpisodeRecord> record = arena.episodes().read(EpisodeReader::kSupervisor);
      ASSERT_TRUE(record);
      EXPECT_EQ(record->episode_id, supervisor_next++);
    }
    arena.episodes().write({.episode_id = id, .env_index = 4});  // the other simulator's cells
    EXPECT_EQ(arena.episodes().read(EpisodeReader::kSupervisor)->env_index, 4u);
    uint64_t expected = id - 64;
    while (const std::optional<EpisodeRecord> record = arena.episodes().read(EpisodeReader::kLearner)) {
      if (record->env_index == 0) {
        EXPECT_EQ(record->episode_id, expected++);
      }
    }
    EXPECT_EQ(expected, id);
  }
  EXPECT_EQ(arena.episodes().lost(EpisodeReader::kSupervisor), 0u);
  EXPECT_EQ(arena.episodes().lost(EpisodeReader::kLearner), 18u);
  EXPECT_EQ(arena.episodes().read(EpisodeReader::kCurriculum)->episode_id, id - 64);
  EXPECT_EQ(arena.episodes().lost(EpisodeReader::kCurriculum), id - 64);
}

TEST(Episodes, AReadersSuccessorResumesWhereItWas) {
  const Arena arena = make_arena();
  for (uint64_t id = 0; id < 3; ++id) arena.episodes().write({.episode_id = id});
  (void)arena.episodes().read(EpisodeReader::kLearner);
  const Expected<Arena> successor = Arena::adopt(dup(arena.descriptor()));
  ASSERT_TRUE(successor) << successor.error().message;
  EXPECT_EQ(successor->episodes().read(EpisodeReader::kLearner)->episode_id, 1u);
}

TEST(Episodes, AreNeverReadHalfWritten) {
  const Arena arena = make_arena();
  constexpr uint64_t kCount = 200'000;
  std::atomic<bool> has_ended = false;
  const auto follow = [&](EpisodeReader reader) {
    uint64_t next = 0, broken = 0;
    for (bool is_last_look = false;;) {
      while (const std::optional<EpisodeRecord> record = arena.episodes().read(reader)) {
        broken += record->episode_seed != ~record->episode_id || record->episode_id < next ||
                  record->layout_id != record->episode_id;
        next = record->episode_id + 1;
      }
      if (is_last_look) break;
      is_last_look = has_ended.load();
    }
    EXPECT_EQ(broken, 0u);
    EXPECT_EQ(next, kCount) << "the newest is never lost";
  };
  std::vector<std::thread> readers;
  for (const EpisodeReader reader : kReaders) readers.emplace_back(follow, reader);
  for (uint64_t id = 0; id < kCount; ++id)
    arena.episodes().write({.episode_id = id, .episode_seed = ~id, .layout_id = id});
  has_ended = true;
  for (std::thread& reader : readers) reader.join();
}

TEST(Episodes, DamagedNumbersDoNoHarm) {
  const Arena arena = make_arena();
  arena.episodes().write({.agent_count = UINT32_MAX});
  EXPECT_EQ(arena.episodes().read(EpisodeReader::kSupervisor)->returns().size(), std::size_t{kMaxAgents});
}

TEST(Report, TheNewestIsReadOnceAndNeverHalf) {
  const Arena arena = make_arena();
  uint64_t seen = 0;
  EXPECT_FALSE(arena.learner_reports().read(seen)) << "none was published";
  std::atomic<bool> done = false;
  std::thread learner([&] {
    TrainStats report;
    for (uint64_t i = 1; i <= 200'000; ++i) {
      report.env_frames = report.decisions = report.episodes = i;
      std::memset(report.last_checkpoint, 'a' + static_cast<int>(i % 26), kCheckpointPathBytes);
      arena.learner_reports().publish(report);
    }
    done = true;
  });
  uint64_t newest = 0;
  int read = 0;
  for (bool last = false; !last;) {
    last = done;
    const std::optional<TrainStats> report = arena.learner_reports().read(seen);
    if (!report) continue;
    ++read;
    EXPECT_GT(report->env_frames, newest);
    newest = report->env_frames;
    EXPECT_EQ(report->decisions, newest);
    EXPECT_EQ(report->episodes, newest);
    const std::string path = report->last_checkpoint;
    EXPECT_EQ(path, std::string(kCheckpointPathBytes - 1, static_cast<char>('a' + newest % 26)));
    if (::testing::Test::HasFailure()) break;
  }
  learner.join();
  EXPECT_GT(read, 0);
  EXPECT_EQ(newest, 200'000u);
  EXPECT_FALSE(arena.learner_reports().read(seen)) << "the same report twice";
}

TEST(Weights, TheNewestVersionIsRead) {
  const Arena arena = make_arena();
  std::vector<std::byte> out;
  const Expected<PolicyVersion> early = arena.weights().read(out);
  ASSERT_FALSE(early);
  EXPECT_EQ(early.error().code, ErrorCode::kNotFound);
  for (PolicyVersion version : {0u, 1u, 2u, 9u}) {
    arena.weights().publish(weights_of(version, 1000 + version), version);
    EXPECT_TRUE(arena.weights().has_any());
    EXPECT_EQ(arena.weights().version(), version);
    const Expected<PolicyVersion> read = arena.weights().read(out);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(*read, version);
    EXPECT_EQ(out, weights_of(version, 1000 + version));
  }
}

TEST(Weights, AReaderNeverSeesATornVersion) {
  ArenaShape shape = small_arena_shape();
  shape.weights_bytes = 200'000;
  const Arena arena = make_arena(shape);
  arena.weights().publish(weights_of(0, 200'000), 0);
  std::atomic<bool> stop{false};
  std::thread learner([&] {
    std::vector<std::vector<std::byte>> versions;
    for (PolicyVersion version = 0; version < 7; ++version) versions.push_back(weights_of(version, 200'000));
    Rng pause(uint64_t{5});
    for (PolicyVersion round = 1; !stop.load(); ++round) {
      arena.weights().publish(versions[round % 7], round % 7);
      usleep(pause.below(400));  // without any pause a reader on another core would be lapped for ever
    }
  });
  std::vector<std::vector<std::byte>> expected;
  for (PolicyVersion version = 0; version < 7; ++version) expected.push_back(weights_of(version, 200'000));
  std::vector<std::byte> out;
  for (int round = 0; round < 200; ++round) {
    const Expected<PolicyVersion> read = arena.weights().read(out);
    EXPECT_TRUE(read) << read.error().message;
    if (read) {
      EXPECT_TRUE(out == expected[*read]) << "version " << *read << " is torn";
    }
  }
  stop = true;
  learner.join();
}

/// Where the weights of version `version` lie in the mapping, found by their content.
std::byte* find_weights(const Segment& segment, const std::vector<std::byte>& content) {
  void* found =
      memmem(segment.data(), static_cast<std::size_t>(segment.size_bytes()), content.data(), content.size());
  return static_cast<std::byte*>(found);
}

TEST(Weights, ALearnerKilledInAPublishLeavesTheOlderVersionReadable) {
  const Arena arena = make_arena();
  const Expected<Segment> raw = Segment::adopt(dup(arena.descriptor()));
  ASSERT_TRUE(raw);
  arena.weights().publish(weights_of(1, 4000), 1);
  arena.weights().publish(weights_of(2, 4000), 2);
  // The next publish goes over version 1; a death half way through leaves half of it overwritten.
  std::byte* older = find_weights(*raw, weights_of(1, 4000));
  ASSERT_NE(older, nullptr);
  std::memcpy(older, weights_of(3, 4000).data(), 2000);
  std::vector<std::byte> out;
  ASSERT_TRUE(arena.weights().read(out));
  EXPECT_EQ(out, weights_of(2, 4000));
  arena.weights().publish(weights_of(3, 4000), 3);  // its successor publishes again
  ASSERT_TRUE(arena.weights().read(out));
  EXPECT_EQ(out, weights_of(3, 4000));
}

TEST(Weights, DamagedBytesAreRefused) {
  const Arena arena = make_arena();
  const Expected<Segment> raw = Segment::adopt(dup(arena.descriptor()));
  ASSERT_TRUE(raw);
  arena.weights().publish(weights_of(1, 4000), 1);
  find_weights(*raw, weights_of(1, 4000))[1234] ^= std::byte{1};
  std::vector<std::byte> out;
  const Expected<PolicyVersion> read = arena.weights().read(out);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kBadFormat);
  EXPECT_THAT(read.error().message, HasSubstr("checksum"));
}

TEST(Reclaim, ADeadSimulatorsSlabsAndSlotsComeBackAndOthersStay) {
  const Arena arena = make_arena();
  const uint32_t dead = *arena.slabs().acquire(1), sealed = *arena.slabs().acquire(1),
                 alive = *arena.slabs().acquire(0);
  arena.slabs().header(static_cast<int>(dead)).length = 5;
  arena.accounts().of(4).made = 5;
  arena.slabs().seal(sealed);
  arena.step_slots().slot(3).state.store(SlotState::kReady);  // simulator 0
  arena.step_slots().slot(4).state.store(SlotState::kReady);  // simulator 1 from here
  arena.step_slots().slot(5).state.store(SlotState::kActed);
  arena.step_slots().round(1, 0).request_count.store(2);
  EXPECT_EQ(arena.reclaim_sim_worker(1), 10u) << "five rows of two agents";
  EXPECT_EQ(state_of(arena, dead), SlabState::kFree);
  EXPECT_EQ(state_of(arena, sealed), SlabState::kSealed) << "finished work is kept";
  EXPECT_EQ(state_of(arena, alive), SlabState::kFilling);
  EXPECT_EQ(arena.step_slots().slot(3).state.load(), SlotState::kReady);
  EXPECT_EQ(arena.step_slots().slot(4).state.load(), SlotState::kIdle);
  EXPECT_EQ(arena.step_slots().slot(5).state.load(), SlotState::kIdle);
  EXPECT_EQ(arena.step_slots().round(1, 0).request_count.load(), 0u);
  EXPECT_EQ(arena.reclaim_sim_worker(1), 0u) << "twice does no harm";
}

TEST(Reclaim, ASlabTakenButNotBegunOrSealedButNotLetGoIsNotLost) {
  const Arena arena = make_arena();
  // Killed between the owner word and the state word of acquire_slab.
  arena.slabs().header(3).owner.store(2);
  // Killed between the two stores of seal_slab.
  const uint32_t sealing = *arena.slabs().acquire(1);
  arena.slabs().header(static_cast<int>(sealing)).owner.store(0);
  // Killed on a second look at a slab that simulator 0 is about to seal.
  const uint32_t foreign = *arena.slabs().acquire(0);
  arena.slabs().header(static_cast<int>(foreign)).owner.store(2);
  (void)arena.reclaim_sim_worker(1);
  EXPECT_EQ(arena.slabs().header(3).owner.load(), 0u);
  EXPECT_EQ(state_of(arena, sealing), SlabState::kFree);
  EXPECT_EQ(state_of(arena, foreign), SlabState::kFilling) << "simulator 0 lives and will seal it";
  arena.slabs().seal(foreign);
  int free_slabs = 0;
  while (arena.slabs().acquire(0)) ++free_slabs;
  EXPECT_EQ(free_slabs, 23);
}

TEST(Reclaim, ARolloutThatWasCountedButNotSealedIsPlayedAgain) {
  const Arena arena = make_arena();
  const uint32_t sealing = *arena.slabs().acquire(1), next = *arena.slabs().acquire(1),
                 fresh = *arena.slabs().acquire(1);
  arena.slabs().header(static_cast<int>(sealing)).env_index = 6;
  arena.slabs().header(static_cast<int>(sealing)).rollout_index = 12;
  arena.slabs().header(static_cast<int>(next)).env_index = 6;  // taken before the older one is let go
  arena.slabs().header(static_cast<int>(next)).rollout_index = 13;
  arena.journals().header(6).rollout_index = 13;
  arena.journals().header(4).rollout_index =
      5;  // the first environment of the worker, whose name a fresh slab bears
  (void)arena.reclaim_sim_worker(1);
  EXPECT_EQ(arena.journals().header(6).rollout_index, 12u);
  EXPECT_EQ(arena.journals().header(4).rollout_index, 5u);
  EXPECT_EQ(state_of(arena, fresh), SlabState::kFree);
  const uint32_t begun = *arena.slabs().acquire(1);
  arena.slabs().header(static_cast<int>(begun)).env_index = 6;
  arena.slabs().header(static_cast<int>(begun)).rollout_index = 12;
  (void)arena.reclaim_sim_worker(1);
  EXPECT_EQ(arena.journals().header(6).rollout_index, 12u)
      << "one that was only begun is played again as well";
}

TEST(Reclaim, ARemoteWorkersRolloutIsTakenBackInItsSlot) {
  ArenaShape shape = small_arena_shape();
  shape.remote_worker_count = 1;
  const Arena arena = make_arena(shape);
  const uint32_t sealing = *arena.slabs().acquire(1);
  SlabHeader& header = arena.slabs().header(static_cast<int>(sealing));
  header.env_index = 6;
  header.rollout_index = 12;
  header.length = 8;
  arena.remote_worker_slots().slot(1).sender_id = 99;
  arena.remote_worker_slots().environment(6).rollout_index = 13;
  arena.journals().header(6).rollout_index = 20;
  arena.accounts().of(6).made = 8;
  EXPECT_EQ(arena.reclaim_sim_worker(1), 0u) << "its host sends again what was not sealed";
  EXPECT_EQ(arena.remote_worker_slots().environment(6).rollout_index, 12u);
  EXPECT_EQ(arena.remote_worker_slots().slot(1).sender_id.load(), 99u) << "its host keeps the slot";
  EXPECT_EQ(arena.journals().header(6).rollout_index, 20u);
  EXPECT_EQ(arena.accounts().of(6).made.load(), 0u);
}

TEST(Reclaim, AnEnvironmentOutOfRangeIsNobodysSlab) {
  const Arena arena = make_arena();
  const uint32_t slab = *arena.slabs().acquire(0);
  for (const uint32_t hostile : {8u, 0x7FFFFFFFu, 0x80000000u, 0xFFFFFFFFu}) {
    arena.slabs().header(static_cast<int>(slab)).env_index = hostile;
    for (int sim = 0; sim < 2; ++sim) (void)arena.reclaim_sim_worker(sim);
    EXPECT_EQ(state_of(arena, slab), SlabState::kFilling) << hostile;
  }
}

TEST(RemoteWorkerSlots, AreThoseOfRemoteWorkersAlone) {
  ArenaShape shape = small_arena_shape();
  shape.remote_worker_count = 1;
  const Arena arena = make_arena(shape);
  for (int env = 4; env < 8; ++env)
    arena.remote_worker_slots().environment(env).rollout_index = static_cast<uint64_t>(env);
  arena.remote_worker_slots().slot(1).sender_id = 5;
  const Expected<Arena> peer = Arena::adopt(dup(arena.descriptor()));
  ASSERT_TRUE(peer) << peer.error().message;
  EXPECT_EQ(peer->remote_worker_slots().slot(1).sender_id.load(), 5u);
  for (int env = 4; env < 8; ++env)
    EXPECT_EQ(peer->remote_worker_slots().environment(env).rollout_index, static_cast<uint64_t>(env));
  EXPECT_DEATH((void)arena.remote_worker_slots().slot(0), "remote");
  EXPECT_DEATH((void)arena.remote_worker_slots().environment(3), "remote");
  EXPECT_DEATH((void)arena.remote_worker_slots().environment(8), "remote");
}

TEST(Reclaim, AnAnswerUnderWayIsAwaitedBeforeItsSlabIsFreed) {
  const Arena arena = make_arena();
  const uint32_t slab = *arena.slabs().acquire(0);
  arena.step_slots().slot(1).state.store(SlotState::kInBatch);
  std::atomic<bool> answered{false};
  std::thread policy([&] {
    usleep(50'000);
    EXPECT_EQ(state_of(arena, slab), SlabState::kFilling) << "still ours to write";
    answered = true;
    EXPECT_TRUE(advance(arena.step_slots().slot(1), SlotState::kInBatch, SlotState::kActed));
  });
  (void)arena.reclaim_sim_worker(0);
  EXPECT_TRUE(answered.load());
  EXPECT_EQ(state_of(arena, slab), SlabState::kFree);
  policy.join();
}

TEST(Reclaim, AHangingPolicyWorkerDoesNotHoldItUpForEver) {
  const Arena arena = make_arena();
  arena.step_slots().slot(1).state.store(SlotState::kInBatch);
  (void)arena.reclaim_sim_worker(0);
  EXPECT_EQ(arena.step_slots().slot(1).state.load(), SlotState::kIdle);
}

TEST(Reclaim, ADeadPolicyWorkersBatchIsReadyAgain) {
  ArenaShape shape = small_arena_shape();
  shape.policy_worker_count = 2;  // worker 0 serves split 0 of both simulators, worker 1 split 1
  const Arena arena = make_arena(shape);
  for (int env = 0; env < 8; ++env) arena.step_slots().slot(env).state.store(SlotState::kInBatch);
  arena.step_slots().slot(0).state.store(SlotState::kActed);
  const uint32_t heard = listen(arena.step_slots().ready(0));
  EXPECT_EQ(arena.reclaim_policy_worker(0), 3);
  EXPECT_NE(listen(arena.step_slots().ready(0)), heard);
  EXPECT_EQ(arena.step_slots().slot(0).state.load(), SlotState::kActed);
  EXPECT_EQ(arena.step_slots().slot(1).state.load(), SlotState::kReady);
  EXPECT_EQ(arena.step_slots().slot(2).state.load(), SlotState::kInBatch) << "served by the other one";
  EXPECT_EQ(arena.step_slots().slot(4).state.load(), SlotState::kReady);
}

TEST(Accounts, SayToTheStepWhereWhatWasMadeIsWhateverMomentKills) {
  const Arena arena = make_arena();
  const int steps = arena.shape().trajectory.rollout_steps;
  const auto fill = [&](int env, int count) {
    const uint32_t slab = *arena.slabs().acquire(env / arena.shape().envs_per_worker);
    SlabHeader& header = arena.slabs().header(static_cast<int>(slab));
    header.env_index = static_cast<uint32_t>(env);
    arena.accounts().of(env).made += static_cast<uint64_t>(count);
    header.length = static_cast<uint32_t>(count);
    return slab;
  };
  const auto expect = [&](int env, uint64_t made, uint64_t sealed, uint64_t taken, uint64_t lost) {
    const EnvAccount& account = arena.accounts().of(env);
    EXPECT_EQ(account.made, made);
    EXPECT_EQ(account.sealed, sealed);
    EXPECT_EQ(account.taken, taken);
    EXPECT_EQ(account.lost, lost);
  };
  const auto whole = static_cast<uint64_t>(steps);
  arena.slabs().seal(fill(5, steps));
  arena.slabs().seal(fill(5, steps - 1));
  ASSERT_EQ(arena.slabs().drain(1).size(), 1u);
  expect(5, 2 * whole - 1, 2 * whole - 1, whole, 0);

  // Half full, and counted before the world moved; its simulator dies.
  (void)fill(5, 3);
  arena.accounts().of(5).made += 1;
  EXPECT_EQ(arena.reclaim_sim_worker(1), 4u * 2) << "of two agents";
  expect(5, 2 * whole + 3, 2 * whole - 1, whole, 4);
  EXPECT_EQ(arena.reclaim_sim_worker(1), 0u);

  // Killed within seal_slab(), when the account was stored and the slab was not handed over.
  SlabHeader& half = arena.slabs().header(static_cast<int>(fill(5, steps)));
  half.position = arena.accounts().of(5).sealed;
  arena.accounts().of(5).sealed += whole;
  half.owner = 0;
  EXPECT_EQ(arena.reclaim_sim_worker(1), 2 * whole);
  expect(5, 3 * whole + 3, 2 * whole - 1, whole, 4 + whole);

  // A learner killed between taking a slab and saying so.
  for (int slab = 0; slab < arena.shape().slab_count; ++slab) {
    SlabState sealed = SlabState::kSealed;
    arena.slabs().header(slab).state.compare_exchange_strong(sealed, SlabState::kLearning);
  }
  EXPECT_EQ(arena.reclaim_learner(), 2);
  expect(5, 3 * whole + 3, 2 * whole - 1, 2 * whole - 1, 4 + whole);

  // What comes after counts on.
  arena.slabs().seal(fill(5, steps));
  ASSERT_EQ(arena.slabs().drain(8).size(), 1u);
  expect(5, 4 * whole + 3, 3 * whole - 1, 3 * whole - 1, 4 + whole);
  const DecisionCounts all = arena.accounts().counts();
  EXPECT_EQ(all.made, 2 * (4 * whole + 3));
  EXPECT_EQ(all.made, all.taken + all.lost);
}

TEST(Reclaim, ASlotThatAPolicyWorkerHoldsKeepsItsSlab) {
  const Arena arena = make_arena();
  arena.step_slots().slot(4).state.store(SlotState::kReady);
  arena.step_slots().slot(5).state.store(SlotState::kInBatch);
  EXPECT_FALSE(arena.step_slots().withdraw(1));
  EXPECT_EQ(arena.step_slots().slot(4).state.load(), SlotState::kIdle);
  EXPECT_EQ(arena.step_slots().slot(5).state.load(), SlotState::kInBatch);
  arena.step_slots().slot(5).state.store(SlotState::kActed);
  EXPECT_TRUE(arena.step_slots().withdraw(1));
}

TEST(Reclaim, ADeadLearnersSlabsAreFreeAgain) {
  const Arena arena = make_arena();
  for (int count = 0; count < 3; ++count) arena.slabs().seal(*arena.slabs().acquire(0));
  const std::vector<uint32_t> learning = arena.slabs().drain(2);
  EXPECT_EQ(arena.reclaim_learner(), 2);
  for (const uint32_t slab : learning) EXPECT_EQ(state_of(arena, slab), SlabState::kFree);
  EXPECT_EQ(arena.slabs().sealed_count(), 1) << "what waits for it stays";
}

TEST(ArenaShape, GroupsCoverAllEnvironmentsOnce) {
  ArenaShape shape = small_arena_shape();
  for (int envs = 2; envs < 10; ++envs) {
    shape.envs_per_worker = envs;
    EXPECT_EQ(shape.split_begin(0), 0);
    EXPECT_EQ(shape.split_end(0), shape.split_begin(1));
    EXPECT_EQ(shape.split_end(1), envs);
  }
}

TEST(ArenaDeathTest, AnIndexOutOfRangeIsOurBugAndStopsTheProcess) {
  const Arena arena = make_arena();
  EXPECT_DEATH((void)arena.slabs().view(24), "slab index is in range");
  EXPECT_DEATH((void)arena.step_slots().slot(-1), "environment index is in range");
  EXPECT_DEATH(arena.weights().publish(std::vector<std::byte>(4097), 1), "fit");
}

}  // namespace arena_test
}  // namespace comrad::shm
