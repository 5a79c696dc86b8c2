#include "rollout_buffer/shm/arena.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <new>
#include <type_traits>
#include <utility>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/clock.h"

namespace comrad::shm {
namespace {

constexpr int64_t kPageBytes = 4096;
constexpr int kWeightsBuffers = 2;
constexpr int kReadAttempts = 200;
constexpr uint64_t kNoRollout = UINT64_MAX;   // of a slab that was acquired a moment ago
constexpr uint64_t kNoPosition = UINT64_MAX;  // of a slab that nobody has begun to seal

int64_t round_up(int64_t value, int64_t multiple) { return (value + multiple - 1) / multiple * multiple; }

/// First bytes of the segment. A peer copies it once, checks it, and never looks again.
struct ArenaHeader {
  uint32_t magic;
  uint32_t arena_version;
  uint64_t run_id;
  int64_t size_bytes;
  ArenaShape shape;
};
static_assert(std::is_trivially_copyable_v<ArenaHeader>);

/// Sequence lock over two buffers: the learner fills the one that is not current, then makes it current.
struct WeightsHeader {
  struct alignas(kCacheLineBytes) Buffer {
    std::atomic<uint64_t> sequence;  ///< odd while the learner writes into the buffer
    std::atomic<uint64_t> bytes;
    std::atomic<uint64_t> checksum;
    std::atomic<uint32_t> version;
  };
  Buffer buffer[kWeightsBuffers];
  alignas(kCacheLineBytes) std::atomic<uint32_t> current;  ///< 0: nothing yet; else buffer index + 1
};

/// Finished episodes, of one simulator for the supervisor or of all for the learner; `written` and `read`
/// count up for ever, cells are taken modulo the capacity.
struct EpisodeRing {
  alignas(kCacheLineBytes) std::atomic<uint64_t> written;  ///< simulator; of the last ring the supervisor
  std::atomic<uint64_t> dropped;                           ///< the same
  alignas(kCacheLineBytes) std::atomic<uint64_t> read;     ///< supervisor; of the last ring the learner
};

struct ReportBlock {
  alignas(kCacheLineBytes) std::atomic<uint64_t> sequence;  ///< odd: being written; 0: none yet
  LearnerReport report;
};

Status check_range(const char* name, int64_t value, int64_t low, int64_t high) {
  if (value >= low && value <= high) return {};
  return Error{ErrorCode::kBadInput, std::string("arena: ") + name + " is " + std::to_string(value) +
                                         "; it must lie in " + std::to_string(low) + ".." +
                                         std::to_string(high)};
}

/// Every product of these bounds fits 63 bits, so sizes are computed without overflow checks afterwards.
Status validate(const ArenaShape& shape) {
  COMRAD_TRY(comrad::validate(shape.trajectory));
  COMRAD_TRY(check_range("sim_worker_count", shape.sim_worker_count, 1, 1024));
  COMRAD_TRY(check_range("envs_per_worker", shape.envs_per_worker, 1, 1024));
  COMRAD_TRY(
      check_range("splits_per_worker", shape.splits_per_worker, 1, std::min(2, shape.envs_per_worker)));
  COMRAD_TRY(check_range("policy_worker_count", shape.policy_worker_count, 1, 256));
  COMRAD_TRY(check_range("slab_count", shape.slab_count, 1, 1 << 20));
  COMRAD_TRY(check_range("journal_steps", shape.journal_steps, 0, 1 << 20));
  COMRAD_TRY(check_range("episode_ring_capacity", shape.episode_ring_capacity, 1, 1 << 20));
  COMRAD_TRY(check_range("guest_worker_count", shape.guest_worker_count, 0, shape.sim_worker_count));
  COMRAD_TRY(check_range("frame_guest_count", shape.frame_guest_count, 0, shape.guest_worker_count));
  COMRAD_TRY(check_range("weights_bytes", shape.weights_bytes, 0, int64_t{1} << 36));
  return {};
}

}  // namespace

/// Byte offsets of every part from the segment's base: a pure function of the shape.
struct Arena::Offsets {
  explicit Offsets(const ArenaShape& given) : shape(given), slab(given.trajectory) {
    const int64_t envs = shape.env_count(), agents = shape.trajectory.env.num_agents;
    const int64_t splits = int64_t{shape.sim_worker_count} * shape.splits_per_worker;
    int64_t end = 0;
    const auto place = [&end](int64_t bytes, int64_t alignment = kCacheLineBytes) {
      const int64_t start = round_up(end, alignment);
      end = start + bytes;
      return start;
    };
    const auto place_array = [&place](auto* type, int64_t count) {
      using T = std::remove_pointer_t<decltype(type)>;
      return place(count * static_cast<int64_t>(sizeof(T)), std::max<int64_t>(kCacheLineBytes, alignof(T)));
    };
    header = place_array(static_cast<ArenaHeader*>(nullptr), 1);
    control = place_array(static_cast<ControlBlock*>(nullptr), 1);
    counters = place_array(static_cast<WorkerCounters*>(nullptr),
                           int64_t{shape.sim_worker_count} + shape.policy_worker_count + 1);
    slots = place_array(static_cast<StepSlot*>(nullptr), envs);
    slots_ready = place_array(static_cast<Doorbell*>(nullptr), shape.policy_worker_count);
    slots_acted = place_array(static_cast<Doorbell*>(nullptr), splits);
    rounds = place_array(static_cast<SplitRound*>(nullptr), splits);
    recurrent_bytes =
        round_up(agents * shape.trajectory.recurrent_state_count * int64_t{sizeof(float)}, kCacheLineBytes);
    recurrent = place(envs * 2 * recurrent_bytes);
    episode_capacity = std::max<int64_t>(
        64, (shape.episode_ring_capacity + shape.sim_worker_count - 1) / shape.sim_worker_count);
    episode_rings = place_array(static_cast<EpisodeRing*>(nullptr), int64_t{shape.sim_worker_count} + 1);
    episodes = place_array(static_cast<EpisodeRecord*>(nullptr),
                           (int64_t{shape.sim_worker_count} + 1) * episode_capacity);
    report = place_array(static_cast<ReportBlock*>(nullptr), 1);
    weights_header = place_array(static_cast<WeightsHeader*>(nullptr), 1);
    weights_stride = round_up(shape.weights_bytes, kPageBytes);
    weights = place(kWeightsBuffers * weights_stride, kPageBytes);
    journal_headers = place_array(static_cast<JournalHeader*>(nullptr), envs);
    journal_row = agents * shape.trajectory.env.head_count;
    journal_actions = place(envs * shape.journal_steps * journal_row);
    layout_desks = place_array(static_cast<LayoutDesk*>(nullptr), envs);
    accounts = place_array(static_cast<EnvAccount*>(nullptr), envs);
    slab_headers = place_array(static_cast<SlabHeader*>(nullptr), shape.slab_count);
    slabs = place(shape.slab_count * slab.slab_bytes, kPageBytes);
    size_bytes = round_up(end, kPageBytes);
  }

