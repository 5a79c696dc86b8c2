#include "rollout_buffer/shm/episode_stream.h"

#include <algorithm>

#include "rollout_buffer/shm/region.h"
#include "rollout_buffer/shm/sequence_lock.h"

namespace comrad::shm {
namespace {

constexpr int64_t kFewestCells = 64;
constexpr int64_t kCellsOfAnEnvironment = 8;  // short episodes end during a long update

}  // namespace

EpisodeStream::EpisodeStream(const ArenaShape& shape, Region& region)
    : shape_(shape),
      capacity_(
          std::max({kFewestCells, kCellsOfAnEnvironment * shape.envs_per_worker,
                    round_up(shape.episode_ring_capacity, shape.sim_worker_count) / shape.sim_worker_count})),
      heads_(region.take<EpisodeHead>(shape.sim_worker_count)),
      cursors_(region.take<EpisodeCursor>(int64_t{kEpisodeReaderCount} * shape.sim_worker_count)),
      cells_(region.take<EpisodeCell>(shape.sim_worker_count * capacity_)) {}

EpisodeCursor& EpisodeStream::cursor(EpisodeReader reader, int sim_worker) const {
  return cursors_[static_cast<int64_t>(reader) * shape_.sim_worker_count + sim_worker];
}

EpisodeCell& EpisodeStream::cell(int sim_worker, uint64_t number) const {
  return cells_[sim_worker * capacity_ + static_cast<int64_t>(number % static_cast<uint64_t>(capacity_))];
}

void EpisodeStream::write(const EpisodeRecord& record) const {
  COMRAD_CHECK(record.env_index < static_cast<uint32_t>(shape_.env_count()),
               "an episode record's environment is in range");
  const int sim_worker = static_cast<int>(record.env_index) / shape_.envs_per_worker;
  std::atomic<uint64_t>& written = heads_[sim_worker].written;
  const uint64_t number = written.load(std::memory_order_relaxed);
  EpisodeCell& target = cell(sim_worker, number);
  write_locked(target.sequence, 2 * number + 2, record, target.record);
  written.store(number + 1, std::memory_order_release);
}

std::optional<EpisodeRecord> EpisodeStream::read(EpisodeReader reader, int sim_worker) const {
  EpisodeCursor& cursor = this->cursor(reader, sim_worker);
  const uint64_t written = heads_[sim_worker].written.load(std::memory_order_acquire);
  uint64_t number = cursor.read.load(std::memory_order_relaxed), lost = 0;
  if (number > written) number = written;  // a byte in shared memory may be anything
  if (written - number > static_cast<uint64_t>(capacity_)) {
    lost = written - static_cast<uint64_t>(capacity_) - number;
    number += lost;
  }
  std::optional<EpisodeRecord> found;
  for (; number < written && !found; ++number) {
    const EpisodeCell& source = cell(sim_worker, number);
    found = read_locked(source.sequence, 2 * number + 2, source.record);
    if (!found) ++lost;
  }
  cursor.read.store(number, std::memory_order_relaxed);
  if (lost > 0) cursor.lost.fetch_add(lost, std::memory_order_relaxed);
  return found;
}

std::optional<EpisodeRecord> EpisodeStream::read(EpisodeReader reader) const {
  for (int sim_worker = 0; sim_worker < shape_.sim_worker_count; ++sim_worker)
    if (auto record = read(reader, sim_worker)) return record;
  return std::nullopt;
}

uint64_t EpisodeStream::lost(EpisodeReader reader) const {
  uint64_t lost = 0;
  for (int sim_worker = 0; sim_worker < shape_.sim_worker_count; ++sim_worker)
    lost += cursor(reader, sim_worker).lost.load(std::memory_order_relaxed);
  return lost;
}

}  // namespace comrad::shm
