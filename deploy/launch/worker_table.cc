#include "deploy/launch/worker_table.h"

#include <spdlog/fmt/fmt.h>

#include <signal.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "deploy/process/process_start.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/metrics/learner_messages.h"
#include "rollout_buffer/shm/arena_socket.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::deploy {
namespace {

constexpr double kSilentAfterS = 10.0;    // a worker whose counter stands still so long is named
constexpr int kLinesShownPerMinute = 20;  // of one worker's output on the terminal; the log has them all

/// What distinguishes the kinds, in the order of Role.
struct Kind {
  const char* word;  ///< as it joins, and in its name
  const char* program;
  const char* plural;
};
constexpr Kind kKinds[] = {{"sim", "comrad-sim-worker", "simulators"},
                           {"policy", "comrad-policy-worker", "policy workers"},
                           {"learner", "comrad-learner", "learner"},
                           {"receiver", "comrad-trajectory-receiver", "trajectory receiver"},
                           {"frame-receiver", "comrad-frame-receiver", "frame receiver"},
                           {"sender", "comrad-trajectory-sender", "trajectory sender"}};
static_assert(std::ranges::all_of(kKinds, [](const Kind& kind) {
  return std::string_view(kind.word).size() < sizeof(shm::JoinRequest::role);
}));
constexpr bool is_single(Role role) { return role != Role::kSim && role != Role::kPolicy; }
constexpr const char* kRecordingSimulator = "comrad-sim-video";
constexpr const char* kShowingSimulator = "comrad-sim-watch";

const Kind& kind_of(const Worker& worker) { return kKinds[static_cast<std::size_t>(worker.role)]; }

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

}  // namespace

const char* name_of(Role role) { return kKinds[static_cast<std::size_t>(role)].plural; }
const char* word_of(Role role) { return kKinds[static_cast<std::size_t>(role)].word; }

WorkerTable::WorkerTable(const LaunchPlan& plan, const Clock& clock, ProcessHost& processes)
    : plan_(plan), clock_(clock), processes_(processes) {
  const auto add = [&](Role role, int64_t count) {
    for (int i = 0; i < count; ++i) {
      Worker& worker = workers_.emplace_back();
      worker.role = role;
      worker.index = i;
      worker.name = kind_of(worker).word;
      if (!is_single(role)) worker.name += fmt::format("-{}", i);
      worker.history = RestartHistory(plan.restarts);
    }
  };
  add(Role::kSim, plan.own_workers());
  add(Role::kPolicy, plan.own_policy_workers());
  if (plan.has_learner()) add(Role::kLearner, 1);
  if (plan.serves()) add(Role::kTrajectoryReceiver, 1);
  if (plan.remote_frame_workers() > 0) add(Role::kFrameReceiver, 1);
  if (plan.feeds()) add(Role::kTrajectorySender, 1);
}

