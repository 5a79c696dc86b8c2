#include "deploy/launch/run_resources.h"

#include <spdlog/fmt/fmt.h>

#include <poll.h>
#include <sys/random.h>

#include <cinttypes>
#include <cstdio>
#include <utility>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/step_slots.h"

namespace comrad::deploy {

Status RunResources::open() {
  server_.reset();
  arena_.reset();
  // The socket's name is there for every user of the host to see, the run id only for the arena's members.
  uint64_t run_id = 0, name_id = 0;
  for (uint64_t* id : {&run_id, &name_id})
    if (getrandom(id, sizeof *id, 0) != sizeof *id) return system_error("getrandom");
  char name[32];
  std::snprintf(name, sizeof name, "comrad-%016" PRIx64, name_id);
  COMRAD_TRY_ASSIGN(const shm::ArenaShape shape, arena_shape(plan_));
  COMRAD_TRY_ASSIGN(arena_, shm::Arena::create(shape, run_id));
  shm::ControlBlock& control = arena_->control();
  control.run_state.store(shm::RunState::kStarting);
  if (plan_.episodes > 0) control.episodes_per_run.store(plan_.episodes);
  if (!plan_.trains()) control.rollouts_allowed.store(UINT64_MAX);  // no learner will
  COMRAD_TRY_ASSIGN(shm::ArenaServer server, shm::ArenaServer::listen(name, *arena_));
  server_.emplace(std::move(server));
  spdlog::info("run {} in {}: arena of {:.1f} MB, {} slabs", name, plan_.run_dir,
               static_cast<double>(shm::Arena::size_bytes(shape)) * 1e-6, shape.slab_count);
  return {};
}

std::optional<shm::JoinRequest> RunResources::next_join() {
  pollfd waiting{.fd = socket(), .events = POLLIN, .revents = 0};
  if (poll(&waiting, 1, 0) <= 0) return std::nullopt;
  const Expected<shm::JoinRequest> request = server_->serve_one();
  if (request) return *request;
  spdlog::info("{}", request.error().message);
  return std::nullopt;
}

void RunResources::set_run_state(shm::RunState state) {
  shm::ControlBlock& control = arena_->control();
  control.run_state.store(state, std::memory_order_release);
  shm::ring(control.run_state_changed);
  if (state != shm::RunState::kStopping) return;
  for (shm::Doorbell* bell : {&control.slab_sealed, &control.slab_released, &control.weights_published})
    shm::ring(*bell);
  const shm::ArenaShape& shape = arena_->shape();
  for (int policy = 0; policy < shape.policy_worker_count; ++policy)
    shm::ring(arena_->step_slots().ready(policy));
  for (int sim = 0; sim < shape.sim_worker_count; ++sim)
    for (int split = 0; split < shape.splits_per_worker; ++split)
      shm::ring(arena_->step_slots().acted(sim, split));
}

void RunResources::note(const std::string& text) {
  spdlog::info("{}", text);
  printer_.note(text);
}

void RunResources::drain_episodes(const std::function<void(const EpisodeRecord&)>& visit) {
  while (const std::optional<EpisodeRecord> record = arena_->episodes().read(shm::EpisodeReader::kSupervisor))
    visit(*record);
  if (const uint64_t lost = arena_->episodes().lost(shm::EpisodeReader::kSupervisor); lost > episodes_lost_) {
    episodes_lost_ = lost;
    note(fmt::format("{} episode records were lost: the supervisor was held up", lost));
  }
}

void RunResources::warn_once(const Status& status) {
  if (status) return;
  spdlog::info("{}", status.error().message);
  if (!std::exchange(has_warned_, true)) printer_.note("warning: " + status.error().message);
}

}  // namespace comrad::deploy
