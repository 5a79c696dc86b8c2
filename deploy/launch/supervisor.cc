#include "deploy/launch/supervisor.h"

#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/random.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "deploy/launch/child_process.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/run_directory.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace comrad::deploy {
namespace {

constexpr int kTickMs = 50;          // longest sleep of the loop; signals, deaths and joins wake it at once
constexpr double kTermAfterS = 8.0;  // of a stop: SIGTERM to who is still there
constexpr double kKillAfterS = 9.5;  // of a stop: SIGKILL, so that 10 s hold
constexpr double kJoinTimeoutS = 120.0;  // a worker that has not joined by then is stuck
constexpr double kStatusIntervalS = 2.0;
constexpr double kSilentAfterS = 10.0;  // a worker whose counter stands still so long is named
constexpr double kWorkerStatusIntervalS = 1.0;
constexpr int kLinesShownPerMinute = 20;  // of one worker's output on the terminal; the log has them all

enum class Role { kSim, kPolicy, kLearner };
enum class Phase { kStarting, kRunning, kStopping };

const char* program_of(Role role) {
  switch (role) {
    case Role::kSim:
      return "comrad-sim-worker";
    case Role::kPolicy:
      return "comrad-policy-worker";
    case Role::kLearner:
      return "comrad-learner";
  }
  return "";
}

const char* word_of(Role role) {
  switch (role) {
    case Role::kSim:
      return "sim";
    case Role::kPolicy:
      return "policy";
    case Role::kLearner:
      return "learner";
  }
  return "";
}

/// Takes over SIGINT, SIGTERM, SIGHUP, SIGUSR1 and SIGCHLD as a descriptor to poll, and gives them back at the end.
class SignalDesk {
 public:
  SignalDesk() {
    sigset_t mask;
    sigemptyset(&mask);
    for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGUSR1, SIGCHLD}) sigaddset(&mask, number);
    descriptor_ = signalfd(-1, &mask, SFD_CLOEXEC | SFD_NONBLOCK);
    sigaddset(&mask, SIGPIPE);  // a reader of our progress that leaves must not end the run
    taken_ = mask;
    pthread_sigmask(SIG_BLOCK, &mask, &before_);
  }
  SignalDesk(const SignalDesk&) = delete;
  SignalDesk& operator=(const SignalDesk&) = delete;
  ~SignalDesk() {
    if (descriptor_ >= 0) close(descriptor_);
    const timespec at_once{};
    while (sigtimedwait(&taken_, nullptr, &at_once) > 0) {
    }
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }

  int descriptor() const { return descriptor_; }
  /// Next pending signal, or 0.
  int next() {
    signalfd_siginfo info{};
    return read(descriptor_, &info, sizeof info) == sizeof info ? static_cast<int>(info.ssi_signo) : 0;
  }

 private:
  int descriptor_ = -1;
  sigset_t taken_{};
  sigset_t before_{};
};

/// One worker's place in the run; the process in it may change.
struct Worker {
  Role role = Role::kSim;
  int index = 0;
  std::string name;  ///< "sim-0", "policy-0", "learner"
  std::optional<ChildProcess> process;
  RestartHistory history;
  bool has_joined = false;
  double started_s = 0;
  double restart_at_s = 0;  ///< 0: no restart is due
  uint64_t decisions_at_start = 0;
  std::string last_line;  ///< of its output
  double minute_began_s = 0;
  int lines_shown = 0;
  int stop_signal = 0;  ///< sent because it did not leave by itself
  uint64_t decisions_at_report = 0;
  uint64_t decisions_heard = 0;  ///< of its counter, and when it moved last
  double heard_s = 0;
};

/// The last line of a worker's log file, for a worker that died without a word.
std::string last_log_line(const std::string& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) return "";
  const std::streamoff size = file.tellg(), take = std::min<std::streamoff>(size, 4096);
  std::string tail(static_cast<std::size_t>(take), '\0');
  file.seekg(size - take);
  file.read(tail.data(), take);
  while (!tail.empty() && (tail.back() == '\n' || tail.back() == '\r')) tail.pop_back();
  const std::size_t line = tail.rfind('\n');
  return line == std::string::npos ? tail : tail.substr(line + 1);
}

/// The words of a log line that a worker means for the user, from "warning: " on; empty for any other line.
std::string warning_in(const std::string& line) {
  const std::size_t at = line.find(": warning: ");
  return at == std::string::npos ? "" : line.substr(at + 2);
}

std::string own_folder() {
  std::error_code failed;
  return std::filesystem::read_symlink("/proc/self/exe", failed).parent_path().string();
}

std::string host_name() {
  char name[256] = {};
  gethostname(name, sizeof name - 1);
  return name;
}

/// Cores this process may use.
std::vector<int> allowed_cpus() {
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  std::vector<int> allowed;
  if (sched_getaffinity(0, sizeof cpus, &cpus) != 0) return allowed;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
    if (CPU_ISSET(static_cast<std::size_t>(cpu), &cpus)) allowed.push_back(cpu);
  }
  return allowed;
}

/// The growth of a counter. Where it falls its writer went back to a checkpoint, and counting goes on from
/// there.
class Growth {
 public:
  /// Gives by how much the counter fell.
  uint64_t see(uint64_t count) {
    if (count > seen_) total_ += count - seen_;
    return start_from(count);
  }
  /// What the counter grew by until now was no work of this run. Gives by how much it fell.
  uint64_t start_from(uint64_t count) {
    const uint64_t before = std::exchange(seen_, count);
    return before > count ? before - count : 0;
  }
  uint64_t total() const { return total_; }
  /// The counter as it was last seen.
  uint64_t seen() const { return seen_; }

 private:
  uint64_t seen_ = 0;
  uint64_t total_ = 0;
};

class Supervisor {
 public:
  explicit Supervisor(const LaunchPlan& plan)
      : plan_(plan),
        bin_dir_(plan.bin_dir.empty() ? own_folder() : plan.bin_dir),
        host_(host_name()),
        printer_(STDERR_FILENO, plan.show_progress) {}

