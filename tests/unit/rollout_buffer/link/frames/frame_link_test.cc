// The frame link: what it carries, and both ends as they work between two arenas of this process.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <random>
#include <set>
#include <thread>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/link/frames/frame_receiver.h"
#include "rollout_buffer/link/frames/frame_sender.h"
#include "rollout_buffer/link/frames/frame_stream.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"
#include "tests/support/patience.h"

namespace comrad::link {
namespace frame_link_test {

using shm::RequestKind;
using shm::SlotState;
using ::testing::HasSubstr;

shm::ArenaShape small_arena(int workers) {
  shm::ArenaShape shape;
  shape.trajectory.env = {
      .num_agents = 2, .channels = 3, .height = 6, .width = 8, .measurement_count = 1, .head_count = 2};
  shape.trajectory.env.head_sizes = {3, 4};
  shape.trajectory.env.global_state_count = 3;
  shape.trajectory.rollout_steps = 4;
  shape.trajectory.final_capacity = 2;
  shape.sim_worker_count = workers;
  shape.envs_per_worker = 4;
  shape.slab_count = 16;
  shape.weights_bytes = 64;
  return shape;
}

/// The last `remote` of the workers are played by the far end.
shm::Arena make_arena(int workers, uint64_t run_id, int remote_workers = 0) {
  shm::ArenaShape shape = small_arena(workers);
  shape.remote_worker_count = shape.remote_frame_worker_count = remote_workers;
  auto arena = shm::Arena::create(shape, run_id);
  EXPECT_TRUE(arena) << arena.error().message;
  arena->control().run_state = shm::RunState::kRunning;
  return std::move(arena).value();
}

/// What an environment shows at a step: distinct in all that it depends on.
uint8_t pixel_of(int env, uint64_t rollout, int step) {
  return static_cast<uint8_t>(env * 61 + rollout * 7 + static_cast<uint64_t>(step));
}
/// What the policy does with it.
int32_t choice_of(uint8_t pixel, int agent, int head) { return (pixel + agent + head) % (head == 0 ? 3 : 4); }

/// The policy worker of an arena: its actions are a function of the pixels.
void answer(const shm::Arena& arena) {
  while (arena.control().run_state.load() != shm::RunState::kStopping) {
    const uint32_t heard = shm::listen(arena.step_slots().ready(0));
    bool has_answered = false;
    const shm::ArenaShape& shape = arena.shape();
    for (int env = 0; env < shape.env_count(); ++env) {
      shm::StepSlot& slot = arena.step_slots().slot(env);
      if (!shm::advance(slot, SlotState::kReady, SlotState::kInBatch)) continue;
      const SlabView slab = arena.slabs().view(static_cast<int>(slot.slab_index));
      const int step = static_cast<int>(slot.step);
      if (slot.kind == RequestKind::kAct)
        for (int agent = 0; agent < 2; ++agent)
          for (int head = 0; head < 2; ++head)
            slab.action(step, agent)[static_cast<std::size_t>(head)] =
                choice_of(slab.frame(step, agent)[0], agent, head);
      shm::advance(slot, SlotState::kInBatch, SlotState::kActed);
      const int local = env % shape.envs_per_worker;
      shm::ring(arena.step_slots().acted(env / shape.envs_per_worker, local >= shape.split_begin(1) ? 1 : 0));
      has_answered = true;
    }
    if (!has_answered) shm::wait(arena.step_slots().ready(0), heard, 1000);
  }
}

/// One simulator process in a thread: plays so many rollouts with each environment. Counts wrong actions.
struct Player {
  const shm::Arena& arena;
  uint64_t rollouts;
  int wrong = 0;
  uint64_t first_rollout = 0;

  void run() {
    struct Env {
      uint32_t slab = 0;
      int step = 0;
      uint64_t rollout = 0, step_id = 0;
      bool has_slab = false, is_out = false;
    };
    std::vector<Env> envs(4);
    for (Env& env : envs) env.rollout = first_rollout, env.step_id = first_rollout * 4;
    const auto finished = [&] {
      uint64_t sum = 0;
      for (const Env& env : envs) sum += env.rollout - first_rollout;
      return sum;
    };
    const auto is_done = [&] { return finished() == 4 * rollouts; };
    uint64_t last = 0;
    for (double end_s = test::deadline_s(); !is_done() && monotonic_s() < end_s; usleep(20)) {
      for (int index = 0; index < 4; ++index) turn(index, envs[static_cast<std::size_t>(index)]);
      shm::ring(arena.step_slots().ready(0));
      if (const uint64_t now = finished(); now != last) last = now, end_s = test::deadline_s();
    }
    EXPECT_TRUE(is_done()) << "the link stands still";
  }

