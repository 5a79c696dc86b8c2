#include "rollout_buffer/replay/replay.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/replay/samplers/prioritized_sampler.h"
#include "rollout_buffer/replay/samplers/uniform_sampler.h"

namespace comrad::replay {
namespace {

constexpr std::size_t kPrefetchedDraws = 8;  // sequences prefetched ahead of the one that is read

/// The sampler's section of a snapshot; priorities (f64) follow.
struct SamplerHeader {
  int64_t unit = 0;
  int64_t unit_count = 0;
  int64_t first = 0;
  int64_t leaf_capacity = 0;
  int64_t priority_count = 0;
  double max_priority = 1;
};

bool is_priority(double value) { return std::isfinite(value) && value > 0; }

std::unique_ptr<Sampler> make_sampler(const ReplayOptions& options) {
  if (options.prioritized) return std::make_unique<PrioritizedSampler>(options.omega);
  return std::make_unique<UniformSampler>();
}

}  // namespace

Expected<std::unique_ptr<Replay>> Replay::create(const ReplayOptions& options) {
  if (!(options.omega >= 0 && options.omega <= 1))  // also NaN
    return Error{ErrorCode::kBadInput, "the exponent of a prioritised replay lies in 0..1"};
  ReplayOptions used = options;
  used.store.keep_recurrent_state = options.unit == Unit::kSequence;
  COMRAD_TRY_ASSIGN(TrajectoryStore store, TrajectoryStore::create(used.store));
  return std::unique_ptr<Replay>(new Replay(used, std::move(store)));
}

Replay::Replay(const ReplayOptions& options, TrajectoryStore store)
    : options_(options), store_(std::move(store)), sampler_(make_sampler(options)) {}

std::shared_lock<std::shared_mutex> Replay::lock_for_reading() const {
  const std::lock_guard turn(turn_);
  return std::shared_lock(store_mutex_);
}

std::unique_lock<std::shared_mutex> Replay::lock_for_writing() {
  const std::lock_guard turn(turn_);
  return std::unique_lock(store_mutex_);
}

void Replay::list_units(ItemId id, std::vector<UnitPlace>& units) const {
  const StoredTrajectory trajectory = store_.item(id);
  for (int step = 0; step < trajectory.length(); ++step) {
    if (!trajectory.valid(step)) continue;
    if (options_.unit == Unit::kSequence) {
      units.push_back({id, -1, -1});
      return;
    }
    if (options_.unit == Unit::kJointStep) {
      units.push_back({id, step, -1});
      continue;
    }
    const auto active = trajectory.agent_active(step);
    for (std::size_t agent = 0; agent < active.size(); ++agent)
      if (active[agent] != 0) units.push_back({id, step, static_cast<int32_t>(agent)});
  }
}

int64_t Replay::insert(const SlabView& slab, uint32_t length, const SlabOrigin& origin) {
  store_.prepare(slab, length);  // this thread's own part of the store
  const auto lock = lock_for_writing();
  const ItemId id = store_.commit(slab, origin);
  std::vector<UnitPlace> fresh;
  if (id != kNoItem) list_units(id, fresh);
  const std::lock_guard unit_lock(unit_mutex_);
  int64_t gone = 0;
  while (!units_.empty() && units_.front().item < store_.oldest()) units_.pop_front(), ++gone;
  sampler_->pop(gone);
  sampler_->push(static_cast<int64_t>(fresh.size()));
  units_.insert(units_.end(), fresh.begin(), fresh.end());
  return id == kNoItem ? 0 : int64_t{store_.item(id).length()} * store_.shape().env.num_agents;
}

std::vector<Draw> Replay::draw(int64_t count, double beta, Rng& rng, double* least_probability) {
  std::vector<Pick> picks;
  std::vector<Draw> draws;
  if (count <= 0) return draws;
  const std::lock_guard lock(unit_mutex_);
  sampler_->draw(count, beta, rng, picks);
  if (least_probability != nullptr) *least_probability = sampler_->least_probability();
  draws.reserve(picks.size());
  for (const Pick& pick : picks) {
    const UnitPlace& place = units_[static_cast<std::size_t>(pick.serial - sampler_->first())];
    draws.push_back({place.item, place.step, place.agent, pick.weight, pick.serial});
  }
  return draws;
}

void Replay::read(const std::function<void(const TrajectoryStore&)>& use) const {
  const auto lock = lock_for_reading();
  use(store_);
}

void Replay::prefetch_draw(const Draw& draw) const {
  if (!store_.contains(draw.item)) return;
  if (draw.step < 0) {
    store_.prefetch(draw.item);
    return;
  }
  // One frame and the next; a cut step also reads its true last observation, which lies behind the others.
  const StoredTrajectory trajectory = store_.item(draw.item);
  store_.prefetch_rows(draw.item, draw.step, draw.step + 1, draw.agent);
  if (const int row = trajectory.final_row(draw.step); row >= 0)
    store_.prefetch_rows(draw.item, trajectory.length() + 1 + row, trajectory.length() + 1 + row, draw.agent);
}

void Replay::prefetch(std::span<const Draw> draws) const {
  if (options_.store.file.empty()) return;
  const auto lock = lock_for_reading();
  // Where a step's frames lie is written in its item's small fields: prefetch all of those first.
  for (const Draw& draw : draws)
    if (draw.step >= 0) store_.prefetch_head(draw.item);
  for (const Draw& draw : draws) prefetch_draw(draw);
}

void Replay::read_each(
    std::span<const Draw> draws,
    const std::function<void(std::size_t index, const StoredTrajectory* trajectory)>& use) const {
  const bool ask = !options_.store.file.empty();
  const bool steps = !draws.empty() && draws.front().step >= 0;
  if (ask && steps) prefetch(draws);
  if (ask && !steps) prefetch(draws.first(std::min(kPrefetchedDraws, draws.size())));
  for (std::size_t index = 0; index < draws.size(); ++index) {
    const auto lock = lock_for_reading();
    if (ask && !steps && index + kPrefetchedDraws < draws.size())
      prefetch_draw(draws[index + kPrefetchedDraws]);
    if (!store_.contains(draws[index].item)) {
      use(index, nullptr);
      continue;
    }
    const StoredTrajectory trajectory = store_.item(draws[index].item);
    use(index, &trajectory);
  }
}

void Replay::set_priorities(std::span<const int64_t> serials, std::span<const float> abs_td) {
  const std::lock_guard lock(unit_mutex_);
  sampler_->set_priorities(serials, abs_td);
}

int64_t Replay::unit_count() const {
  const std::lock_guard lock(unit_mutex_);
  return sampler_->size();
}

int64_t Replay::item_count() const {
  const auto lock = lock_for_reading();
  return store_.item_count();
}

int64_t Replay::transition_count() const {
  const auto lock = lock_for_reading();
  return store_.transition_count();
}

int64_t Replay::capacity_transitions() const {
  const auto lock = lock_for_reading();
  return store_.capacity_transitions();
}

int64_t Replay::used_bytes() const {
  const auto lock = lock_for_reading();
  return store_.used_bytes();
}

int64_t Replay::broken_decisions() const {
  const auto lock = lock_for_reading();
  return store_.broken_decisions();
}

std::optional<Error> Replay::write_error() const {
  const auto lock = lock_for_reading();
  return store_.write_error();
}

Status Replay::save(const std::string& path) const {
  const auto lock = lock_for_reading();
  const std::lock_guard unit_lock(unit_mutex_);
  const SamplerState state = sampler_->state();
  const SamplerHeader header{.unit = static_cast<int64_t>(options_.unit),
                             .unit_count = sampler_->size(),
                             .first = state.first,
                             .leaf_capacity = state.leaf_capacity,
                             .priority_count = static_cast<int64_t>(state.priorities.size()),
                             .max_priority = state.max_priority};
  std::vector<std::byte> bytes(sizeof header + state.priorities.size() * sizeof(double));
  std::memcpy(bytes.data(), &header, sizeof header);
  if (!state.priorities.empty())
    std::memcpy(bytes.data() + sizeof header, state.priorities.data(), bytes.size() - sizeof header);
  COMRAD_TRY_ASSIGN(
      SnapshotWriter writer,
      SnapshotWriter::create(path, store_.snapshot_bytes() + static_cast<int64_t>(bytes.size())));
  COMRAD_TRY(store_.write(writer));
  COMRAD_TRY(writer.write({.tag = static_cast<uint32_t>(SectionTag::kSampler)}, bytes));
  return writer.finish();
}

Status Replay::load(const std::string& path) {
  COMRAD_TRY_ASSIGN(SnapshotReader reader, SnapshotReader::open(path));
  const auto lock = lock_for_writing();
  const std::lock_guard unit_lock(unit_mutex_);
  sampler_ = make_sampler(options_);
  units_.clear();
  Status done = store_.read(reader);
  if (done) done = load_sampler(reader);
  if (!done) {
    store_.clear();
    sampler_ = make_sampler(options_);
    units_.clear();
  }
  return done;
}

Status Replay::load_sampler(SnapshotReader& reader) {
  std::vector<UnitPlace> units;
  for (ItemId id = store_.oldest(); id < store_.end(); ++id) list_units(id, units);
  const auto unit_count = static_cast<int64_t>(units.size());
  const Error bad{ErrorCode::kBadFormat,
                  reader.path() + ": replay snapshot is unusable: its priorities do not fit"};

  std::vector<std::byte> bytes;
  SamplerState state;
  COMRAD_TRY_ASSIGN(SectionHeader section, reader.next(bytes));
  if (section.tag == static_cast<uint32_t>(SectionTag::kSampler)) {
    SamplerHeader header;
    if (bytes.size() < sizeof header) return bad;
    std::memcpy(&header, bytes.data(), sizeof header);
    const auto room = static_cast<int64_t>((bytes.size() - sizeof header) / sizeof(double));
    constexpr int64_t kMostUnits = INT64_MAX / 32;  // sums and multiples below stay numbers
    if (header.unit_count < 0 || header.unit_count > kMostUnits || header.first < 0 ||
        header.first > kMostUnits || header.leaf_capacity < 0 || header.leaf_capacity > 8 * (room + 1024) ||
        header.priority_count != room || (room != 0 && room != header.unit_count) ||
        !is_priority(header.max_priority))
      return bad;
    // Units of another kind, or fewer because less fits, get what is known of them.
    const int64_t left_out = header.unit_count - unit_count;
    if (header.unit == static_cast<int64_t>(options_.unit) && left_out >= 0) {
      state = {.first = header.first + left_out,
               .leaf_capacity = header.leaf_capacity,
               .max_priority = header.max_priority};
      if (room > 0) {
        state.priorities.resize(static_cast<std::size_t>(unit_count));
        if (unit_count > 0)
          std::memcpy(state.priorities.data(),
                      bytes.data() + sizeof header + static_cast<std::size_t>(left_out) * sizeof(double),
                      state.priorities.size() * sizeof(double));
        if (!std::all_of(state.priorities.begin(), state.priorities.end(), is_priority)) return bad;
      }
    }
    COMRAD_TRY_ASSIGN(section, reader.next(bytes));
  }
  if (section.tag != static_cast<uint32_t>(SectionTag::kEnd))
    return Error{ErrorCode::kBadFormat, reader.path() + ": replay snapshot is unusable: it has no end"};
  COMRAD_TRY(reader.expect_end());
  sampler_->restore(state, unit_count);
  units_.assign(units.begin(), units.end());
  return {};
}

}  // namespace comrad::replay