  Expected<RunOutcome> run() {
    if (Status started = start(); !started) fail(started.error());
    while (phase_ != Phase::kStopping || any_alive()) tick();
    return finish();
  }

 private:
  bool trains() const { return plan_.policy == PolicySource::kTraining; }
  /// Simulators that play on in one slab: nobody drains sealed ones unless a learner trains.
  bool evaluates() const { return plan_.episodes > 0 || !trains(); }
  /// Rollout by rollout, everybody waiting for everybody.
  bool is_lock_step() const { return trains() && (plan_.config.deterministic || !plan_.config.async_rl); }
  bool has_learner() const {
    return plan_.policy != PolicySource::kRandom && plan_.policy != PolicySource::kOracle;
  }

  // Start.
  Status start();
  Status open_arena();
  Expected<shm::ArenaShape> arena_shape() const;
  Status spawn(Worker& worker);

  // One turn of the loop.
  void tick();
  void hear_signals();
  void serve_joins();
  void hear_children();
  void bury_the_dead();
  void restart_due();
  void begin_running_when_all_joined();
  void drain_episodes();
  void take_stats();
  void count_work();
  void note_going_back(uint64_t decisions);
  std::string going_back_text() const;
  std::string unsaved_text() const;
  void measure();
  void listen_to_workers();
  void check_goals();
  std::string limit_reached() const;
  void enforce_stop();
  void report();

  // Events.
  void died(Worker& worker, const ExitStatus& how);
  void restart_everything();
  void stop(const std::string& why);
  void complete(const std::string& why);
  void fail(Error error);
  void note(const std::string& text);
  void write_control(const char* run_state);
  void warn_once(const Status& status);

  Expected<RunOutcome> finish();
  bool any_alive() const;
  std::string log_path(const Worker& worker) const {
    return plan_.run_dir + "/logs/" + word_of(worker.role) + "-" + std::to_string(worker.index) + ".log";
  }
  uint64_t sim_decisions() const;
  uint64_t decisions() const;
  uint64_t env_frames() const;
  std::string progress_text() const;
  std::string silence_text() const;
  /// Whether no simulator has played for so long that the last rate is no longer true.
  bool stands_still() const;
  shm::WorkerCounters& counters_of(const Worker& worker) const;
  std::string joined_text() const;
  RunStatus status_now(const std::string& state, const std::string& message) const;

  const LaunchPlan& plan_;
  const std::string bin_dir_;
  const std::string host_;
  SignalDesk signals_;  // before everything that starts threads, so that they inherit the mask
  ProgressPrinter printer_;
  std::optional<shm::Arena> arena_;
  std::optional<shm::ArenaServer> server_;
  std::optional<dds::Bus> bus_;
  std::vector<Worker> workers_;
  RunOutcome outcome_;
  std::optional<Error> error_;
  std::map<uint64_t, dds::EpisodeResult> episodes_;  // evaluation: a restarted simulator plays some again
  Phase phase_ = Phase::kStarting;
  bool killed_at_once_ = false;
  bool is_complete_ = false;  // the goal was reached before anybody interrupted
  bool learner_was_killed_ = false;
  bool bus_warned_ = false;
  std::set<std::string> warnings_shown_;  // without their numbers
  int interrupts_ = 0;
  uint64_t episodes_dropped_ = 0;
  double started_s_ = monotonic_s();
  double running_since_s_ = 0;
  double stopping_since_s_ = 0;
  double next_line_s_ = 0, next_status_s_ = 0, next_worker_status_s_ = 0;
  double worker_status_s_ = 0;

  // Rates over the run and over the measured window.
  Growth trained_decisions_, trained_updates_, played_decisions_;
  uint32_t learner_epoch_ = 0;
  uint64_t report_sequence_ = 0;  // of the learner's report that was read last
  int goings_back_ = 0;           // of the learner, to its last checkpoint
  double first_work_s_ = 0;
  double window_began_s_ = 0;
  uint64_t window_decisions_ = 0, window_updates_ = 0;
  double lag_sum_ = 0;
  int lag_count_ = 0;
};

Status Supervisor::start() {
  if (signals_.descriptor() < 0) {
    return system_error("signalfd");
  }
  COMRAD_TRY(init_log("supervisor", plan_.run_dir + "/logs/supervisor.log"));
  const RunConfig& config = plan_.config;
  const auto add = [&](Role role, int64_t count) {
    for (int i = 0; i < count; ++i) {
      Worker& worker = workers_.emplace_back();
      worker.role = role;
      worker.index = i;
      worker.name = word_of(role);
      if (role != Role::kLearner) worker.name += "-" + std::to_string(i);
      worker.history = RestartHistory(plan_.restarts);
    }
  };
  add(Role::kSim, config.num_workers);
  add(Role::kPolicy, config.policy_workers);
  if (has_learner()) add(Role::kLearner, 1);
  warn_once(write_status(plan_.run_dir, status_now("starting", "")));
  COMRAD_TRY(open_arena());
  for (Worker& worker : workers_) COMRAD_TRY(spawn(worker));
  printer_.line(joined_text());  // at once: a network library takes seconds to load
  next_line_s_ = monotonic_s() + std::max(plan_.config.progress_interval, 0.1);
  return {};
}

