// comrad-bench-transport (`comrad bench transport`): how fast the arena hands over, without pictures, tics and networks.
// Processes that do nothing else play the simulators (commit, take the answer, append, seal), the policy workers (gather,
// scatter) and the learner (drain, release), through the slots, slabs and doorbells of a run.
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <bit>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <nlohmann/json.hpp>
#include <vector>

#include "rollout_buffer/bench/frame_link.h"
#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::bench {
namespace {

using namespace comrad::shm;  // what a run's processes do in the arena

using nlohmann::ordered_json;

constexpr int64_t kWaitUs = 20'000;  // how often a waiting process looks whether the bench is over
constexpr double kTicsPerDecision = 4;

struct Arguments {
  int32_t num_workers = 2;
  int32_t num_envs_per_worker = 8;
  int32_t worker_num_splits = 2;
  int32_t policy_workers = 1;
  int32_t num_agents = 2;
  int32_t rollout = 32;
  double seconds = 5;
  std::string link = "arena", compression = "auto", keys;
  bool json = false;

  bool is_over_dds() const { return link == "dds"; }
};

/// Counts of nanoseconds, 32 buckets to a doubling: 3 % wide. One writer, read when it has ended.
class Histogram {
 public:
  void add(int64_t ns) { ++count_[bucket_of(ns < 0 ? 0 : static_cast<uint64_t>(ns))]; }
  void add(const Histogram& other) {
    for (std::size_t i = 0; i < count_.size(); ++i) count_[i] += other.count_[i];
  }
  /// Upper end of the bucket in which this share of all counts is reached, in microseconds.
  double quantile_us(double share) const {
    uint64_t all = 0, seen = 0;
    for (const uint64_t count : count_) all += count;
    for (std::size_t i = 0; i < count_.size(); ++i) {
      seen += count_[i];
      if (seen > 0 && static_cast<double>(seen) >= share * static_cast<double>(all))
        return static_cast<double>(end_of(i)) * 1e-3;
    }
    return 0;
  }

