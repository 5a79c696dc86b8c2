#include "rollout_buffer/shm/episode_stream.h"

#include <algorithm>

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {

EpisodeStream::EpisodeStream(const ArenaShape& shape, Region& region)
    : shape_(shape),
      capacity_(std::max<int64_t>(
          64, (shape.episode_ring_capacity + shape.sim_worker_count - 1) / shape.sim_worker_count)),
      rings_(region.take<EpisodeRing>(int64_t{shape.sim_worker_count} + 1)),
      cells_(region.take<EpisodeRecord>((int64_t{shape.sim_worker_count} + 1) * capacity_)) {}

bool EpisodeStream::push_to(int64_t ring_index, const EpisodeRecord& record) const {
  EpisodeRing& ring = rings_[ring_index];
  const uint64_t written = ring.written.load(std::memory_order_relaxed);
  if (written - ring.read.load(std::memory_order_acquire) >= static_cast<uint64_t>(capacity_)) {
    ring.dropped.fetch_add(1, std::memory_order_relaxed);
    return false;
  }
  cells_[ring_index * capacity_ + static_cast<int64_t>(written % static_cast<uint64_t>(capacity_))] = record;
  ring.written.store(written + 1, std::memory_order_release);
  return true;
}

std::optional<EpisodeRecord> EpisodeStream::pop_from(int64_t ring_index) const {
  EpisodeRing& ring = rings_[ring_index];
  const uint64_t read = ring.read.load(std::memory_order_relaxed);
  if (read == ring.written.load(std::memory_order_acquire)) return std::nullopt;
  const EpisodeRecord record =
      cells_[ring_index * capacity_ + static_cast<int64_t>(read % static_cast<uint64_t>(capacity_))];
  ring.read.store(read + 1, std::memory_order_release);
  return record;
}

bool EpisodeStream::push(const EpisodeRecord& record) const {
  const auto sim_worker = static_cast<int>(record.env_index) / shape_.envs_per_worker;
  COMRAD_CHECK(sim_worker >= 0 && sim_worker < shape_.sim_worker_count,
               "an episode record's environment is in range");
  return push_to(sim_worker, record);
}

std::optional<EpisodeRecord> EpisodeStream::pop() const {
  for (int sim_worker = 0; sim_worker < shape_.sim_worker_count; ++sim_worker)
    if (auto record = pop_from(sim_worker)) return record;
  return std::nullopt;
}

uint64_t EpisodeStream::dropped() const {
  uint64_t dropped = 0;
  for (int sim_worker = 0; sim_worker < shape_.sim_worker_count; ++sim_worker)
    dropped += rings_[sim_worker].dropped.load(std::memory_order_relaxed);
  return dropped;
}

bool EpisodeStream::forward(const EpisodeRecord& record) const {
  return push_to(shape_.sim_worker_count, record);
}

std::optional<EpisodeRecord> EpisodeStream::pop_forwarded() const {
  return pop_from(shape_.sim_worker_count);
}

}  // namespace comrad::shm