Expected<shm::ArenaShape> Supervisor::arena_shape() const {
  const RunConfig& config = plan_.config;
  shm::ArenaShape shape;
  shape.trajectory.env = plan_.env;
  shape.trajectory.rollout_steps = static_cast<int32_t>(config.rollout);
  shape.trajectory.recurrent_state_count = static_cast<int32_t>(recurrent_state_count(config));
  shape.sim_worker_count = static_cast<int32_t>(config.num_workers);
  shape.envs_per_worker = static_cast<int32_t>(config.num_envs_per_worker);
  shape.splits_per_worker = static_cast<int32_t>(config.worker_num_splits);
  shape.policy_worker_count = static_cast<int32_t>(config.policy_workers);
  // Evaluation keeps one slab in every environment's hands and needs no more.
  shape.slab_count = evaluates() ? shape.env_count() : static_cast<int32_t>(config.trajectory_slabs);
  if (is_lock_step()) {
    if (config.deterministic && plan_.decision_limit <= 0) {
      return Error{ErrorCode::kBadInput, "--deterministic: scenario " + config.scenario +
                                             " has no decision limit, so its journal cannot be sized"};
    }
    shape.journal_steps =
        plan_.decision_limit <= 0
            ? 0
            : static_cast<int32_t>(std::min<int64_t>(plan_.decision_limit, INT32_MAX - 1)) + 1;
  }
  shape.weights_bytes =
      weights_bytes_limit(config, plan_.env.num_agents, plan_.env.frame_bytes(), plan_.env.logit_count());
  return shape;
}

Status Supervisor::open_arena() {
  server_.reset();  // the old arena goes before the new one comes: both may not fit
  bus_.reset();
  arena_.reset();
  learner_epoch_ = 0;
  report_sequence_ = 0;
  played_decisions_.start_from(0);
  uint64_t run_id = 0;
  if (getrandom(&run_id, sizeof run_id, 0) != sizeof run_id) {
    return system_error("getrandom");
  }
  // The socket's name is there for every user of the host to see; the bus's ids follow from the run id, which only
  // the arena's members can read.
  uint64_t name_id = 0;
  if (getrandom(&name_id, sizeof name_id, 0) != sizeof name_id) {
    return system_error("getrandom");
  }
  char name[32];
  std::snprintf(name, sizeof name, "comrad-%016" PRIx64, name_id);
  COMRAD_TRY_ASSIGN(const shm::ArenaShape shape, arena_shape());
  COMRAD_TRY_ASSIGN(arena_, shm::Arena::create(shape, run_id));
  shm::ControlBlock& control = arena_->control();
  control.run_state.store(shm::RunState::kStarting);
  if (plan_.episodes > 0) control.episodes_per_run.store(plan_.episodes);
  if (!trains()) control.rollouts_allowed.store(UINT64_MAX);  // no learner will
  control.env_frames_lost.store(outcome_.env_frames_lost);
  COMRAD_TRY_ASSIGN(shm::ArenaServer server, shm::ArenaServer::listen(name, *arena_));
  server_.emplace(std::move(server));
  COMRAD_TRY_ASSIGN(bus_, dds::Bus::open(dds::bus_config_for_run(run_id)));
  write_control("running");
  spdlog::info("run {} in {}: arena of {:.1f} MB, {} slabs", name, plan_.run_dir,
               static_cast<double>(shm::Arena::size_bytes(shape)) * 1e-6, shape.slab_count);
  return {};
}