  template <typename Env>
  void turn(int index, Env& env) {
    if (env.rollout == first_rollout + rollouts) return;
    shm::StepSlot& slot = arena.step_slots().slot(index);
    if (env.is_out) {
      if (!shm::advance(slot, SlotState::kActed, SlotState::kIdle)) return;
      env.is_out = false;
      const SlabView slab = arena.slabs().view(static_cast<int>(env.slab));
      if (slot.kind == RequestKind::kAct) {
        for (int agent = 0; agent < 2; ++agent)
          for (int head = 0; head < 2; ++head)
            wrong += slab.action(env.step, agent)[static_cast<std::size_t>(head)] !=
                     choice_of(pixel_of(index, env.rollout, env.step), agent, head);
        slab.reward(env.step, 0) = static_cast<float>(env.step);
        slab.final_index(env.step) = -1;
        slab.terminated(env.step) = slab.truncated(env.step) = 0;
        ++env.step, ++env.step_id;
        arena.sim_counters(0).decisions.fetch_add(2);
      } else {
        arena.slabs().header(static_cast<int>(env.slab)).length = static_cast<uint32_t>(env.step);
        arena.slabs().seal(env.slab);
        env.has_slab = false;
        ++env.rollout;
        return;
      }
    }
    if (!env.has_slab) {
      const auto slab = arena.slabs().acquire(0);
      if (!slab) return;
      env.slab = *slab;
      env.has_slab = true;
      env.step = 0;
      arena.slabs().header(static_cast<int>(*slab)).env_index = static_cast<uint32_t>(index);
      arena.slabs().header(static_cast<int>(*slab)).rollout_index = env.rollout;
    }
    const SlabView slab = arena.slabs().view(static_cast<int>(env.slab));
    std::ranges::fill(slab.frames(env.step), pixel_of(index, env.rollout, env.step));
    std::ranges::fill(slab.global_state(env.step), static_cast<float>(env.step));
    slot.step_id = env.step_id;
    slot.slab_index = env.slab;
    slot.step = static_cast<uint32_t>(env.step);
    slot.kind = env.step < 4 ? RequestKind::kAct : RequestKind::kValue;
    slot.state.store(SlotState::kReady, std::memory_order_release);
    env.is_out = true;
  }
};

/// The learner's end: what was sealed, each row looked at.
struct Learned {
  uint64_t slabs = 0, wrong = 0;
  std::set<std::pair<uint32_t, uint64_t>> seen;

