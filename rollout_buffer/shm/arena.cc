#include "rollout_buffer/shm/arena.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <type_traits>
#include <utility>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/journal.h"
#include "rollout_buffer/shm/layout_mailbox.h"
#include "rollout_buffer/shm/learner_report.h"
#include "rollout_buffer/shm/region.h"
#include "rollout_buffer/shm/remote_worker_slot.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/step_slots.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::shm {
namespace {

/// First bytes of the segment. A peer copies it once, checks it, and never looks again.
struct ArenaHeader {
  uint32_t magic;
  uint32_t arena_version;
  uint64_t run_id;
  int64_t size_bytes;
  ArenaShape shape;
};
static_assert(std::is_trivially_copyable_v<ArenaHeader>);

}  // namespace

/// Their places follow from the shape alone, in the order of the members.
struct Arena::Rooms {
  Rooms(const ArenaShape& given, uint64_t id, std::byte* base)
      : shape(given), run_id(id), region{.base = base} {}

  const ArenaShape shape;
  const uint64_t run_id;
  Region region;
  ArenaHeader* const header = region.take<ArenaHeader>(1);
  ControlBlock* const control = region.take<ControlBlock>(1);
  WorkerCounters* const sim_counters = region.take<WorkerCounters>(shape.sim_worker_count);
  WorkerCounters* const policy_counters = region.take<WorkerCounters>(shape.policy_worker_count);
  WorkerCounters* const learner_counters = region.take<WorkerCounters>(1);
  const StepSlots step_slots{shape, region};
  const EpisodeStream episodes{shape, region};
  const LearnerReports learner_reports{region};
  const WeightBuffers weights{shape, region, control};
  const Journals journals{shape, region};
  const LayoutMailboxes layout_mailboxes{shape, region};
  const Accounts accounts{shape, region};
  const RemoteWorkerSlots remote_worker_slots{shape, region};
  const SlabPool slabs{shape, region, control, accounts};
  const int64_t size_bytes = round_up(region.end_bytes, kPageBytes);
};

int64_t Arena::size_bytes(const ArenaShape& shape) { return Rooms(shape, 0, nullptr).size_bytes; }

Expected<Arena> Arena::create(const ArenaShape& shape, uint64_t run_id) {
  COMRAD_TRY(validate(shape));
  COMRAD_TRY_ASSIGN(Segment segment, Segment::create("comrad-arena", size_bytes(shape)));
  auto rooms = std::make_unique<Rooms>(shape, run_id, segment.data());
  // Zeroed memory already means: slots idle, slabs free, doorbells silent, no weights, run state kStarting.
  rooms->control->episodes_per_run.store(UINT64_MAX);
  *rooms->header = {.magic = kArenaMagic,
                    .arena_version = kArenaVersion,
                    .run_id = run_id,
                    .size_bytes = rooms->size_bytes,
                    .shape = shape};
  return Arena(std::move(segment), std::move(rooms));
}

Expected<Arena> Arena::adopt(int descriptor) {
  COMRAD_TRY_ASSIGN(Segment segment, Segment::adopt(descriptor));
  ArenaHeader header{};
  if (segment.size_bytes() < static_cast<int64_t>(sizeof header))
    return Error{ErrorCode::kBadFormat, fmt::format("arena: {} bytes hold no header", segment.size_bytes())};
  std::memcpy(&header, segment.data(), sizeof header);  // from here on the peer cannot change what we checked
  if (header.magic != kArenaMagic)
    return Error{ErrorCode::kBadFormat, "arena: wrong magic number; the peer is no COMRAD run"};
  if (header.arena_version != kArenaVersion)
    return Error{
        ErrorCode::kBadFormat,
        fmt::format("arena: version {}, this build speaks {}; start all programs of a run from one build",
                    header.arena_version, kArenaVersion)};
  if (Status valid = validate(header.shape); !valid)
    return Error{ErrorCode::kBadFormat, "arena: the header is damaged: " + valid.error().message};
  auto rooms = std::make_unique<Rooms>(header.shape, header.run_id, segment.data());
  if (rooms->size_bytes != header.size_bytes || rooms->size_bytes != segment.size_bytes())
    return Error{ErrorCode::kBadFormat,
                 fmt::format("arena: the header's shapes need {} bytes, the segment holds {}",
                             rooms->size_bytes, segment.size_bytes())};
  return Arena(std::move(segment), std::move(rooms));
}

Arena::Arena(Segment segment, std::unique_ptr<Rooms> rooms)
    : segment_(std::move(segment)), rooms_(std::move(rooms)) {}
Arena::Arena(Arena&&) noexcept = default;
Arena& Arena::operator=(Arena&&) noexcept = default;
Arena::~Arena() = default;

const ArenaShape& Arena::shape() const { return rooms_->shape; }
uint64_t Arena::run_id() const { return rooms_->run_id; }
ControlBlock& Arena::control() const { return *rooms_->control; }

WorkerCounters& Arena::sim_counters(int sim_worker) const {
  return element(rooms_->sim_counters, sim_worker, shape().sim_worker_count, "simulator index is in range");
}

WorkerCounters& Arena::policy_counters(int policy_worker) const {
  return element(rooms_->policy_counters, policy_worker, shape().policy_worker_count,
                 "policy worker index is in range");
}

WorkerCounters& Arena::learner_counters() const { return *rooms_->learner_counters; }

const StepSlots& Arena::step_slots() const { return rooms_->step_slots; }
const EpisodeStream& Arena::episodes() const { return rooms_->episodes; }
const LearnerReports& Arena::learner_reports() const { return rooms_->learner_reports; }
const WeightBuffers& Arena::weights() const { return rooms_->weights; }
const Journals& Arena::journals() const { return rooms_->journals; }
const LayoutMailboxes& Arena::layout_mailboxes() const { return rooms_->layout_mailboxes; }
const Accounts& Arena::accounts() const { return rooms_->accounts; }
const RemoteWorkerSlots& Arena::remote_worker_slots() const { return rooms_->remote_worker_slots; }
const SlabPool& Arena::slabs() const { return rooms_->slabs; }

uint64_t Arena::reclaim_sim_worker(int sim_worker) const {
  COMRAD_CHECK(sim_worker >= 0 && sim_worker < shape().sim_worker_count, "simulator index is in range");
  // A policy worker answers into the slab that its batch names. Taking the slab away under its pen would let
  // the late answer land in another environment's rows, so the answer is awaited first.
  const int64_t deadline_ns = monotonic_ns() + 2'000'000'000;
  while (!step_slots().withdraw(sim_worker) && monotonic_ns() < deadline_ns) usleep(200);
  step_slots().idle(sim_worker);
  slabs().reclaim_filling(sim_worker, [&](int env_index, uint64_t rollout_index) {
    uint64_t& next = shape().is_remote(sim_worker)
                         ? remote_worker_slots().environment(env_index).rollout_index
                         : journals().header(env_index).rollout_index;
    next = std::min(next, rollout_index);
  });
  return accounts().write_off(sim_worker);
}

int Arena::reclaim_policy_worker(int policy_worker) const { return step_slots().requeue(policy_worker); }

int Arena::reclaim_learner() const { return slabs().reclaim_learning(); }

}  // namespace comrad::shm