Status Supervisor::spawn(Worker& worker) {
  const RunConfig& config = plan_.config;
  ChildOptions options;
  options.program = bin_dir_ + "/" + program_of(worker.role);
  options.arguments = {"--run_dir", plan_.run_dir, "--arena", server_->name()};
  const auto add = [&](auto... words) { (options.arguments.emplace_back(words), ...); };
  const auto set = [&](const char* name, const std::string& value) {
    options.environment.emplace_back(name, value);
  };
  const auto suggest = [&](const char* name, const char* value) {
    if (std::getenv(name) == nullptr) set(name, value);
  };
  const auto set_threads = [&](int64_t count) {
    for (const char* name : {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"}) {
      set(name, std::to_string(count));
    }
    suggest("OMP_WAIT_POLICY", "PASSIVE");  // a thread that spins at a barrier takes a simulator's core
  };
  if (worker.role != Role::kLearner) add("--worker_index", std::to_string(worker.index));
  switch (worker.role) {
    case Role::kSim:
      if (evaluates()) add("--evaluate");
      if (plan_.policy == PolicySource::kOracle) add("--oracle");
      set_threads(1);
      set("LP_NUM_THREADS", "0");  // llvmpipe draws on the calling thread: one core per simulator
      suggest("GALLIUM_DRIVER", "llvmpipe");
      if (config.set_workers_cpu_affinity) {
        const std::vector<int> cpus = allowed_cpus();
        if (!cpus.empty()) options.cpu = cpus[static_cast<std::size_t>(worker.index) % cpus.size()];
      }
      break;
    case Role::kPolicy:
      if (plan_.greedy) add("--greedy");
      if (!has_learner()) add("--random");  // an oracle's simulators do not look at the answers
      if (evaluates()) add("--evaluate");
      set_threads(config.policy_threads);
      break;
    case Role::kLearner:
      add("--mode", trains() ? "train" : "serve");
      if (plan_.policy == PolicySource::kCheckpoint) add("--checkpoint", plan_.checkpoint);
      set_threads(std::max<int64_t>(1, config.learner_threads));
      options.inherited_descriptor = plan_.lock_descriptor;
      break;
  }
  worker.has_joined = false;
  worker.restart_at_s = 0;
  worker.started_s = monotonic_s();
  worker.last_line.clear();
  worker.decisions_at_start = counters_of(worker).decisions.load();
  COMRAD_TRY_ASSIGN(worker.process, ChildProcess::spawn(options));
  spdlog::info("started {} (pid {})", worker.name, worker.process->pid());
  return {};
}

void Supervisor::tick() {
  std::vector<pollfd> sources{{.fd = signals_.descriptor(), .events = POLLIN, .revents = 0}};
  if (server_) sources.push_back({.fd = server_->descriptor(), .events = POLLIN, .revents = 0});
  for (const Worker& worker : workers_) {
    if (worker.process && worker.process->output_descriptor() >= 0) {
      sources.push_back({.fd = worker.process->output_descriptor(), .events = POLLIN, .revents = 0});
    }
  }
  poll(sources.data(), sources.size(), kTickMs);
  hear_signals();
  serve_joins();
  hear_children();
  bury_the_dead();
  restart_due();
  if (!arena_ || !bus_) {
    enforce_stop();
    return;
  }
  begin_running_when_all_joined();
  drain_episodes();
  take_stats();
  measure();
  listen_to_workers();
  check_goals();
  enforce_stop();
  report();
}

void Supervisor::hear_signals() {
  for (int number; (number = signals_.next()) != 0;) {
    if (number == SIGCHLD) continue;  // bury_the_dead() looks anyway
    if (number == SIGUSR1) {
      if (trains() && arena_) {
        arena_->control().checkpoint_seq.fetch_add(1);
        note("SIGUSR1: a checkpoint is saved after this optimizer step");
      }
      continue;
    }
    if (!is_complete_) outcome_.interrupted = true;
    if (number == SIGINT && ++interrupts_ >= 2) {
      killed_at_once_ = true;
      for (Worker& worker : workers_) {
        if (worker.process) worker.process->send_signal(SIGKILL);
      }
    }
    const std::string name = number == SIGINT ? "SIGINT" : number == SIGTERM ? "SIGTERM" : "SIGHUP";
    if (phase_ == Phase::kStopping) continue;
    stop("interrupted by " + name);
    note(name + ": stopping" + (trains() ? " after this optimizer step and a checkpoint" : "") +
         "; press Ctrl-C again to stop at once");
  }
}

void Supervisor::serve_joins() {
  if (!server_) return;
  for (pollfd waiting{.fd = server_->descriptor(), .events = POLLIN, .revents = 0};
       poll(&waiting, 1, 0) > 0;) {
    Expected<shm::JoinRequest> joined = server_->serve_one();
    if (!joined) {
      spdlog::info("{}", joined.error().message);
      return;
    }
    const std::string role(joined->role, strnlen(joined->role, sizeof joined->role));
    for (Worker& worker : workers_) {
      if (role == word_of(worker.role) && joined->worker_index == static_cast<uint32_t>(worker.index)) {
        worker.has_joined = true;
      }
    }
    spdlog::info("{}-{} joined", role, joined->worker_index);
  }
}

void Supervisor::hear_children() {
  const double now_s = monotonic_s();
  for (Worker& worker : workers_) {
    if (!worker.process) continue;
    for (const std::string& line : worker.process->read_lines()) {
      worker.last_line = line;
      spdlog::info("{} says: {}", worker.name, line);
      if (const std::string words = warning_in(line); !words.empty()) {
        // A restarted worker says it again, with other numbers.
        std::string kind = words;
        std::erase_if(kind, [](char letter) { return letter == '.' || (letter >= '0' && letter <= '9'); });
        if (warnings_shown_.insert(kind).second) printer_.note(words);
        continue;
      }
      if (now_s - worker.minute_began_s > 60) {
        worker.minute_began_s = now_s;
        worker.lines_shown = 0;
      }
      if (++worker.lines_shown <= kLinesShownPerMinute) printer_.note(worker.name + ": " + line);
      if (worker.lines_shown == kLinesShownPerMinute)
        printer_.note(worker.name + ": (more in logs/supervisor.log)");
    }
  }
}

void Supervisor::bury_the_dead() {
  std::vector<std::pair<Worker*, ExitStatus>> dead;
  for (Worker& worker : workers_) {
    if (!worker.process) continue;
    if (phase_ != Phase::kStopping && !worker.has_joined &&
        monotonic_s() - worker.started_s > kJoinTimeoutS) {
      worker.last_line =
          "did not join the run within " + std::to_string(static_cast<int>(kJoinTimeoutS)) + " s";
      worker.process->send_signal(SIGKILL);
    }
    if (const std::optional<ExitStatus>& how = worker.process->poll_exit()) {
      for (const std::string& line : worker.process->read_lines()) worker.last_line = line;
      dead.emplace_back(&worker, *how);
      worker.process.reset();
    }
  }
  // Simulators last: taking one's slots back waits for the answers of policy workers, dead ones give none.
  std::stable_sort(dead.begin(), dead.end(),
                   [](const auto& a, const auto& b) { return a.first->role > b.first->role; });
  for (auto& [worker, how] : dead) died(*worker, how);
}

void Supervisor::died(Worker& worker, const ExitStatus& how) {
  const bool is_clean = how.signal == 0 && how.code == 0;
  spdlog::info("{} left: {}", worker.name, how.text());
  worker.has_joined = false;
  if (phase_ == Phase::kStopping) {
    // Leaving is what they were asked for; only a learner that could not save matters.
    if (worker.role == Role::kLearner && trains() && !is_clean) learner_was_killed_ = true;
    return;
  }
  if (worker.role == Role::kLearner && trains() && is_clean) {
    if (arena_->control().goal_reached.load() != 0) {
      complete("finished" + limit_reached());
    } else {
      outcome_.interrupted = true;
      stop("the learner was told to stop (SIGTERM) before the run's goal");
    }
    return;
  }
  if (worker.last_line.empty()) worker.last_line = last_log_line(log_path(worker));
  const std::string said =
      worker.last_line.empty() ? "it said nothing" : "its last line: " + worker.last_line;
  if (how.signal == 0 && how.code == kExitNotSaved) {
    // Starting it again would train the same frames once more, for the same end.
    fail({ErrorCode::kNoSpace, "the last checkpoint could not be written, " + unsaved_text() +
                                   "; make room and start the same command again (" + said + ")"});
    return;
  }
  if (how.signal == 0 && how.code == kExitBadInput) {
    fail({ErrorCode::kBadInput, worker.name + " cannot run: " + said});
    return;
  }

  uint64_t lost = 0;
  const TrajectoryShape& shape = arena_->shape().trajectory;
  switch (worker.role) {
    case Role::kSim:
      lost = arena_->reclaim_sim_worker(worker.index);
      break;
    case Role::kPolicy:
      arena_->reclaim_policy_worker(worker.index);  // its questions are asked again, nothing is lost
      break;
    case Role::kLearner:
      lost = static_cast<uint64_t>(arena_->reclaim_learner()) * static_cast<uint64_t>(shape.rollout_steps) *
             static_cast<uint64_t>(shape.env.num_agents);
      break;
  }
  const bool did_work = counters_of(worker).decisions.load() != worker.decisions_at_start;
  outcome_.steps_lost += lost;
  ++outcome_.restarts;
  const double now_s = monotonic_s();
  const std::optional<double> delay_s = worker.history.next_delay_s(now_s, did_work);
  if (!delay_s) {
    fail({ErrorCode::kPeerLost, worker.name + " died " + std::to_string(plan_.restarts.deaths) +
                                    " times and is given up (" + how.text() + "); " + said + " (see " +
                                    log_path(worker) + ")"});
    return;
  }
  worker.restart_at_s = now_s + *delay_s;
  char delay[32];
  std::snprintf(delay, sizeof delay, "%.1f s", *delay_s);
  note(worker.name + " died (" + how.text() + "), starts again in " + delay +
       (lost > 0 ? "; " + std::to_string(lost) + " decisions lost" : "") +
       (worker.role == Role::kLearner && trains() ? "; training goes on from the last checkpoint" : ""));
  // Lock step must not depend on who died when: everybody goes back to the last checkpoint together.
  if (is_lock_step()) restart_everything();
}

void Supervisor::restart_everything() {
  double restart_at_s = monotonic_s();
  for (const Worker& worker : workers_) restart_at_s = std::max(restart_at_s, worker.restart_at_s);
  for (Worker& worker : workers_) {
    worker.process.reset();  // kills and reaps
    worker.has_joined = false;
    worker.restart_at_s = restart_at_s;
  }
  phase_ = Phase::kStarting;
  if (Status opened = open_arena(); !opened) fail(opened.error());
}

void Supervisor::restart_due() {
  if (phase_ == Phase::kStopping) return;
  for (Worker& worker : workers_) {
    if (worker.restart_at_s == 0 || monotonic_s() < worker.restart_at_s) continue;
    if (Status spawned = spawn(worker); !spawned) fail(spawned.error());
  }
}

void Supervisor::begin_running_when_all_joined() {
  if (phase_ != Phase::kStarting) return;
  if (!std::all_of(workers_.begin(), workers_.end(), [](const Worker& worker) { return worker.has_joined; }))
    return;
  phase_ = Phase::kRunning;
  running_since_s_ = monotonic_s();
  arena_->control().run_state.store(shm::RunState::kRunning, std::memory_order_release);
  shm::ring(arena_->control().run_state_changed);
  next_status_s_ = next_line_s_ = 0;
}

void Supervisor::drain_episodes() {
  const auto agents = static_cast<std::size_t>(arena_->shape().trajectory.env.num_agents);
  while (const std::optional<shm::EpisodeRecord> record = arena_->pop_episode()) {
    dds::EpisodeResult result{
        .scenario = plan_.config.scenario,
        .layout_id = record->layout_id,
        .episode_id = record->episode_id,
        .episode_seed = record->episode_seed,
        .env_index = record->env_index,
        .score = record->score,
        .ceiling = record->ceiling,
        .agent_return = std::vector<double>(record->agent_return, record->agent_return + agents),
        .agent_score = std::vector<double>(record->agent_score, record->agent_score + agents),
        .length_steps = record->length_steps,
        .length_tics = record->length_tics,
        .terminated = record->terminated != 0,
    };
    if (trains()) arena_->forward_episode(*record);
    warn_once(bus_->write(result));
    if (plan_.episodes > 0 && result.episode_id < plan_.episodes)
      episodes_.emplace(result.episode_id, std::move(result));
  }
  if (const uint64_t dropped = arena_->episodes_dropped(); dropped > episodes_dropped_) {
    episodes_dropped_ = dropped;
    note(std::to_string(dropped) + " episode records were lost: the supervisor was held up");
  }
}

void Supervisor::take_stats() {
  const std::optional<shm::LearnerReport> report = arena_->read_report(report_sequence_);
  if (!report) return;
  outcome_.last_stats = {.time_s = report->time_s,
                         .env_frames = report->env_frames,
                         .decisions = report->decisions,
                         .learner_version = report->learner_version,
                         .env_frames_per_s = report->env_frames_per_s,
                         .decisions_per_s = report->decisions_per_s,
                         .score_mean = report->score_mean,
                         .return_mean = report->return_mean,
                         .episodes = report->episodes,
                         .policy_lag_mean = report->policy_lag_mean,
                         .policy_lag_max = report->policy_lag_max,
                         .last_checkpoint = report->last_checkpoint};
  warn_once(bus_->write(outcome_.last_stats));
  if (window_began_s_ > 0 && std::isfinite(report->policy_lag_mean)) {
    lag_sum_ += report->policy_lag_mean;
    ++lag_count_;
  }
}

void Supervisor::count_work() {
  played_decisions_.see(sim_decisions());
  // A learner sets its counters to those of the checkpoint it resumes, then its state to running.
  const shm::WorkerCounters& learner = arena_->learner_counters();
  if (learner.state.load(std::memory_order_acquire) < shm::WorkerState::kRunning) return;
  const uint64_t trained = learner.decisions.load(std::memory_order_relaxed);
  const uint64_t updates = learner.batches.load(std::memory_order_relaxed);
  uint64_t fallen = 0;
  if (const uint32_t epoch = learner.epoch.load(); std::exchange(learner_epoch_, epoch) != epoch) {
    fallen = trained_decisions_.start_from(trained);
    trained_updates_.start_from(updates);
  }
  fallen += trained_decisions_.see(trained);
  trained_updates_.see(updates);
  if (fallen > 0 && trains()) note_going_back(fallen);
}

/// A learner that starts again has forgotten what it learned since its last checkpoint.
void Supervisor::note_going_back(uint64_t decisions) {
  ++goings_back_;
  outcome_.env_frames_lost += decisions * static_cast<uint64_t>(plan_.config.env_frameskip);
  arena_->control().env_frames_lost.store(outcome_.env_frames_lost);
  // The dead one's last report is no longer true; the new one's comes later.
  outcome_.last_stats.env_frames = arena_->control().learner_env_frames.load(std::memory_order_relaxed);
  outcome_.last_stats.decisions = trained_decisions_.seen();
  note(going_back_text());
}

/// What is lost when no further checkpoint is written.
std::string Supervisor::unsaved_text() const {
  const uint64_t saved = arena_ ? arena_->control().saved_env_frames.load(std::memory_order_relaxed) : 0;
  const uint64_t now = env_frames();
  return count_text(static_cast<double>(now > saved ? now - saved : 0)) + " env frames since " +
         (saved > 0 ? "the one at " + count_text(static_cast<double>(saved)) : "the run's beginning") +
         " are lost";
}

/// How much learning was lost; empty where none was.
std::string Supervisor::going_back_text() const {
  if (goings_back_ == 0) return "";
  return "learner went back " + count_text(static_cast<double>(outcome_.env_frames_lost)) +
         " env frames to its last checkpoint" +
         (goings_back_ > 1 ? ", in " + std::to_string(goings_back_) + " restarts" : "");
}

void Supervisor::measure() {
  count_work();
  const double now_s = monotonic_s();
  const bool has_begun = trains() ? trained_updates_.total() > 0 : played_decisions_.total() > 0;
  if (has_begun && first_work_s_ == 0) first_work_s_ = now_s;
  if (plan_.seconds <= 0 || first_work_s_ == 0 || phase_ != Phase::kRunning) return;
  if (window_began_s_ == 0 && now_s >= first_work_s_ + plan_.warmup_seconds) {
    window_began_s_ = now_s;
    window_decisions_ = decisions();
    window_updates_ = trained_updates_.total();
  }
  if (window_began_s_ > 0 && now_s >= window_began_s_ + plan_.seconds) {
    outcome_.measured_seconds = now_s - window_began_s_;
    outcome_.measured_decisions = decisions() - window_decisions_;
    outcome_.measured_updates = trained_updates_.total() - window_updates_;
    complete("measured");
  }
}

void Supervisor::listen_to_workers() {
  const double now_s = monotonic_s();
  const bool is_at_work =
      phase_ == Phase::kRunning && arena_->control().run_state.load() == shm::RunState::kRunning;
  for (Worker& worker : workers_) {
    const uint64_t decisions = counters_of(worker).decisions.load(std::memory_order_relaxed);
    if (!is_at_work || !worker.process || std::exchange(worker.decisions_heard, decisions) != decisions)
      worker.heard_s = now_s;
  }
}

/// "sim-0 silent for 12s (SIGSTOP)"; empty where nobody is. Who waits for others is not to blame: a worker is named
/// where somebody stopped it, or where another of its kind goes on.
std::string Supervisor::silence_text() const {
  const double now_s = monotonic_s();
  const auto silent_s = [now_s](const Worker& worker) { return now_s - worker.heard_s; };
  std::string text;
  for (const Worker& worker : workers_) {
    if (!worker.process || silent_s(worker) < kSilentAfterS) continue;
    const bool is_stopped = worker.process->is_stopped();
    const bool others_work = std::any_of(workers_.begin(), workers_.end(), [&](const Worker& other) {
      return other.role == worker.role && silent_s(other) < kSilentAfterS;
    });
    if (!is_stopped && !others_work) continue;
    text += (text.empty() ? "" : ", ") + worker.name + " silent for " + duration_text(silent_s(worker)) +
            (is_stopped ? " (SIGSTOP)" : "");
  }
  return text;
}

bool Supervisor::stands_still() const {
  return std::none_of(workers_.begin(), workers_.end(), [now_s = monotonic_s()](const Worker& worker) {
    return worker.role == Role::kSim && now_s - worker.heard_s < kSilentAfterS;
  });
}

void Supervisor::check_goals() {
  if (phase_ != Phase::kRunning) return;
  if (plan_.episodes > 0 && episodes_.size() >= plan_.episodes) complete("finished");
}

/// " (--train_for_...)", the limit that ended the training as the command line spells it: a resumed run may
/// have nothing left of it. Empty where the learner had another reason.
std::string Supervisor::limit_reached() const {
  const RunConfig& config = plan_.config;
  if (static_cast<double>(env_frames()) >= config.train_for_env_steps)
    return " (--train_for_env_steps " + std::to_string(std::llround(config.train_for_env_steps)) + ")";
  if (config.train_for_seconds > 0)
    return " (--train_for_seconds " + std::to_string(std::llround(config.train_for_seconds)) + ")";
  return "";
}

void Supervisor::stop(const std::string& why) {
  if (phase_ == Phase::kStopping) return;
  phase_ = Phase::kStopping;
  stopping_since_s_ = monotonic_s();
  outcome_.message = why;
  spdlog::info("stopping: {}", why);
  for (Worker& worker : workers_) {
    // A dead learner that waits for its next start saves nothing any more; a bench needs nothing of it.
    learner_was_killed_ |=
        worker.role == Role::kLearner && trains() && worker.restart_at_s > 0 && plan_.seconds <= 0;
    worker.restart_at_s = 0;
  }
  if (!arena_ || !bus_) return;
  write_control("stopping");  // the learner hears it first; then everybody on this host
  shm::ControlBlock& control = arena_->control();
  control.run_state.store(shm::RunState::kStopping, std::memory_order_release);
  for (shm::Doorbell* bell : {&control.run_state_changed, &control.slab_sealed, &control.slab_released,
                              &control.weights_published}) {
    shm::ring(*bell);
  }
  const shm::ArenaShape& shape = arena_->shape();
  for (int policy = 0; policy < shape.policy_worker_count; ++policy) shm::ring(arena_->slots_ready(policy));
  for (int sim = 0; sim < shape.sim_worker_count; ++sim) {
    for (int split = 0; split < shape.splits_per_worker; ++split) shm::ring(arena_->slots_acted(sim, split));
  }
  next_status_s_ = 0;
}

void Supervisor::complete(const std::string& why) {
  is_complete_ = phase_ != Phase::kStopping;
  stop(why);
}

void Supervisor::enforce_stop() {
  if (phase_ != Phase::kStopping) return;
  const double waited_s = monotonic_s() - stopping_since_s_;
  for (Worker& worker : workers_) {
    if (!worker.process) continue;
    const int next = waited_s >= kKillAfterS ? SIGKILL : waited_s >= kTermAfterS ? SIGTERM : 0;
    if (next == 0 || worker.stop_signal == next) continue;
    worker.stop_signal = next;
    worker.process->send_signal(next);
    if (next == SIGKILL) note(worker.name + " did not stop in time and is killed");
  }
}

void Supervisor::fail(Error error) {
  if (!error_) error_ = std::move(error);
  spdlog::info("failed: {}", error_->message);
  stop("failed");
}

void Supervisor::report() {
  const double now_s = monotonic_s();
  if (now_s >= next_worker_status_s_) {
    const double elapsed_s = worker_status_s_ > 0 ? now_s - worker_status_s_ : 0;
    worker_status_s_ = now_s;
    next_worker_status_s_ = now_s + kWorkerStatusIntervalS;
    const char* state = phase_ == Phase::kStarting  ? "starting"
                        : phase_ == Phase::kRunning ? "running"
                                                    : "stopping";
    dds::WorkerStatus status{.worker_id = "supervisor",
                             .host = host_,
                             .pid = getpid(),
                             .role = "supervisor",
                             .state = state,
                             .decisions_per_s = 0,
                             .message = plan_.run_dir};
    warn_once(bus_->write(status));
    for (Worker& worker : workers_) {
      if (worker.role != Role::kSim) continue;  // the others speak for themselves
      const uint64_t count = arena_->sim_counters(worker.index).decisions.load(std::memory_order_relaxed);
      const uint64_t grown = count >= worker.decisions_at_report ? count - worker.decisions_at_report : 0;
      worker.decisions_at_report = count;
      status = {.worker_id = worker.name,
                .host = host_,
                .pid = worker.process ? worker.process->pid() : 0,
                .role = "sim",
                .state = !worker.process      ? (phase_ == Phase::kStopping ? "stopping" : "failed")
                         : !worker.has_joined ? "starting"
                                              : state,
                .decisions_per_s = elapsed_s > 0 ? static_cast<double>(grown) / elapsed_s : 0,
                .message = worker.last_line};
      warn_once(bus_->write(status));
    }
  }
  if (now_s >= next_status_s_) {
    next_status_s_ = now_s + kStatusIntervalS;
    const char* state = phase_ == Phase::kStarting ? "starting" : "running";
    const std::string message =
        phase_ == Phase::kStopping ? "stopping: " + outcome_.message : progress_text();
    warn_once(write_status(plan_.run_dir, status_now(state, message)));
  }
  if (now_s >= next_line_s_ && phase_ != Phase::kStopping) {
    next_line_s_ = now_s + std::max(plan_.config.progress_interval, 0.1);
    printer_.line(progress_text());
  }
}

void Supervisor::note(const std::string& text) {
  spdlog::info("{}", text);
  printer_.note(text);
}

void Supervisor::write_control(const char* run_state) {
  warn_once(bus_->write(dds::RunControl{.run_state = run_state, .checkpoint_seq = 0, .settings_epoch = 0}));
}

/// A bus or a status file that fails is no reason to stop training, and one line about it is enough.
void Supervisor::warn_once(const Status& status) {
  if (status) return;
  spdlog::info("{}", status.error().message);
  if (!std::exchange(bus_warned_, true)) printer_.note("warning: " + status.error().message);
}

bool Supervisor::any_alive() const {
  return std::any_of(workers_.begin(), workers_.end(),
                     [](const Worker& worker) { return worker.process.has_value(); });
}

uint64_t Supervisor::sim_decisions() const {
  uint64_t sum = 0;
  for (int sim = 0; sim < arena_->shape().sim_worker_count; ++sim) {
    sum += arena_->sim_counters(sim).decisions.load(std::memory_order_relaxed);
  }
  return sum;
}

shm::WorkerCounters& Supervisor::counters_of(const Worker& worker) const {
  return worker.role == Role::kSim      ? arena_->sim_counters(worker.index)
         : worker.role == Role::kPolicy ? arena_->policy_counters(worker.index)
                                        : arena_->learner_counters();
}

/// Agent decisions of this process's life: those trained on, or those played where nobody trains.
uint64_t Supervisor::decisions() const {
  return trains() ? trained_decisions_.total() : played_decisions_.total();
}

/// Env frames of the whole run, earlier lives included.
uint64_t Supervisor::env_frames() const {
  const uint64_t live = arena_ ? arena_->control().learner_env_frames.load(std::memory_order_relaxed) : 0;
  return std::max(live, outcome_.last_stats.env_frames);
}

std::string Supervisor::joined_text() const {
  int joined[3] = {}, expected[3] = {};
  for (const Worker& worker : workers_) {
    ++expected[static_cast<int>(worker.role)];
    joined[static_cast<int>(worker.role)] += worker.has_joined;
  }
  const auto part = [&](Role role, const char* name) {
    const int i = static_cast<int>(role);
    return std::to_string(joined[i]) + "/" + std::to_string(expected[i]) + " " + name;
  };
  return "starting: " + part(Role::kSim, "simulators") + ", " + part(Role::kPolicy, "policy workers") +
         (has_learner() ? ", " + part(Role::kLearner, "learner") : "");
}

std::string Supervisor::progress_text() const {
  if (phase_ == Phase::kStarting) return joined_text();
  const double elapsed_s = std::max(monotonic_s() - running_since_s_, 1e-3);
  const double played_per_s = static_cast<double>(played_decisions_.total()) / elapsed_s;
  const auto frame_skip = static_cast<double>(plan_.config.env_frameskip);
  if (!trains()) {
    std::string text;
    if (plan_.episodes > 0) {
      text = "episodes " + std::to_string(episodes_.size()) + "/" + std::to_string(plan_.episodes);
      double sum = 0;
      for (const auto& [id, episode] : episodes_) sum += episode.score;
      char score[32];
      std::snprintf(score, sizeof score, " | J %.1f", sum / static_cast<double>(episodes_.size()));
      if (!episodes_.empty()) text += score;
      text += " | ";
    }
    char rates[96];
    std::snprintf(rates, sizeof rates, "%.0f env frames/s, %.0f decisions/s", played_per_s * frame_skip,
                  played_per_s);
    return text + rates;
  }
  const dds::TrainStats& stats = outcome_.last_stats;
  if (stats.learner_version == 0 && stats.env_frames == 0) {
    return "collecting the first batch: " + count_text(static_cast<double>(played_decisions_.total())) +
           " decisions played";
  }
  TrainingProgress progress;
  progress.env_frames = static_cast<double>(env_frames());
  progress.env_frames_lost = static_cast<double>(outcome_.env_frames_lost);
  progress.env_frames_total = plan_.seconds > 0 ? 0 : plan_.config.train_for_env_steps;
  progress.env_frames_per_s = stats.env_frames_per_s;
  progress.decisions_per_s = stats.decisions_per_s;
  if (stats.episodes > 0) {
    progress.score_mean = stats.score_mean;
    progress.return_mean = stats.return_mean;
  }
  progress.lag_mean = stats.policy_lag_mean;
  progress.lag_max = stats.policy_lag_max;
  progress.silence = silence_text();
  if (stands_still()) progress.env_frames_per_s = progress.decisions_per_s = 0;
  return training_line(progress);
}

RunStatus Supervisor::status_now(const std::string& state, const std::string& message) const {
  const dds::TrainStats& stats = outcome_.last_stats;
  RunStatus status;
  status.state = state;
  status.learner_version = stats.learner_version;
  status.message = message;
  if (trains()) {
    status.env_frames = env_frames();
    status.decisions = std::max(stats.decisions, trained_decisions_.seen());
    if (stats.episodes > 0) status.score_mean = stats.score_mean;
    status.env_frames_per_s = stands_still() ? 0 : stats.env_frames_per_s;
  } else {
    status.decisions = played_decisions_.total();
    status.env_frames = status.decisions * static_cast<uint64_t>(plan_.config.env_frameskip);
    double sum = 0;
    for (const auto& [id, episode] : episodes_) sum += episode.score;
    if (!episodes_.empty()) status.score_mean = sum / static_cast<double>(episodes_.size());
    const double elapsed_s = monotonic_s() - running_since_s_;
    if (running_since_s_ > 0 && elapsed_s > 0) {
      status.env_frames_per_s = static_cast<double>(status.env_frames) / elapsed_s;
    }
  }
  return status;
}

Expected<RunOutcome> Supervisor::finish() {
  // What the workers said last.
  if (arena_ && bus_) {
    drain_episodes();
    take_stats();
    count_work();
  }
  for (auto& [id, episode] : episodes_) outcome_.episodes.push_back(std::move(episode));
  outcome_.lag_mean = lag_count_ > 0 ? lag_sum_ / lag_count_ : outcome_.last_stats.policy_lag_mean;
  printer_.end();

  std::string state = "finished";
  if (killed_at_once_) {
    outcome_.exit_code = 130;  // as a shell reports SIGINT
    outcome_.message += ", stopped at once";
    state = "paused";
  } else if (learner_was_killed_) {
    outcome_.exit_code = 1;
    outcome_.message += "; the learner did not save a last checkpoint: " + unsaved_text();
    state = "paused";
  } else if (outcome_.interrupted && !is_complete_) {
    if (trains()) {
      outcome_.message +=
          "; go on with --experiment " + std::filesystem::path(plan_.run_dir).filename().string();
    }
    state = "paused";
  }
  if (error_) {
    state = "failed";
    outcome_.message = error_->message;
  }
  const std::string lost = going_back_text();
  warn_once(
      write_status(plan_.run_dir, status_now(state, outcome_.message + (lost.empty() ? "" : "; " + lost))));
  if (error_) return *error_;

  const double worked_s = (stopping_since_s_ > 0 ? stopping_since_s_ : monotonic_s()) -
                          (running_since_s_ > 0 ? running_since_s_ : started_s_);
  const double per_s = worked_s > 0 ? static_cast<double>(decisions()) / worked_s : 0;
  const double frame_skip = static_cast<double>(plan_.config.env_frameskip);
  // What the run has learned from, and, where earlier runs or a learner that went back make a difference, what this
  // process trained on.
  const std::string worked = count_text(static_cast<double>(decisions()) * frame_skip);
  const std::string learned = trains() ? count_text(static_cast<double>(env_frames())) : worked;
  char rates[160];
  std::snprintf(rates, sizeof rates, " in %s, %.0f env frames/s, %.0f decisions/s",
                duration_text(worked_s).c_str(), per_s * frame_skip, per_s);
  std::string summary = outcome_.message + ": " + learned + " env frames" +
                        (worked == learned ? "" : ", " + worked + " trained on") + rates;
  if (trains() && outcome_.last_stats.episodes > 0 && std::isfinite(outcome_.last_stats.score_mean)) {
    char score[48];
    std::snprintf(score, sizeof score, ", J %.1f", outcome_.last_stats.score_mean);
    summary += score;
  }
  if (!lost.empty()) summary += "; " + lost;
  if (!outcome_.last_stats.last_checkpoint.empty())
    summary += "; checkpoint " + outcome_.last_stats.last_checkpoint;
  if (outcome_.restarts > 0) {
    summary += "; " + std::to_string(outcome_.restarts) + " restarts, " +
               std::to_string(outcome_.steps_lost) + " decisions lost";
  }
  spdlog::info("{}", summary);
  outcome_.message = summary;
  return std::move(outcome_);
}

}  // namespace

Expected<RunOutcome> run(const LaunchPlan& plan) { return Supervisor(plan).run(); }

}  // namespace comrad::deploy