  /// Leaves the processor to both ends where nothing has come.
  void drain(const shm::Arena& arena) {
    const auto drained = arena.slabs().drain(16);
    if (drained.empty()) usleep(200);
    for (const uint32_t index : drained) {
      const shm::SlabHeader& header = arena.slabs().header(static_cast<int>(index));
      const SlabView slab = arena.slabs().view(static_cast<int>(index));
      wrong += header.length != 4 || !seen.emplace(header.env_index, header.rollout_index).second;
      const uint8_t first = slab.frame(0, 0)[0];
      for (int step = 0; step < 4; ++step) {
        wrong += slab.frame(step, 1)[5] != static_cast<uint8_t>(first + step) || !slab.valid(step);
        wrong += slab.action(step, 1)[1] != choice_of(static_cast<uint8_t>(first + step), 1, 1);
        wrong += slab.reward(step, 0) != static_cast<float>(step);
        wrong += slab.global_state(step)[2] != static_cast<float>(step);
      }
      ++slabs;
      arena.slabs().release(index);
    }
  }
};

uint64_t fresh_id() {
  static std::random_device device;
  return (uint64_t{device()} << 32) | device();
}

dds::LinkBus open_link(uint64_t id) {
  auto bus = dds::LinkBus::open(dds::link_config(id));
  EXPECT_TRUE(bus) << bus.error().message;
  return std::move(bus).value();
}

class FrameLink : public ::testing::TestWithParam<Compression> {};

TEST_P(FrameLink, SimulatorsWithoutAPolicyPlayWithThatOfAnotherArena) {
  const uint64_t id = fresh_id();
  const shm::Arena near = make_arena(2, 1, 1), far = make_arena(1, 2);
  near.control().schedule_env_frames = 2'400'000;
  std::atomic<bool> stop{false};
  FrameReceiver receiver(near, open_link(id), {.first_worker = 1});
  FrameSenderOptions options;
  options.peer_id = 9;
  options.host = "far";
  options.compression = GetParam();
  FrameSender sender(far, open_link(id), options);
  std::thread receiving([&] { EXPECT_TRUE(receiver.run(stop)); });
  std::thread answering([&] { answer(near); });
  std::thread sending([&] { EXPECT_TRUE(sender.run(stop)); });
  Player player{far, 25};
  std::atomic<bool> has_played{false};
  std::thread playing([&] {
    player.run();
    has_played = true;
  });
  Learned learned;
  while (!has_played) learned.drain(near);
  EXPECT_TRUE(test::wait_until([&] { return learned.drain(near), learned.slabs >= 100; },
                               test::kPatienceSeconds, 1000));
  playing.join();
  stop = true;
  near.control().run_state = shm::RunState::kStopping;
  for (std::thread* thread : {&receiving, &answering, &sending}) thread->join();
  EXPECT_EQ(player.wrong, 0);
  EXPECT_EQ(learned.wrong, 0u);
  EXPECT_EQ(learned.slabs, 100u) << "4 environments, 25 rollouts";
  EXPECT_EQ(far.control().schedule_env_frames, 2'400'000u) << "where the run's schedules stand";
  const FrameAccount account = *sender.frames();
  EXPECT_EQ(account.decisions, 100u * 4 * 2);
  EXPECT_GT(account.latency_us_p50, 0);
  EXPECT_LE(account.latency_us_p50, account.latency_us_p99);
  if (GetParam() == Compression::kAlways) {
    EXPECT_LT(account.sent_bytes, account.raw_bytes);
  }
  if (GetParam() == Compression::kNever) {
    EXPECT_EQ(account.sent_bytes, account.raw_bytes);
  }
}

INSTANTIATE_TEST_SUITE_P(Compressions, FrameLink,
                         ::testing::Values(Compression::kNever, Compression::kAlways, Compression::kAuto));

TEST(FrameLinkBadLuck, EitherEndMayBeginAnewAndNothingIsLearnedTwice) {
  const uint64_t id = fresh_id();
  const shm::Arena near = make_arena(1, 1, 1), far = make_arena(1, 2);
  std::atomic<bool> has_played{false};
  std::thread answering([&] { answer(near); });
  constexpr uint64_t kRollouts = 600;
  Player player{far, kRollouts};
  std::thread playing([&] {
    player.run();
    has_played = true;
  });
  Learned learned;
  uint64_t lost = 0;
  // One end lives on while the other one begins anew, in turn.
  std::atomic<bool> stop_receiver{false}, stop_sender{false};
  const auto receive = [&] {
    FrameReceiver receiver(near, open_link(id), {});
    EXPECT_TRUE(receiver.run(stop_receiver));
    for (const PeerRecord& record : receiver.records()) lost += record.lost_there;
  };
  const auto send = [&] {
    FrameSenderOptions options;
    options.peer_id = 9;
    options.resend_after_s = 0.3;
    FrameSender sender(far, open_link(id), options);
    EXPECT_TRUE(sender.run(stop_sender));
  };
  std::thread receiving(receive), sending(send);
  for (int life = 0; life < 6 && !has_played; ++life) {
    const uint64_t enough = learned.slabs + 100;
    while (learned.slabs < enough && !has_played) learned.drain(near);
    std::atomic<bool>& stop = life % 2 == 0 ? stop_receiver : stop_sender;
    std::thread& thread = life % 2 == 0 ? receiving : sending;
    stop = true;
    thread.join();
    stop = false;
    thread = life % 2 == 0 ? std::thread(receive) : std::thread(send);
  }
  while (!has_played) learned.drain(near);
  playing.join();
  const auto accounted = [&] {
    return far.learner_counters().decisions.load() + far.control().decisions_lost_on_the_way.load();
  };
  constexpr uint64_t kPlayed = 4 * kRollouts * 4 * 2;
  EXPECT_TRUE(test::wait_until([&] { return learned.drain(near), accounted() >= kPlayed; },
                               test::kPatienceSeconds, 1000));
  stop_receiver = stop_sender = true;
  near.control().run_state = shm::RunState::kStopping;
  for (std::thread* thread : {&receiving, &answering, &sending}) thread->join();
  EXPECT_EQ(player.wrong, 0);
  EXPECT_EQ(learned.wrong, 0u);
  learned.drain(near);
  EXPECT_EQ(accounted(), kPlayed) << "delivered or reported as lost, to the decision";
  const uint64_t told = far.learner_counters().decisions.load() / 8, in_doubt = 4 * kRollouts - told;
  EXPECT_GE(learned.slabs, told);
  EXPECT_LE(learned.slabs, told + in_doubt);
  EXPECT_LE(in_doubt, 4u * 6 * 2)
      << "a beginning anew costs each environment the trajectory in the making, and one that "
         "was not reported";
}

TEST(FrameLinkBadLuck, AnotherGameIsRefusedInWords) {
  const uint64_t id = fresh_id();
  const shm::Arena near = make_arena(1, 1, 1), far = make_arena(1, 2);
  std::atomic<bool> stop{false};
  FrameReceiver receiver(near, open_link(id), {.fingerprint = 1});
  std::thread receiving([&] { EXPECT_TRUE(receiver.run(stop)); });
  FrameSenderOptions options;
  options.peer_id = 9;
  options.fingerprint = 2;
  FrameSender sender(far, open_link(id), options);
  const Status ended = sender.run(stop);
  stop = true;
  receiving.join();
  ASSERT_FALSE(ended);
  EXPECT_THAT(ended.error().message, HasSubstr("join again"));
}

TEST(FrameLinkBadLuck, AHostThatFellSilentGivesItsPlaceToOneThatRequestsIt) {
  const uint64_t id = fresh_id();
  const shm::Arena near = make_arena(1, 1, 1);
  std::atomic<bool> stop{false};
  FrameReceiver receiver(near, open_link(id), {.silent_after_s = 4});
  std::thread receiving([&] { EXPECT_TRUE(receiver.run(stop)); });
  dds::LinkBus far = open_link(id);
  const auto asks = [&](uint64_t peer) {
    (void)far.write(
        dds::FrameBatch{.hello = {.peer_id = peer,
                                  .slab_bytes = static_cast<uint64_t>(near.slabs().offsets().slab_bytes),
                                  .epoch = 1,
                                  .sim_workers = 1,
                                  .envs_per_worker = 4,
                                  .host = "host" + std::to_string(peer)}});
  };
  // What the receiver answers `asking` at last: until it is `expected`, while all of `here` are heard.
  const auto told = [&](uint64_t asking, dds::PeerRun expected, const std::vector<uint64_t>& here) {
    dds::PeerState state{.run = dds::PeerRun::kStopping};
    for (const double end_s = test::deadline_s(); state.run != expected && monotonic_s() < end_s;) {
      for (const uint64_t peer : here) asks(peer);
      far.wait(100);
      far.take<dds::ActionBatch>([&](const dds::ActionBatch& batch) {
        if (batch.state.peer_id == asking) state = batch.state;
      });
    }
    return (state.run == expected ? "as expected: " : "never: ") + state.message.str();
  };
  EXPECT_EQ(told(10, dds::PeerRun::kRunning, {10}), "as expected: ");
  EXPECT_THAT(told(11, dds::PeerRun::kRefused, {10, 11}), HasSubstr("0 are free"))
      << "while the first is heard";
  EXPECT_EQ(told(11, dds::PeerRun::kRunning, {11}), "as expected: ") << "once it is silent";
  EXPECT_THAT(told(10, dds::PeerRun::kRefused, {10, 11}), HasSubstr("0 are free"));
  stop = true;
  receiving.join();
}

TEST(FrameLinkBadLuck, NonsenseFromAPeerHarmsNoOther) {
  const uint64_t id = fresh_id();
  const shm::Arena near = make_arena(2, 1, 2), far = make_arena(1, 2);
  std::atomic<bool> stop{false}, has_played{false};
  FrameReceiver receiver(near, open_link(id), {.worker_count = 2});
  FrameSenderOptions options;
  options.peer_id = 9;
  options.resend_after_s = 0.3;
  FrameSender sender(far, open_link(id), options);
  std::thread receiving([&] { EXPECT_TRUE(receiver.run(stop)); });
  std::thread answering([&] { answer(near); });
  std::thread sending([&] { EXPECT_TRUE(sender.run(stop)); });
  Player player{far, 50};
  std::thread playing([&] {
    player.run();
    has_played = true;
  });
  const unsigned seed = 20261128;
  std::mt19937_64 random(seed);
  dds::LinkBus wild = open_link(id);
  Learned learned;
  const auto drain = [&] {
    for (const uint32_t index : near.slabs().drain(16)) {
      learned.slabs += near.slabs().header(static_cast<int>(index)).length > 0;
      near.slabs().release(index);
    }
  };
  std::vector<std::byte> bytes(4096);
  while (!has_played) {
    for (std::byte& byte : bytes) byte = static_cast<std::byte>(random());
    FrameRequest request;
    request.step_id = random() | 1ull
                                     << 40;  // none that was asked: an answer to one looks like the right one
    std::memcpy(bytes.data(), &request, sizeof request);  // the start of one that may be right
    const uint32_t steps[] = {0, 1, 3, 4, 5, UINT32_MAX};
    std::memcpy(bytes.data() + offsetof(FrameRequest, step), &steps[random() % 6], sizeof(uint32_t));
    bytes[offsetof(FrameRequest, env_index)] = static_cast<std::byte>(random() % 6);
    bytes[offsetof(FrameRequest, kind)] = static_cast<std::byte>(random() % 5);
    const std::span<const std::byte> payload(bytes.data(), random() % bytes.size());
    const uint64_t who = random() % 16 ? 10 : 9;  // its own, or in the other one's name
    (void)wild.write(dds::FrameBatch{
        .hello = {.peer_id = 10,
                  .slab_bytes = static_cast<uint64_t>(near.slabs().offsets().slab_bytes),
                  .epoch = static_cast<uint32_t>(random() % 3),
                  .sim_workers = 1,
                  .envs_per_worker = random() % 8 ? 4u : static_cast<uint32_t>(random()),
                  .is_leaving = random() % 50 == 0},
        .batch_index = random() % 2 ? random() : random() % 100,
        .checksum = checksum64(payload),
        .request_count = static_cast<uint32_t>(random()),
        .raw_bytes = random() % 4 ? static_cast<uint32_t>(payload.size()) : static_cast<uint32_t>(random()),
        .is_compressed = random() % 4 == 0,
        .payload = payload});
    (void)wild.write(dds::ActionBatch{
        .state = {.peer_id = who, .credit_index = random() % 5, .epoch = static_cast<uint32_t>(random() % 3)},
        .payload = payload});
    (void)wild.write(dds::PeerEpisode{.peer_id = 10,
                                      .record = {.env_index = static_cast<uint32_t>(random()),
                                                 .score = std::numeric_limits<float>::quiet_NaN()}});
    drain();
  }
  playing.join();
  // What the far end has sealed may still be on its way.
  EXPECT_TRUE(test::wait_until([&] { return drain(), learned.slabs >= 190; }, test::kPatienceSeconds, 1000));
  stop = true;
  near.control().run_state = shm::RunState::kStopping;
  for (std::thread* thread : {&receiving, &answering, &sending}) thread->join();
  EXPECT_EQ(player.wrong, 0) << "seed " << seed;
  EXPECT_GE(learned.slabs, 190u) << "seed " << seed;
}

TEST(CompressionChoice, StaysWithWhatCarriesMore) {
  const auto play = [](double plain, double compressed) {
    CompressionChoice choice;
    for (double now_s = 0; now_s < 5; now_s += 0.1)
      choice.count(static_cast<uint64_t>(choice.is_compressed() ? compressed : plain), now_s);
    return choice.is_compressed();
  };
  EXPECT_FALSE(play(1000, 700)) << "a fast link: compressing costs more than it saves";
  EXPECT_TRUE(play(300, 1000)) << "a slow link";
  EXPECT_FALSE(play(1000, 1010)) << "the same: plain frames cost both hosts less";
}

}  // namespace frame_link_test
}  // namespace comrad::link