 private:
  static constexpr uint64_t kSteps = 32;
  static std::size_t bucket_of(uint64_t ns) {
    if (ns < kSteps) return ns;
    const int shift = std::bit_width(ns) - 6;
    return static_cast<std::size_t>(shift + 1) * kSteps + ((ns >> shift) - kSteps);
  }
  static uint64_t end_of(std::size_t bucket) {
    if (bucket < kSteps) return bucket;
    const std::size_t shift = bucket / kSteps - 1;
    return (kSteps + bucket % kSteps + 1) << shift;
  }
  std::array<uint64_t, 60 * kSteps> count_;
};

bool is_over(const Arena& arena) {
  return arena.control().run_state.load(std::memory_order_acquire) == RunState::kStopping;
}

/// One simulator: every environment has a slab, a row of which it requests, and no world.
void play(const Arena& arena, int worker, bool asks_last_value, Histogram& round_trips) {
  const ArenaShape& shape = arena.shape();
  struct Env {
    uint32_t slab = 0, step = 0;
    uint64_t step_id = 0, rollout_index = 0;
  };
  std::vector<Env> envs(static_cast<std::size_t>(shape.envs_per_worker));
  const auto begin_slab = [&](Env& env) {
    while (!is_over(arena)) {
      const uint32_t heard = listen(arena.control().slab_released);
      if (const auto slab = arena.slabs().acquire(worker)) {
        env.slab = *slab;
        env.step = 0;
        SlabHeader& header = arena.slabs().header(static_cast<int>(*slab));
        header.env_index =
            static_cast<uint32_t>(&env - envs.data()) + static_cast<uint32_t>(worker * shape.envs_per_worker);
        header.rollout_index = env.rollout_index++;
        std::fill_n(
            arena.slabs().view(static_cast<int>(*slab)).at<int32_t>(arena.slabs().offsets().final_index),
            shape.trajectory.rollout_steps, -1);
        return;
      }
      wait(arena.control().slab_released, heard, kWaitUs);
    }
  };
  std::array<int64_t, 2> committed_ns = {};
  const auto commit = [&](int split) {
    arena.step_slots()
        .round(worker, split)
        .request_count.store(static_cast<uint32_t>(shape.split_end(split) - shape.split_begin(split)),
                             std::memory_order_relaxed);
    committed_ns[static_cast<std::size_t>(split)] = monotonic_ns();
    for (int local = shape.split_begin(split); local < shape.split_end(split); ++local) {
      const Env& env = envs[static_cast<std::size_t>(local)];
      StepSlot& slot = arena.step_slots().slot(worker * shape.envs_per_worker + local);
      slot.step_id = env.step_id;
      slot.slab_index = env.slab;
      slot.step = env.step;
      slot.kind = env.step < static_cast<uint32_t>(shape.trajectory.rollout_steps) ? RequestKind::kAct
                                                                                   : RequestKind::kValue;
      slot.state.store(SlotState::kReady, std::memory_order_release);
    }
    ring(arena.step_slots().ready(shape.policy_worker_of(worker, split)));
  };
  const auto await = [&](int split) {
    Doorbell& acted = arena.step_slots().acted(worker, split);
    while (!is_over(arena)) {
      const uint32_t heard = listen(acted);
      bool is_complete = true;
      for (int local = shape.split_begin(split); local < shape.split_end(split) && is_complete; ++local)
        is_complete = arena.step_slots()
                          .slot(worker * shape.envs_per_worker + local)
                          .state.load(std::memory_order_acquire) == SlotState::kActed;
      if (is_complete) return true;
      wait(acted, heard, kWaitUs);
    }
    return false;
  };
  for (Env& env : envs) begin_slab(env);
  for (int split = 0; split < shape.splits_per_worker; ++split) commit(split);
  WorkerCounters& counters = arena.sim_counters(worker);
  for (int split = 0; await(split); split = (split + 1) % shape.splits_per_worker) {
    round_trips.add(monotonic_ns() - committed_ns[static_cast<std::size_t>(split)]);
    uint64_t decided = 0;
    const auto steps = static_cast<uint32_t>(shape.trajectory.rollout_steps);
    for (int local = shape.split_begin(split); local < shape.split_end(split); ++local) {
      Env& env = envs[static_cast<std::size_t>(local)];
      if (env.step < steps) ++decided, ++env.step, ++env.step_id;
      // The slot goes back for the next request, as a simulator that takes the answer does.
      arena.step_slots()
          .slot(worker * shape.envs_per_worker + local)
          .state.store(SlotState::kIdle, std::memory_order_release);
      const bool has_value =
          arena.step_slots().slot(worker * shape.envs_per_worker + local).kind == RequestKind::kValue;
      if (env.step < steps || (asks_last_value && !has_value)) continue;
      arena.slabs().header(static_cast<int>(env.slab)).length = env.step;
      arena.slabs().seal(env.slab);
      begin_slab(env);
    }
    counters.decisions.fetch_add(decided, std::memory_order_relaxed);
    commit(split);
  }
}

/// One policy worker: answers whatever lies ready.
void answer(const Arena& arena, int policy_worker) {
  const ArenaShape& shape = arena.shape();
  WorkerCounters& counters = arena.policy_counters(policy_worker);
  while (!is_over(arena)) {
    const uint32_t heard = listen(arena.step_slots().ready(policy_worker));
    bool has_answered = false;
    for (int sim = 0; sim < shape.sim_worker_count; ++sim)
      for (int split = 0; split < shape.splits_per_worker; ++split) {
        if (shape.policy_worker_of(sim, split) != policy_worker) continue;
        bool is_touched = false;
        for (int local = shape.split_begin(split); local < shape.split_end(split); ++local) {
          StepSlot& slot = arena.step_slots().slot(sim * shape.envs_per_worker + local);
          if (slot.state.load(std::memory_order_acquire) != SlotState::kReady) continue;
          if (!advance(slot, SlotState::kReady, SlotState::kInBatch)) continue;
          is_touched |= advance(slot, SlotState::kInBatch, SlotState::kActed);
        }
        if (is_touched) ring(arena.step_slots().acted(sim, split));
        has_answered |= is_touched;
      }
    if (has_answered)
      counters.batches.fetch_add(1, std::memory_order_relaxed);
    else
      wait(arena.step_slots().ready(policy_worker), heard, kWaitUs);
  }
}

/// The learner: takes sealed slabs and gives them back.
void drain(const Arena& arena) {
  while (!is_over(arena)) {
    const uint32_t heard = listen(arena.control().slab_sealed);
    const std::vector<uint32_t> slabs = arena.slabs().drain(arena.shape().slab_count);
    for (const uint32_t slab : slabs) arena.slabs().release(slab);
    if (slabs.empty()) wait(arena.control().slab_sealed, heard, kWaitUs);
  }
}

/// Processor time of all processes that this one has waited for.
double cpu_of_children_s() {
  rusage used{};
  getrusage(RUSAGE_CHILDREN, &used);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

/// Forks a process that does `work` and ends with this one.
template <typename Work>
Expected<pid_t> start(Work&& work) {
  const pid_t parent = getpid(), child = fork();
  if (child < 0) return Error{ErrorCode::kSystem, "fork failed"};
  if (child > 0) return child;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() == parent) work();
  _exit(0);
}

Expected<ordered_json> measure(const Arguments& arguments) {
  ArenaShape shape;
  shape.trajectory.env.num_agents = arguments.num_agents;
  shape.trajectory.env.head_count = 5;
  shape.trajectory.env.head_sizes = {3, 3, 3, 2, 3};
  shape.trajectory.rollout_steps = arguments.rollout;
  shape.sim_worker_count = arguments.num_workers;
  shape.envs_per_worker = arguments.num_envs_per_worker;
  shape.splits_per_worker = std::min(arguments.worker_num_splits, arguments.num_envs_per_worker);
  shape.policy_worker_count = arguments.policy_workers;
  shape.slab_count = 2 * shape.env_count();
  shape.weights_bytes = 64;
  if (arguments.policy_workers > shape.sim_worker_count * shape.splits_per_worker)
    return Error{ErrorCode::kBadInput, "--policy_workers " + std::to_string(arguments.policy_workers) +
                                           ": there are " +
                                           std::to_string(shape.sim_worker_count * shape.splits_per_worker) +
                                           " groups of environments to share out"};
  ArenaShape near_shape = shape;
  if (arguments.is_over_dds())
    near_shape.remote_worker_count = near_shape.remote_frame_worker_count = shape.sim_worker_count;
  COMRAD_TRY_ASSIGN(const Arena arena, Arena::create(near_shape, static_cast<uint64_t>(getpid())));
  const std::size_t bytes =
      sizeof(Histogram) * static_cast<std::size_t>(shape.sim_worker_count) + sizeof(SentFrames);
  void* shared = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (shared == MAP_FAILED) return Error{ErrorCode::kNoSpace, "no memory for the latencies"};
  auto* histograms = static_cast<Histogram*>(shared);  // zeroed memory is an empty histogram
  auto* accounts = reinterpret_cast<SentFrames*>(histograms + shape.sim_worker_count);

  std::optional<Arena> far;  // of the simulators' host
  if (arguments.is_over_dds()) {
    COMRAD_TRY_ASSIGN(far, Arena::create(shape, static_cast<uint64_t>(getpid()) << 32));
    far->control().run_state = arena.control().run_state = RunState::kRunning;
  }
  const Arena& played = far ? *far : arena;
  const BenchedLink link{.id = static_cast<uint64_t>(getpid()) << 32 | 7,
                         .keys = arguments.keys,
                         .compression = arguments.compression};
  if (arguments.is_over_dds()) COMRAD_TRY(check_link(link));
  std::vector<pid_t> children;
  const auto end_all = [&] {
    arena.control().run_state = RunState::kStopping;
    if (far) far->control().run_state = RunState::kStopping;
    for (const pid_t child : children) waitpid(child, nullptr, 0);
  };
  for (int process = -shape.policy_worker_count - 1 - (far ? 2 : 0); process < shape.sim_worker_count;
       ++process) {
    const Expected<pid_t> child = start([&] {
      if (process >= 0)
        play(played, process, arguments.is_over_dds(), histograms[process]);
      else if (process == -shape.policy_worker_count - 3)
        receive(arena, link);
      else if (process == -shape.policy_worker_count - 2)
        *accounts = send(*far, link);
      else if (process == -1)
        drain(arena);
      else
        answer(arena, -2 - process);
    });
    if (!child) {
      end_all();
      return child.error();
    }
    children.push_back(*child);
  }

  const auto handed_over = [&] {
    uint64_t sum = 0;
    for (int sim = 0; sim < shape.sim_worker_count; ++sim)
      sum += played.sim_counters(sim).decisions.load(std::memory_order_relaxed);
    return static_cast<double>(sum);
  };
  const auto sleep_s = [](double seconds) { usleep(static_cast<useconds_t>(seconds * 1e6)); };
  sleep_s(std::min(0.5, arguments.seconds));  // warms up
  BenchWindows windows(arguments.seconds);
  const double before = handed_over();
  const Stopwatch clock;
  do sleep_s(std::min(0.01, arguments.seconds / 50));
  while (!windows.see(handed_over() - before, clock.elapsed()));
  const double seconds = clock.elapsed();
  end_all();

  Histogram all{};
  for (int sim = 0; sim < shape.sim_worker_count; ++sim) all.add(histograms[sim]);
  const SentFrames account = *accounts;
  munmap(shared, bytes);
  const double handovers_per_s = windows.median(), decisions_per_s = handovers_per_s * arguments.num_agents;
  ordered_json summary{{"bench", "transport"},
                       {"scenario", "none"},
                       {"algo", "none"},
                       {"num_agents", arguments.num_agents},
                       {"cores", usable_cores()},
                       {"seconds", seconds},
                       {"decisions_per_s", decisions_per_s},
                       {"env_frames_per_s", decisions_per_s * kTicsPerDecision},
                       {"windows", windows.rates()},
                       {"spread", windows.spread()},
                       {"handovers_per_s", handovers_per_s},
                       {"round_trip_us",
                        {{"p50", all.quantile_us(0.5)},
                         {"p90", all.quantile_us(0.9)},
                         {"p99", all.quantile_us(0.99)},
                         {"p99_9", all.quantile_us(0.999)},
                         {"max", all.quantile_us(1)}}},
                       {"num_workers", arguments.num_workers},
                       {"num_envs_per_worker", arguments.num_envs_per_worker},
                       {"worker_num_splits", shape.splits_per_worker},
                       {"policy_workers", arguments.policy_workers},
                       {"rollout", arguments.rollout},
                       {"link", arguments.link}};
  if (far) {
    summary["bytes_per_decision"] =
        static_cast<double>(account.sent_bytes) / std::max<double>(1, static_cast<double>(account.decisions));
    summary["raw_bytes_per_decision"] =
        static_cast<double>(account.raw_bytes) / std::max<double>(1, static_cast<double>(account.decisions));
    summary["is_compressed"] = account.is_compressed;
    summary["resent"] = account.resent;
    summary["is_encrypted"] = !arguments.keys.empty();
    summary["cpu_s_per_1000_decisions"] =
        1000 * cpu_of_children_s() / std::max<double>(1, static_cast<double>(account.decisions));
  }
  return summary;
}

void print_table(const ordered_json& summary) {
  std::printf("%.0f hand-overs/s (spread %.2f over %zu windows), %.0f agent decisions/s\n",
              summary["handovers_per_s"].get<double>(), summary["spread"].get<double>(),
              summary["windows"].size(), summary["decisions_per_s"].get<double>());
  std::printf("from commit to the answer of a group of environments, us:\n");
  for (const auto& [name, value] : summary["round_trip_us"].items())
    std::printf("  %-6s %10.1f\n", name.c_str(), value.get<double>());
}

}  // namespace
}  // namespace comrad::bench