  ArenaShape shape;
  SlabOffsets slab;
  uint64_t run_id = 0;
  int64_t header, control, counters, slots, slots_ready, slots_acted, rounds, recurrent, recurrent_bytes;
  int64_t episode_rings, episodes, episode_capacity, report, weights_header, weights, weights_stride;
  int64_t journal_headers, journal_actions, journal_row, layout_desks, accounts, slab_headers, slabs,
      size_bytes;
};

namespace {

template <typename T>
T& part(const Segment& segment, int64_t offset_bytes, int64_t index = 0) {
  return *reinterpret_cast<T*>(segment.data() + offset_bytes + index * static_cast<int64_t>(sizeof(T)));
}

void check_index(int64_t index, int64_t count, const char* what) {
  COMRAD_CHECK(index >= 0 && index < count, what);
}

}  // namespace

void WorkerCounters::begin_life() {
  pid.store(static_cast<uint32_t>(getpid()));
  epoch.fetch_add(1);
  state.store(WorkerState::kStarting);
}

uint64_t pack_outcome(const LayoutOutcome& outcome) {
  return uint64_t{outcome.layout_index} << 32 | std::bit_cast<uint32_t>(outcome.score);
}

LayoutOutcome unpack_outcome(uint64_t word) {
  return {.layout_index = static_cast<uint32_t>(word >> 32),
          .score = std::bit_cast<float>(static_cast<uint32_t>(word))};
}

int64_t Arena::size_bytes(const ArenaShape& shape) { return Offsets(shape).size_bytes; }

Expected<Arena> Arena::create(const ArenaShape& shape, uint64_t run_id) {
  COMRAD_TRY(validate(shape));
  auto offsets = std::make_unique<Offsets>(shape);
  offsets->run_id = run_id;
  COMRAD_TRY_ASSIGN(Segment segment, Segment::create("comrad-arena", offsets->size_bytes));
  // Zeroed memory already means: slots idle, slabs free, doorbells silent, no weights, run state kStarting.
  part<ControlBlock>(segment, offsets->control).episodes_per_run.store(UINT64_MAX);
  ArenaHeader header{};
  header.magic = kArenaMagic;
  header.arena_version = kArenaVersion;
  header.run_id = run_id;
  header.size_bytes = offsets->size_bytes;
  header.shape = shape;
  std::memcpy(segment.data() + offsets->header, &header, sizeof header);
  return Arena(std::move(segment), std::move(offsets));
}

Expected<Arena> Arena::adopt(int descriptor) {
  COMRAD_TRY_ASSIGN(Segment segment, Segment::adopt(descriptor));
  ArenaHeader header{};
  if (segment.size_bytes() < static_cast<int64_t>(sizeof header))
    return Error{ErrorCode::kBadFormat,
                 "arena: " + std::to_string(segment.size_bytes()) + " bytes hold no header"};
  std::memcpy(&header, segment.data(), sizeof header);  // from here on the peer cannot change what we checked
  if (header.magic != kArenaMagic)
    return Error{ErrorCode::kBadFormat, "arena: wrong magic number; the peer is no COMRAD run"};
  if (header.arena_version != kArenaVersion)
    return Error{ErrorCode::kBadFormat, "arena: version " + std::to_string(header.arena_version) +
                                            ", this build speaks " + std::to_string(kArenaVersion) +
                                            "; start all programs of a run from one build"};
  if (Status valid = validate(header.shape); !valid)
    return Error{ErrorCode::kBadFormat, "arena: the header is damaged: " + valid.error().message};
  auto offsets = std::make_unique<Offsets>(header.shape);
  offsets->run_id = header.run_id;
  if (offsets->size_bytes != header.size_bytes || offsets->size_bytes != segment.size_bytes())
    return Error{ErrorCode::kBadFormat,
                 "arena: the header's shapes need " + std::to_string(offsets->size_bytes) +
                     " bytes, the segment holds " + std::to_string(segment.size_bytes())};
  return Arena(std::move(segment), std::move(offsets));
}

Arena::Arena(Segment segment, std::unique_ptr<Offsets> offsets)
    : segment_(std::move(segment)), offsets_(std::move(offsets)) {}
Arena::Arena(Arena&&) noexcept = default;
Arena& Arena::operator=(Arena&&) noexcept = default;
Arena::~Arena() = default;

const ArenaShape& Arena::shape() const { return offsets_->shape; }
uint64_t Arena::run_id() const { return offsets_->run_id; }
int Arena::descriptor() const { return segment_.descriptor(); }
ControlBlock& Arena::control() const { return part<ControlBlock>(segment_, offsets_->control); }

WorkerCounters& Arena::sim_counters(int sim_worker) const {
  check_index(sim_worker, shape().sim_worker_count, "simulator index is in range");
  return part<WorkerCounters>(segment_, offsets_->counters, sim_worker);
}

WorkerCounters& Arena::policy_counters(int policy_worker) const {
  check_index(policy_worker, shape().policy_worker_count, "policy worker index is in range");
  return part<WorkerCounters>(segment_, offsets_->counters, shape().sim_worker_count + policy_worker);
}

WorkerCounters& Arena::learner_counters() const {
  return part<WorkerCounters>(segment_, offsets_->counters,
                              shape().sim_worker_count + shape().policy_worker_count);
}

StepSlot& Arena::slot(int env_index) const {
  check_index(env_index, shape().env_count(), "environment index is in range");
  return part<StepSlot>(segment_, offsets_->slots, env_index);
}

std::span<float> Arena::recurrent(int env_index, uint64_t parity) const {
  check_index(env_index, shape().env_count(), "environment index is in range");
  const int64_t buffer = int64_t{env_index} * 2 + static_cast<int64_t>(parity & 1);
  const std::size_t count = static_cast<std::size_t>(shape().trajectory.env.num_agents) *
                            static_cast<std::size_t>(shape().trajectory.recurrent_state_count);
  return {
      reinterpret_cast<float*>(segment_.data() + offsets_->recurrent + buffer * offsets_->recurrent_bytes),
      count};
}

Doorbell& Arena::slots_ready(int policy_worker) const {
  check_index(policy_worker, shape().policy_worker_count, "policy worker index is in range");
  return part<Doorbell>(segment_, offsets_->slots_ready, policy_worker);
}

Doorbell& Arena::slots_acted(int sim_worker, int split) const {
  check_index(sim_worker, shape().sim_worker_count, "simulator index is in range");
  check_index(split, shape().splits_per_worker, "split is in range");
  return part<Doorbell>(segment_, offsets_->slots_acted,
                        int64_t{sim_worker} * shape().splits_per_worker + split);
}

SplitRound& Arena::split_round(int sim_worker, int split) const {
  check_index(sim_worker, shape().sim_worker_count, "simulator index is in range");
  check_index(split, shape().splits_per_worker, "split is in range");
  return part<SplitRound>(segment_, offsets_->rounds,
                          int64_t{sim_worker} * shape().splits_per_worker + split);
}

const SlabOffsets& Arena::slab_offsets() const { return offsets_->slab; }

SlabView Arena::slab(int slab_index) const {
  check_index(slab_index, shape().slab_count, "slab index is in range");
  return SlabView(offsets_->slab,
                  segment_.data() + offsets_->slabs + int64_t{slab_index} * offsets_->slab.slab_bytes);
}

SlabHeader& Arena::slab_header(int slab_index) const {
  check_index(slab_index, shape().slab_count, "slab index is in range");
  return part<SlabHeader>(segment_, offsets_->slab_headers, slab_index);
}

std::optional<uint32_t> Arena::acquire_slab(int sim_worker) const {
  check_index(sim_worker, shape().sim_worker_count, "simulator index is in range");
  const uint32_t owner = static_cast<uint32_t>(sim_worker) + 1;
  // Every simulator starts its search elsewhere, so that they seldom fight over one cache line.
  const int32_t count = shape().slab_count;
  const int32_t first = static_cast<int32_t>(int64_t{sim_worker} * count / shape().sim_worker_count);
  for (int32_t offset = 0; offset < count; ++offset) {
    const int32_t index = (first + offset) % count;
    SlabHeader& header = slab_header(index);
    uint32_t nobody = 0;
    if (header.state.load(std::memory_order_acquire) != SlabState::kFree ||
        !header.owner.compare_exchange_strong(nobody, owner, std::memory_order_acq_rel))
      continue;
    // The slab may have been filled and sealed between the two looks; the owner word now keeps it still.
    if (header.state.load(std::memory_order_acquire) != SlabState::kFree) {
      header.owner.store(0, std::memory_order_release);
      continue;
    }
    header.length = 0;
    header.env_index =
        static_cast<uint32_t>(sim_worker * shape().envs_per_worker);  // tells whose it is from now on
    header.rollout_index = kNoRollout;
    header.position = kNoPosition;
    header.state.store(SlabState::kFilling, std::memory_order_release);
    return static_cast<uint32_t>(index);
  }
  return std::nullopt;
}

void Arena::seal_slab(uint32_t slab_index) const {
  SlabHeader& header = slab_header(static_cast<int>(slab_index));
  COMRAD_DCHECK(header.state.load() == SlabState::kFilling, "only a slab that is being filled is sealed");
  EnvAccount& account = env_account(static_cast<int>(header.env_index));
  const uint64_t sealed = account.sealed.load(std::memory_order_relaxed);
  header.position = sealed;
  std::atomic_signal_fence(std::memory_order_release);  // a kill leaves no count that cannot be taken back
  account.sealed.store(sealed + header.length, std::memory_order_release);
  header.seal_ticket = control().slabs_sealed.fetch_add(1, std::memory_order_acq_rel);
  header.owner.store(0, std::memory_order_release);
  header.state.store(SlabState::kSealed, std::memory_order_release);
  ring(control().slab_sealed);
}

void Arena::abandon_slab(uint32_t slab_index) const {
  SlabHeader& header = slab_header(static_cast<int>(slab_index));
  COMRAD_DCHECK(header.state.load() == SlabState::kFilling, "only a slab that is being filled is abandoned");
  header.owner.store(0, std::memory_order_release);
  header.state.store(SlabState::kFree, std::memory_order_release);
  ring(control().slab_released);
}

std::vector<uint32_t> Arena::drain_slabs(int max_count, const EnvShare& share) const {
  // A slab sealed while we look could be seen although an older one was passed unsealed a moment ago.
  // Whatever has a ticket from before the look had all older slabs of its environment sealed by then.
  const uint64_t ticket_limit = control().slabs_sealed.load(std::memory_order_acquire);
  std::vector<std::pair<uint64_t, uint32_t>> sealed;
  for (int index = 0; index < shape().slab_count; ++index) {
    const SlabHeader& header = slab_header(index);
    if (header.state.load(std::memory_order_acquire) == SlabState::kSealed &&
        header.seal_ticket < ticket_limit && share.has(header.env_index))
      sealed.emplace_back(header.seal_ticket, static_cast<uint32_t>(index));
  }
  std::sort(sealed.begin(), sealed.end());
  std::vector<uint32_t> drained;
  for (const auto& [ticket, index] : sealed) {
    if (static_cast<int>(drained.size()) >= max_count) break;
    SlabState expected = SlabState::kSealed;
    if (slab_header(static_cast<int>(index))
            .state.compare_exchange_strong(expected, SlabState::kLearning, std::memory_order_acq_rel)) {
      note_taken(slab_header(static_cast<int>(index)));
      drained.push_back(index);
    }
  }
  return drained;
}

std::vector<uint32_t> Arena::adopt_slabs() const {
  std::vector<std::pair<uint64_t, uint32_t>> orphans;
  for (int index = 0; index < shape().slab_count; ++index) {
    const SlabHeader& header = slab_header(index);
    if (header.state.load(std::memory_order_acquire) != SlabState::kLearning) continue;
    note_taken(header);  // it may have died between the two
    orphans.emplace_back(header.seal_ticket, static_cast<uint32_t>(index));
  }
  std::sort(orphans.begin(), orphans.end());
  std::vector<uint32_t> slabs;
  for (const auto& [ticket, index] : orphans) slabs.push_back(index);
  return slabs;
}

/// An environment's slabs are drained in their order, so the end of the newest one says how much was taken.
void Arena::note_taken(const SlabHeader& header) const {
  if (header.env_index >= static_cast<uint32_t>(shape().env_count()))
    return;  // a byte in shared memory may be anything
  std::atomic<uint64_t>& taken = env_account(static_cast<int>(header.env_index)).taken;
  const uint64_t end = header.position + header.length;
  uint64_t known = taken.load(std::memory_order_relaxed);
  while (known < end &&
         !taken.compare_exchange_weak(known, end, std::memory_order_release, std::memory_order_relaxed)) {
  }
}

SlabCounts Arena::slab_counts() const {
  SlabCounts counts;
  for (int index = 0; index < shape().slab_count; ++index) {
    switch (slab_header(index).state.load(std::memory_order_acquire)) {
      case SlabState::kFree:
        ++counts.free;
        break;
      case SlabState::kFilling:
        ++counts.filling;
        break;
      case SlabState::kSealed:
        ++counts.sealed;
        break;
      case SlabState::kLearning:
        ++counts.learning;
        break;
    }
  }
  return counts;
}

int Arena::sealed_count() const {
  int count = 0;
  for (int index = 0; index < shape().slab_count; ++index)
    count += slab_header(index).state.load(std::memory_order_acquire) == SlabState::kSealed;
  return count;
}

void Arena::release_slab(uint32_t slab_index) const {
  SlabState expected = SlabState::kLearning;
  const bool released =
      slab_header(static_cast<int>(slab_index))
          .state.compare_exchange_strong(expected, SlabState::kFree, std::memory_order_acq_rel);
  COMRAD_DCHECK(released, "only a slab in training is released");
  if (released) ring(control().slab_released);
}

/// Ring `ring_index` with its cells. One writer, one reader.
struct Arena::EpisodeQueue {
  EpisodeQueue(const Arena& arena, int ring_index)
      : ring(part<EpisodeRing>(arena.segment_, arena.offsets_->episode_rings, ring_index)),
        cells(&part<EpisodeRecord>(arena.segment_, arena.offsets_->episodes,
                                   ring_index * arena.offsets_->episode_capacity)),
        capacity(static_cast<uint64_t>(arena.offsets_->episode_capacity)) {}