ChildOptions WorkerTable::options_of(const Worker& worker, const std::string& server) const {
  const RunConfig& config = plan_.config;
  ChildOptions options;
  const bool records = worker.role == Role::kSim && plan_.recording.is_wanted();
  const bool shows = worker.role == Role::kSim && plan_.page.is_wanted();
  options.program = plan_.program(records ? kRecordingSimulator
                                  : shows ? kShowingSimulator
                                          : kind_of(worker).program);
  options.arguments = {"--run_dir", plan_.run_dir, "--arena", server};
  const auto add = [&](auto... words) { (options.arguments.emplace_back(words), ...); };
  const auto set = [&](const char* name, const std::string& value) {
    options.environment.emplace_back(name, value);
  };
  const auto suggest = [&](const char* name, const char* value) {
    if (std::getenv(name) == nullptr) set(name, value);
  };
  const auto set_threads = [&](int64_t count) {
    for (const char* name : {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"})
      set(name, std::to_string(count));
    for (const auto& [name, value] : sleeping_threads()) set(name.c_str(), value);
  };
  if (!is_single(worker.role)) add("--worker_index", std::to_string(worker.index));
  // Measured on two cores alone (BENCHMARKS.md); where more share the work, a policy worker that waits may hold up many.
  options.waits_its_turn =
      allowed_cpus().size() <= kFewCores &&
      (worker.role == Role::kSim || worker.role == Role::kPolicy || worker.role == Role::kLearner);
  switch (worker.role) {
    case Role::kSim:
      if (plan_.evaluates()) add("--evaluate");
      if (plan_.policy == PolicySource::kOracle) add("--oracle");
      if (const std::vector<int> seats = plan_.seats.seats_of(SeatPlayer::kOracle); !seats.empty())
        add("--oracle_seats", joined(seats, ","));
      if (plan_.keeps_positions) add("--positions", plan_.positions_path(worker.index));
      if (plan_.keeps_episodes) add("--episodes", plan_.episodes_folder());
      if (records) {
        add("--video_size", plan_.recording.size);
        if (plan_.recording.seconds > 0) add("--video_seconds", std::to_string(plan_.recording.seconds));
        if (!plan_.recording.video.empty()) {
          add("--video", plan_.recording.video);
          add("--finished_video", plan_.recording.finished_video);
        }
        if (!plan_.recording.frames.empty()) add("--video_frames", plan_.recording.frames);
      }
      if (shows) {
        add("--page", plan_.page.socket, "--view_size", plan_.page.size);
        add("--pictures_per_s", std::to_string(plan_.page.pictures_per_s));
        if (!plan_.page.people.empty()) add("--people", joined(plan_.page.people, ","));
      }
      set_threads(1);
      set("LP_NUM_THREADS", "0");  // llvmpipe draws on the calling thread: one core per simulator
      suggest("GALLIUM_DRIVER", "llvmpipe");
      if (config.collection.set_workers_cpu_affinity) {
        const std::vector<int> cpus = allowed_cpus();
        options.cpu = cpus[static_cast<std::size_t>(worker.index) % cpus.size()];
      }
      break;
    case Role::kPolicy:
      if (plan_.greedy) add("--greedy");
      if (plan_.policy == PolicySource::kSeats)
        add("--seats");
      else if (!plan_.has_learner() && !plan_.feeds())
        add("--random");  // an oracle's simulators do not look at the answers
      if (plan_.evaluates()) add("--evaluate");
      set_threads(config.collection.policy_threads);
      break;
    case Role::kLearner:
      add("--mode", plan_.trains() ? "train" : "serve");
      if (plan_.policy == PolicySource::kCheckpoint) add("--checkpoint", plan_.checkpoint);
      if (plan_.policy == PolicySource::kSeats) add("--seats");
      set_threads(std::max<int64_t>(1, config.collection.learner_threads));
      options.inherited_descriptor = plan_.lock_descriptor;
      break;
    case Role::kTrajectoryReceiver:
      add("--parameter_bytes", std::to_string(plan_.network.parameter_bytes));
      break;
    case Role::kFrameReceiver:
      break;
    case Role::kTrajectorySender:
      add("--patience_s", real_text(plan_.patience_s));
      if (plan_.sends_frames) add("--frames");
      break;
  }
  return options;
}

Status WorkerTable::start(Worker& worker, const shm::Arena& arena, const std::string& server) {
  worker.has_joined = false;
  worker.restart_at_s = 0;
  worker.is_unreclaimed = false;
  worker.started_s = clock_.now_s();
  worker.last_line.clear();
  worker.decisions_at_start = counters_of(worker, arena).decisions.load();
  worker.epoch_at_start = counters_of(worker, arena).epoch.load();
  COMRAD_TRY_ASSIGN(worker.process, processes_.spawn(options_of(worker, server)));
  spdlog::info("started {} (pid {})", worker.name, worker.process->pid());
  return {};
}

void WorkerTable::restart_all(double restart_at_s) {
  for (Worker& worker : workers_) {
    forget_process(worker);  // kills and reaps
    worker.has_joined = false;
    worker.restart_at_s = restart_at_s;
  }
}

void WorkerTable::forget_process(Worker& worker) {
  if (worker.process) cpu_s_of_ended_[static_cast<std::size_t>(worker.role)] += worker.process->cpu_seconds();
  worker.process.reset();
}

double WorkerTable::cpu_seconds(Role role) const {
  double seconds = cpu_s_of_ended_[static_cast<std::size_t>(role)];
  for (const Worker& worker : workers_)
    if (worker.role == role && worker.process) seconds += worker.process->cpu_seconds();
  return seconds;
}

void WorkerTable::signal_all(int number) {
  for (Worker& worker : workers_)
    if (worker.process) worker.process->send_signal(number);
}

void WorkerTable::note_joined(const shm::JoinRequest& request) {
  const std::string role(request.role, strnlen(request.role, sizeof request.role));
  for (Worker& worker : workers_)
    if (worker.process && role == kind_of(worker).word &&
        request.worker_index == static_cast<uint32_t>(worker.index))
      worker.has_joined = true;
  spdlog::info("{}-{} joined", role, request.worker_index);
}

bool WorkerTable::has(Role role) const {
  return std::ranges::any_of(workers_, [role](const Worker& worker) { return worker.role == role; });
}

bool WorkerTable::any_alive() const {
  return std::ranges::any_of(workers_, [](const Worker& worker) { return worker.process != nullptr; });
}

bool WorkerTable::all_joined() const {
  return std::ranges::all_of(workers_, [](const Worker& worker) { return worker.has_joined; });
}

std::string WorkerTable::joined_text() const {
  std::vector<std::string> parts;
  for (std::size_t place = 0; place < kRoleCount; ++place) {
    const Role role = static_cast<Role>(place);
    const auto is_of_role = [role](const Worker& worker) { return worker.role == role; };
    const auto expected = std::ranges::count_if(workers_, is_of_role);
    const auto here = std::ranges::count_if(
        workers_, [&](const Worker& worker) { return is_of_role(worker) && worker.has_joined; });
    if (expected > 0) parts.push_back(fmt::format("{}/{} {}", here, expected, name_of(role)));
  }
  return joined(parts);
}

void WorkerTable::append_outputs(std::vector<pollfd>& sources) const {
  for (const Worker& worker : workers_)
    if (worker.process && worker.process->output_descriptor() >= 0)
      sources.push_back({.fd = worker.process->output_descriptor(), .events = POLLIN, .revents = 0});
}

void WorkerTable::read_output(ProgressPrinter& printer) {
  const double now_s = clock_.now_s();
  for (Worker& worker : workers_) {
    if (!worker.process) continue;
    for (const std::string& line : worker.process->read_lines()) {
      const std::optional<UserMessage> message = parse_user_message(line);
      const std::string words = message ? message->words() : line;
      worker.last_line = words;
      spdlog::info("{}: {}", worker.name, words);
      if (message) {
        // A restarted worker prints it again, with other numbers.
        std::string kind = words;
        std::erase_if(kind, [](char letter) { return letter == '.' || (letter >= '0' && letter <= '9'); });
        if (words_shown_.insert(kind).second) printer.note(words);
        continue;
      }
      if (now_s - worker.minute_began_s > 60) {
        worker.minute_began_s = now_s;
        worker.lines_shown = 0;
      }
      if (++worker.lines_shown <= kLinesShownPerMinute) printer.note(worker.name + ": " + line);
      if (worker.lines_shown == kLinesShownPerMinute)
        printer.note(worker.name + ": (more in logs/supervisor.log)");
    }
  }
}

std::vector<std::pair<Worker*, ExitStatus>> WorkerTable::reap_exited(bool is_stopping) {
  std::vector<std::pair<Worker*, ExitStatus>> exited;
  for (Worker& worker : workers_) {
    if (!worker.process) continue;
    if (!is_stopping && !worker.has_joined && clock_.now_s() - worker.started_s > plan_.join_timeout_s) {
      worker.last_line =
          fmt::format("did not join the run within {} s", static_cast<int>(plan_.join_timeout_s));
      worker.process->send_signal(SIGKILL);
    }
    if (const std::optional<ExitStatus>& how = worker.process->poll_exit()) {
      for (const std::string& line : worker.process->read_lines()) {
        const std::optional<UserMessage> message = parse_user_message(line);
        worker.last_line = message ? message->words() : line;
      }
      exited.emplace_back(&worker, *how);
      forget_process(worker);
      worker.has_joined = false;
      spdlog::info("{} left: {}", worker.name, exited.back().second.text());
    }
  }
  // Simulators last: taking one's slots back waits for the answers of policy workers, dead ones give none.
  std::ranges::stable_sort(exited,
                           [](const auto& a, const auto& b) { return a.first->role > b.first->role; });
  return exited;
}

void WorkerTable::listen(const shm::Arena& arena, bool at_work) {
  const double now_s = clock_.now_s();
  for (Worker& worker : workers_) {
    const uint64_t decisions = counters_of(worker, arena).decisions.load(std::memory_order_relaxed);
    if (!at_work || !worker.process || std::exchange(worker.decisions_heard, decisions) != decisions)
      worker.heard_s = now_s;
  }
}

std::string WorkerTable::silence_text() const {
  const double now_s = clock_.now_s();
  const auto silent_s = [now_s](const Worker& worker) { return now_s - worker.heard_s; };
  std::vector<std::string> parts;
  for (const Worker& worker : workers_) {
    if (!worker.process || silent_s(worker) < kSilentAfterS) continue;
    const bool is_stopped = worker.process->is_stopped();
    const bool others_work = std::ranges::any_of(workers_, [&](const Worker& other) {
      return other.role == worker.role && silent_s(other) < kSilentAfterS;
    });
    if (!is_stopped && !others_work) continue;
    parts.push_back(worker.name + " silent for " + duration_text(silent_s(worker)) +
                    (is_stopped ? " (SIGSTOP)" : ""));
  }
  return joined(parts);
}

bool WorkerTable::stands_still() const {
  return plan_.own_workers() > 0 &&
         std::ranges::none_of(workers_, [now_s = clock_.now_s()](const Worker& worker) {
           return worker.role == Role::kSim && now_s - worker.heard_s < kSilentAfterS;
         });
}

std::string WorkerTable::last_words(const Worker& worker) const {
  return worker.last_line.empty() ? last_log_line(log_path(worker)) : worker.last_line;
}

std::string WorkerTable::log_path(const Worker& worker) const {
  return fmt::format("{}/logs/{}-{}.log", plan_.run_dir, kind_of(worker).word, worker.index);
}

shm::WorkerCounters& counters_of(const Worker& worker, const shm::Arena& arena) {
  // Receivers use the learner's arena as simulators do, the trajectory sender uses its host's as a learner.
  return worker.role == Role::kSim                  ? arena.sim_counters(worker.index)
         : worker.role == Role::kPolicy             ? arena.policy_counters(worker.index)
         : worker.role == Role::kTrajectoryReceiver ? arena.sim_counters(arena.shape().served_worker_count())
         : worker.role == Role::kFrameReceiver      ? arena.sim_counters(arena.shape().own_worker_count())
                                                    : arena.learner_counters();
}

bool has_worked(const Worker& worker, const shm::Arena& arena) {
  const shm::WorkerCounters& counters = counters_of(worker, arena);
  const uint64_t decisions = counters.decisions.load();
  if (worker.role != Role::kLearner) return decisions != worker.decisions_at_start;
  // A learner first sets its counter back to its checkpoint's, and may then come to the very count at which it died.
  return counters.epoch.load() != worker.epoch_at_start &&
         counters.state.load() != shm::WorkerState::kStarting &&
         decisions > arena.control().learner_decisions_before.load();
}

std::optional<uint64_t> reclaim_worker(const Worker& worker, const shm::Arena& arena) {
  switch (worker.role) {
    case Role::kSim:
      if (!arena.step_slots().withdraw(worker.index)) return std::nullopt;
      return arena.reclaim_sim_worker(worker.index);
    case Role::kPolicy:
      arena.reclaim_policy_worker(worker.index);
      return 0;  // its questions are asked again
    case Role::kTrajectoryReceiver:
    case Role::kFrameReceiver: {
      // What it had in the making is sent again, or counted as lost by the host that played it.
      const shm::ArenaShape& shape = arena.shape();
      const bool is_of_frames = worker.role == Role::kFrameReceiver;
      const int first = is_of_frames ? shape.own_worker_count() : shape.served_worker_count();
      const int end = is_of_frames ? shape.served_worker_count() : shape.sim_worker_count;
      for (int sim = first; sim < end; ++sim) arena.reclaim_sim_worker(sim);
      return 0;
    }
    case Role::kTrajectorySender:
      return 0;  // its successor adopts what it had drained
    case Role::kLearner:
      arena.reclaim_learner();
      return 0;  // the meter counts what it had not trained on
  }
  return 0;
}

}  // namespace comrad::deploy