int main(int argc, char** argv) {
  comrad::prepare_process();
  spdlog::set_level(spdlog::level::off);  // stdout is for the result
  using namespace comrad;
  bench::Arguments arguments;
  CLI::App app{
      "How fast the shared memory hands over: processes play simulators, policy workers and the learner of a "
      "run\n"
      "without pictures, tics and networks. Latency is the time from a group's commit to its last answer."};
  app.name("comrad bench transport");
  app.add_option("--num_workers", arguments.num_workers, "simulator processes (default 2)")
      ->check(CLI::Range(1, 256));
  app.add_option("--num_envs_per_worker", arguments.num_envs_per_worker, "environments of each (default 8)")
      ->check(CLI::Range(1, 256));
  app.add_option("--worker_num_splits", arguments.worker_num_splits,
                 "groups of a process's environments that take turns, 1 or 2 (default 2)")
      ->check(CLI::Range(1, 2));
  app.add_option("--policy_workers", arguments.policy_workers, "answering processes (default 1)")
      ->check(CLI::Range(1, 256));
  app.add_option("--num_agents", arguments.num_agents, "agents of a world (default 2)")
      ->check(CLI::Range(1, kMaxAgents));
  app.add_option("--rollout", arguments.rollout, "steps after which a slab is sealed (default 32)")
      ->check(CLI::Range(1, 256));
  app.add_option("--seconds", arguments.seconds, "how long to measure (default 5)")
      ->check(CLI::Range(0.01, 3600.0));
  app.add_option("--link", arguments.link,
                 "arena: all in one; dds: simulators have a separate arena, and their frames and actions "
                 "cross loopback (default arena)")
      ->check(CLI::IsMember({"arena", "dds"}));
  app.add_option("--compression", arguments.compression,
                 "of frames on the DDS link: auto, lz4 or none (default auto)")
      ->check(CLI::IsMember({"auto", "lz4", "none"}));
  app.add_option(
      "--keys", arguments.keys,
      "encrypt the DDS link with the keys of this folder, made with `comrad keys make FOLDER --hosts "
      "bench`");
  app.add_flag("--json", arguments.json, "print one JSON object on stdout and nothing else");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& failure) {
    return app.exit(failure) == 0 ? kExitDone : kExitBadInput;
  }
  const Expected<nlohmann::ordered_json> summary = bench::measure(arguments);
  if (!summary) {
    std::fprintf(stderr, "comrad bench transport: error: %s\n", summary.error().message.c_str());
    return exit_code(summary.error());
  }
  if (arguments.json)
    std::printf("%s\n", summary->dump().c_str());
  else
    bench::print_table(*summary);
  return kExitDone;
}