  bool push(const EpisodeRecord& record) {
    const uint64_t written = ring.written.load(std::memory_order_relaxed);
    if (written - ring.read.load(std::memory_order_acquire) >= capacity) {
      ring.dropped.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    cells[written % capacity] = record;
    ring.written.store(written + 1, std::memory_order_release);
    return true;
  }

  std::optional<EpisodeRecord> pop() {
    const uint64_t read = ring.read.load(std::memory_order_relaxed);
    if (read == ring.written.load(std::memory_order_acquire)) return std::nullopt;
    const EpisodeRecord record = cells[read % capacity];
    ring.read.store(read + 1, std::memory_order_release);
    return record;
  }

  EpisodeRing& ring;
  EpisodeRecord* cells;
  uint64_t capacity;
};

bool Arena::push_episode(const EpisodeRecord& record) const {
  const int sim_worker = static_cast<int>(record.env_index) / shape().envs_per_worker;
  check_index(sim_worker, shape().sim_worker_count, "an episode record's environment is in range");
  return EpisodeQueue(*this, sim_worker).push(record);
}

std::optional<EpisodeRecord> Arena::pop_episode() const {
  for (int sim_worker = 0; sim_worker < shape().sim_worker_count; ++sim_worker)
    if (auto record = EpisodeQueue(*this, sim_worker).pop()) return record;
  return std::nullopt;
}

bool Arena::forward_episode(const EpisodeRecord& record) const {
  return EpisodeQueue(*this, shape().sim_worker_count).push(record);
}

std::optional<EpisodeRecord> Arena::pop_forwarded_episode() const {
  return EpisodeQueue(*this, shape().sim_worker_count).pop();
}

void Arena::publish_report(const LearnerReport& report) const {
  ReportBlock& block = part<ReportBlock>(segment_, offsets_->report);
  const uint64_t writing = (block.sequence.load(std::memory_order_relaxed) + 1) | 1;
  block.sequence.store(writing, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  block.report = report;
  std::atomic_thread_fence(std::memory_order_release);
  block.sequence.store(writing + 1, std::memory_order_release);
}

std::optional<LearnerReport> Arena::read_report(uint64_t& sequence) const {
  const ReportBlock& block = part<ReportBlock>(segment_, offsets_->report);
  const uint64_t before = block.sequence.load(std::memory_order_acquire);
  if (before == sequence || before % 2 != 0) return std::nullopt;
  LearnerReport report = block.report;
  std::atomic_thread_fence(std::memory_order_acquire);
  if (block.sequence.load(std::memory_order_relaxed) != before) return std::nullopt;
  report.last_checkpoint[kCheckpointPathBytes - 1] = 0;
  sequence = before;
  return report;
}

uint64_t Arena::episodes_dropped() const {
  uint64_t dropped = 0;
  for (int sim_worker = 0; sim_worker < shape().sim_worker_count; ++sim_worker)
    dropped += part<EpisodeRing>(segment_, offsets_->episode_rings, sim_worker)
                   .dropped.load(std::memory_order_relaxed);
  return dropped;
}

void Arena::publish_weights(std::span<const std::byte> bytes, PolicyVersion version) const {
  COMRAD_CHECK(static_cast<int64_t>(bytes.size()) <= shape().weights_bytes,
               "the weights fit the arena's buffers");
  WeightsHeader& header = part<WeightsHeader>(segment_, offsets_->weights_header);
  const uint32_t current = header.current.load(std::memory_order_acquire);
  const uint32_t older = current == 1 ? 1 : 0;
  WeightsHeader::Buffer& buffer = header.buffer[older];
  // A learner killed in this block leaves an odd number and the other buffer current; its successor starts
  // over here.
  const uint64_t writing = (buffer.sequence.load(std::memory_order_relaxed) + 1) | 1;
  buffer.sequence.store(writing, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  if (!bytes.empty())
    std::memcpy(segment_.data() + offsets_->weights + older * offsets_->weights_stride, bytes.data(),
                bytes.size());
  buffer.bytes.store(bytes.size(), std::memory_order_relaxed);
  buffer.checksum.store(checksum64(bytes), std::memory_order_relaxed);
  buffer.version.store(version, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_release);
  buffer.sequence.store(writing + 1, std::memory_order_release);
  header.current.store(older + 1, std::memory_order_release);
  control().policy_version.store(version, std::memory_order_release);
  ring(control().weights_published);
}

PolicyVersion Arena::weights_version() const {
  const WeightsHeader& header = part<WeightsHeader>(segment_, offsets_->weights_header);
  const uint32_t current = header.current.load(std::memory_order_acquire);
  return current == 1 || current == 2 ? header.buffer[current - 1].version.load(std::memory_order_acquire)
                                      : 0;
}

bool Arena::has_weights() const {
  const uint32_t current =
      part<WeightsHeader>(segment_, offsets_->weights_header).current.load(std::memory_order_acquire);
  return current == 1 || current == 2;
}

Expected<PolicyVersion> Arena::read_weights(std::vector<std::byte>& out) const {
  const WeightsHeader& header = part<WeightsHeader>(segment_, offsets_->weights_header);
  for (int attempt = 0; attempt < kReadAttempts; ++attempt) {
    if (attempt > 0) usleep(1000);
    const uint32_t current = header.current.load(std::memory_order_acquire);
    if (current != 1 && current != 2) return Error{ErrorCode::kNotFound, "weights: none are published yet"};
    const WeightsHeader::Buffer& buffer = header.buffer[current - 1];
    const uint64_t sequence = buffer.sequence.load(std::memory_order_acquire);
    const uint64_t bytes = buffer.bytes.load(std::memory_order_relaxed);
    if (sequence % 2 != 0 || bytes > static_cast<uint64_t>(shape().weights_bytes)) continue;
    const uint64_t checksum = buffer.checksum.load(std::memory_order_relaxed);
    const PolicyVersion version = buffer.version.load(std::memory_order_relaxed);
    out.resize(bytes);
    if (bytes != 0)
      std::memcpy(out.data(), segment_.data() + offsets_->weights + (current - 1) * offsets_->weights_stride,
                  bytes);
    std::atomic_thread_fence(std::memory_order_acquire);
    if (buffer.sequence.load(std::memory_order_relaxed) == sequence && checksum64(out) == checksum)
      return version;
  }
  return Error{ErrorCode::kBadFormat, "weights: the checksum of version " +
                                          std::to_string(weights_version()) +
                                          " kept failing; the learner must publish again"};
}

LayoutDesk& Arena::layout_desk(int env_index) const {
  check_index(env_index, shape().env_count(), "environment index is in range");
  return part<LayoutDesk>(segment_, offsets_->layout_desks, env_index);
}

JournalHeader& Arena::journal(int env_index) const {
  check_index(env_index, shape().env_count(), "environment index is in range");
  return part<JournalHeader>(segment_, offsets_->journal_headers, env_index);
}

std::span<uint8_t> Arena::journal_action(int env_index, int step) const {
  check_index(env_index, shape().env_count(), "environment index is in range");
  check_index(step, shape().journal_steps, "journal step is in range");
  const int64_t row = int64_t{env_index} * shape().journal_steps + step;
  return {&part<uint8_t>(segment_, offsets_->journal_actions, row * offsets_->journal_row),
          static_cast<std::size_t>(offsets_->journal_row)};
}

EnvAccount& Arena::env_account(int env_index) const {
  check_index(env_index, shape().env_count(), "environment index is in range");
  return part<EnvAccount>(segment_, offsets_->accounts, env_index);
}

DecisionCounts Arena::decision_counts() const {
  DecisionCounts counts;
  for (int env = 0; env < shape().env_count(); ++env) {
    const EnvAccount& account = env_account(env);
    // In this order: each of them only grows, and what comes later in it is counted earlier.
    counts.taken += account.taken.load(std::memory_order_acquire);
    counts.lost += account.lost.load(std::memory_order_acquire);
    counts.sealed += account.sealed.load(std::memory_order_acquire);
    counts.made += account.made.load(std::memory_order_acquire);
  }
  const auto agents = static_cast<uint64_t>(shape().trajectory.env.num_agents);
  for (uint64_t* count : {&counts.made, &counts.sealed, &counts.taken, &counts.lost}) *count *= agents;
  return counts;
}

bool Arena::withdraw_requests(int sim_worker) const {
  check_index(sim_worker, shape().sim_worker_count, "simulator index is in range");
  bool is_done = true;
  for (int local = 0; local < shape().envs_per_worker; ++local) {
    StepSlot& orphan = slot(sim_worker * shape().envs_per_worker + local);
    is_done &= advance(orphan, SlotState::kReady, SlotState::kIdle) ||
               advance(orphan, SlotState::kActed, SlotState::kIdle) ||
               orphan.state.load(std::memory_order_acquire) == SlotState::kIdle;
  }
  return is_done;
}

uint64_t Arena::reclaim_sim_worker(int sim_worker) const {
  check_index(sim_worker, shape().sim_worker_count, "simulator index is in range");
  // A policy worker answers into the slab that its batch names. Taking the slab away under its pen would let
  // the late answer land in another environment's rows, so the answer is awaited first.
  const int64_t deadline_ns = monotonic_ns() + 2'000'000'000;
  while (!withdraw_requests(sim_worker) && monotonic_ns() < deadline_ns) usleep(200);
  for (int local = 0; local < shape().envs_per_worker; ++local)
    slot(sim_worker * shape().envs_per_worker + local)
        .state.store(SlotState::kIdle, std::memory_order_release);
  for (int split = 0; split < shape().splits_per_worker; ++split)
    split_round(sim_worker, split).request_count.store(0, std::memory_order_release);

  const uint32_t owner = static_cast<uint32_t>(sim_worker) + 1;
  bool freed = false;
  for (int index = 0; index < shape().slab_count; ++index) {
    SlabHeader& header = slab_header(index);
    const bool is_owner = header.owner.load(std::memory_order_acquire) == owner;
    // While kFilling, env_index tells whose slab it is; the owner word alone may be a dead acquirer's last
    // touch on a slab that another simulator was sealing.
    if (header.state.load(std::memory_order_acquire) == SlabState::kFilling &&
        static_cast<int>(header.env_index) / shape().envs_per_worker == sim_worker) {
      // Killed between counting the rollout in the journal and sealing it: the successor plays it again,
      // because in lock step the learner waits for every one.
      JournalHeader& journal_header = journal(static_cast<int>(header.env_index));
      journal_header.rollout_index = std::min(journal_header.rollout_index, header.rollout_index);
      if (header.position != kNoPosition) {  // killed within seal_slab()
        std::atomic<uint64_t>& sealed = env_account(static_cast<int>(header.env_index)).sealed;
        sealed.store(std::min(sealed.load(), header.position));
      }
      header.owner.store(0, std::memory_order_release);
      header.state.store(SlabState::kFree, std::memory_order_release);
      freed = true;
    } else if (is_owner) {
      header.owner.store(0, std::memory_order_release);
      freed = true;
    }
  }
  if (freed) ring(control().slab_released);
  // Whatever was made and is not sealed now never will be. What another host made it sends again.
  uint64_t steps_lost = 0;
  const bool is_guest = sim_worker >= shape().own_worker_count();
  for (int local = 0; local < shape().envs_per_worker; ++local) {
    EnvAccount& account = env_account(sim_worker * shape().envs_per_worker + local);
    if (is_guest) {
      account.made.store(account.sealed.load() + account.lost.load());
      continue;
    }
    const uint64_t lost = account.made.load() - account.sealed.load();
    steps_lost += lost - account.lost.exchange(lost);
  }
  return steps_lost * static_cast<uint64_t>(shape().trajectory.env.num_agents);
}

int Arena::reclaim_policy_worker(int policy_worker) const {
  check_index(policy_worker, shape().policy_worker_count, "policy worker index is in range");
  int returned = 0;
  for (int sim_worker = 0; sim_worker < shape().sim_worker_count; ++sim_worker) {
    for (int split = 0; split < shape().splits_per_worker; ++split) {
      if (shape().policy_worker_of(sim_worker, split) != policy_worker) continue;
      for (int local = shape().split_begin(split); local < shape().split_end(split); ++local)
        returned += advance(slot(sim_worker * shape().envs_per_worker + local), SlotState::kInBatch,
                            SlotState::kReady);
    }
  }
  if (returned > 0) ring(slots_ready(policy_worker));
  return returned;
}

int Arena::reclaim_learner() const {
  int freed = 0;
  for (int index = 0; index < shape().slab_count; ++index) {
    SlabHeader& header = slab_header(index);
    if (header.state.load(std::memory_order_acquire) != SlabState::kLearning) continue;
    note_taken(header);  // it may have died between the two
    SlabState expected = SlabState::kLearning;
    freed += header.state.compare_exchange_strong(expected, SlabState::kFree, std::memory_order_acq_rel);
  }
  if (freed > 0) ring(control().slab_released);
  return freed;
}

}  // namespace comrad::shm
