#include "rollout_buffer/link/frame_sender.h"

#include <lz4.h>

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/checksum.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/timing.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {
namespace {

using shm::RequestKind;
using shm::SlotState;

constexpr double kHelloIntervalS = 0.5;
constexpr double kDeliverFramesForS = 3.0;  // after a stop; the supervisor waits 8 s

}  // namespace

FrameSender::FrameSender(const shm::Arena& arena, dds::LinkBus bus, const FrameSenderOptions& options,
                         const Clock& clock)
    : arena_(arena),
      clock_(clock),
      bus_(std::move(bus)),
      options_(options),
      packer_(arena.slabs().offsets()),
      choices_(static_cast<std::size_t>(arena.shape().trajectory.env.num_agents *
                                        arena.shape().trajectory.env.head_count)),
      pending_(static_cast<std::size_t>(arena.shape().env_count())),
      deliveries_(arena),
      layouts_(arena, options.feeder_id, options.layout_count) {}

Status FrameSender::run(const std::atomic<bool>& stop) {
  if (const std::size_t largest = largest_request_bytes(arena_.slabs().offsets());
      largest > dds::kFrameBatchBytes)
    return Error{ErrorCode::kBadInput, "the observations of one environment take " + std::to_string(largest) +
                                           " bytes, more than the frame link carries at once (" +
                                           std::to_string(dds::kFrameBatchBytes) +
                                           "); give this host policy workers of its own"};
  shm::WorkerCounters& counters = arena_.policy_counters(0);
  counters.begin_life();
  epoch_ = counters.epoch.load();
  if (const int orphans = arena_.reclaim_policy_worker(0); orphans > 0)
    spdlog::warn("{} requests of this worker's predecessor are sent again", orphans);
  arena_.learner_counters().begin_life();
  for (const uint32_t slab : deliveries_.begin_life()) hold(slab);
  counters.state = arena_.learner_counters().state = shm::WorkerState::kRunning;
  heard_s_ = clock_.now_s();
  take_actions();  // the reader is there before anybody is asked
  while (!shm::is_stopping(stop, arena_) && !has_run_ended_) {
    const uint32_t heard = shm::listen(arena_.step_slots().ready(0));
    bool has_moved = take_actions();
    drain();
    if (!refusal_.empty())
      return Error{ErrorCode::kBadInput, "the run does not take this host in: " + refusal_};
    has_moved |= send_ready();
    layouts_.grant();
    const double now_s = clock_.now_s();
    if (now_s - looked_s_ > 0.1) {
      looked_s_ = now_s;
      resend_due();
      send_episodes();
      if (now_s - heard_s_ > options_.patience_s)
        return Error{ErrorCode::kNotFound, "nothing was heard of the host with the policy for " +
                                               std::to_string(static_cast<int>(options_.patience_s)) +
                                               " s; is the run still alive, and the network up?"};
      if (now_s - said_s_ >= kHelloIntervalS) (void)say_hello(/*is_leaving=*/false);
      if (every_second_ && now_s - told_s_ >= 1) told_s_ = now_s, every_second_();
    }
    if (has_moved) continue;
    if (out_count_ == static_cast<int>(pending_.size()))
      bus_.wait(kWaitMs);
    else
      shm::wait(arena_.step_slots().ready(0), heard, out_count_ > 0 ? kPollUs : 1000);
  }
  // What is sealed by now is delivered, if the other end goes on.
  for (const double end_s = clock_.now_s() + kDeliverFramesForS;
       is_played_with() && !has_run_ended_ && !(in_hand_.empty() && arena_.slabs().sealed_count() == 0) &&
       clock_.now_s() < end_s;) {
    drain();
    resend_due();
    if (send_sealed()) send_batch();
    bus_.wait(kWaitMs);
    take_actions();
  }
  send_episodes();
  (void)say_hello(/*is_leaving=*/true);
  if (every_second_) every_second_();
  counters.state = arena_.learner_counters().state = shm::WorkerState::kStopped;
  return {};
}

dds::FrameBatch FrameSender::batch_head() const {
  const shm::ArenaShape& shape = arena_.shape();
  dds::FrameBatch batch;
  batch.feeder_id = options_.feeder_id;
  batch.epoch = epoch_;
  batch.batch_index = batch_index_;
  batch.fingerprint = options_.fingerprint;
  batch.slab_bytes = static_cast<uint64_t>(arena_.slabs().offsets().slab_bytes);
  batch.sim_workers = static_cast<uint32_t>(shape.sim_worker_count);
  batch.envs_per_worker = static_cast<uint32_t>(shape.envs_per_worker);
  batch.host = options_.host;
  return batch;
}

Status FrameSender::say_hello(bool is_leaving) {
  said_s_ = clock_.now_s();
  dds::FrameBatch hello = batch_head();
  hello.is_leaving = is_leaving;
  return bus_.write(hello);
}

FrameRequest FrameSender::request_of(const shm::StepSlot& slot, int env) const {
  const shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slot.slab_index));
  FrameRequest request;
  request.step_id = slot.step_id;
  request.episode_id = slot.episode_id;
  request.rollout_index = header.rollout_index;
  request.layout_id = header.layout_id;
  request.first_episode_id = header.first_episode.episode_id;
  request.first_episode_seed = header.first_episode.episode_seed;
  request.env_index = static_cast<uint32_t>(env);
  request.kind = static_cast<uint32_t>(slot.kind);
  request.step = slot.step;
  request.final_row = slot.final_row;
  request.episode_step = slot.episode_step;
  request.reset_state = slot.reset_state;
  return request;
}

/// A first row begins a trajectory on the other end, which says how many it has room for.
bool FrameSender::may_begin(const shm::StepSlot& slot) const {
  return slot.step > 0 || slot.kind != RequestKind::kAct || begun_ < credit_;
}

bool FrameSender::send_ready() {
  const shm::ArenaShape& shape = arena_.shape();
  bool has_sent = send_sealed();  // first: the next rollout of an environment follows
  for (int env = 0; env < shape.env_count(); ++env) {
    shm::StepSlot& slot = arena_.step_slots().slot(env);
    if (slot.state.load(std::memory_order_acquire) != SlotState::kReady || !may_begin(slot)) continue;
    // Simulators of this host are ours, but a wild one must not make this process read outside of the slab.
    if (slot.slab_index >= static_cast<uint32_t>(shape.slab_count) ||
        slot.step > static_cast<uint32_t>(shape.trajectory.rollout_steps) ||
        slot.final_row >= static_cast<uint32_t>(std::max(1, shape.trajectory.final_capacity)) ||
        slot.kind > RequestKind::kFinal)
      continue;
    if (!shm::advance(slot, SlotState::kReady, SlotState::kInBatch)) continue;
    Pending& pending = pending_[static_cast<std::size_t>(env)];
    // A new simulator may ask in place of a dead one, even the same.
    const FrameRequest request = request_of(slot, env);
    const bool is_again = pending.is_out && request.step_id == pending.request.step_id &&
                          request.rollout_index == pending.request.rollout_index &&
                          request.step == pending.request.step;
    out_count_ += !std::exchange(pending.is_out, true);
    pending.request = request;
    pending.slab = slot.slab_index;
    begun_ += request.step == 0 && !is_again;
    const SlabView slab = arena_.slabs().view(static_cast<int>(pending.slab));
    make_room(pending.request);
    packer_.add(pending.request, slab);
    packed_.push_back(env);
    has_sent = true;
  }
  if (packer_.count() > 0) send_batch();
  return has_sent;
}

void FrameSender::make_room(const FrameRequest& request) {
  if (packer_.count() > 0 &&
      packer_.bytes().size() + bytes_of(request, arena_.slabs().offsets()) > options_.batch_bytes)
    send_batch();
}

/// What cannot be written now is sent by resend_due().
bool FrameSender::send_batch() {
  dds::FrameBatch batch = batch_head();
  batch.request_count = packer_.count();
  batch.raw_bytes = static_cast<uint32_t>(packer_.bytes().size());
  batch.checksum = checksum64(packer_.bytes());
  batch.payload = packer_.bytes();
  batch.is_compressed = options_.compression == Compression::kAlways ||
                        (options_.compression == Compression::kAuto && choice_.is_compressed());
  if (batch.is_compressed) {
    compressed_.resize(static_cast<std::size_t>(LZ4_compressBound(static_cast<int>(batch.raw_bytes))));
    const int bytes = LZ4_compress_default(
        reinterpret_cast<const char*>(batch.payload.data()), reinterpret_cast<char*>(compressed_.data()),
        static_cast<int>(batch.raw_bytes), static_cast<int>(compressed_.size()));
    batch.is_compressed = bytes > 0 && bytes < static_cast<int>(batch.raw_bytes);
    if (batch.is_compressed) batch.payload = {compressed_.data(), static_cast<std::size_t>(bytes)};
  }
  const double now_s = clock_.now_s();
  const Status written = bus_.write(batch);
  if (written) {
    ++batch_index_;
    ++account_.batches;
    account_.raw_bytes += batch.raw_bytes;
    account_.sent_bytes += batch.payload.size();
    account_.is_compressed = batch.is_compressed;
    said_s_ = now_s;
  } else if (written.error().code != ErrorCode::kTimeout) {
    spdlog::warn("{}", written.error().message);
  }
  for (const int env : packed_) {
    Pending& pending = pending_[static_cast<std::size_t>(env)];
    pending.sent_s = written ? now_s : now_s - options_.resend_after_s;
  }
  for (InHand& one : in_hand_)
    if (std::exchange(one.is_packed, false)) one.sent_s = written ? now_s : now_s - options_.resend_after_s;
  packer_.clear();
  packed_.clear();
  return written.has_value();
}

void FrameSender::resend_due() {
  const double now_s = clock_.now_s();
  const auto is_silent = now_s - heard_s_ > 2 * options_.resend_after_s;
  std::size_t bytes = 0;
  for (InHand& one : in_hand_) {
    if (one.is_done || one.sent_s == 0 || now_s - one.sent_s < options_.resend_after_s) continue;
    one.sent_s = 0;
    ++account_.resent;
  }
  send_sealed();
  for (std::size_t env = 0; env < pending_.size(); ++env) {
    Pending& pending = pending_[env];
    if (!pending.is_out || now_s - pending.sent_s < options_.resend_after_s) continue;
    if (arena_.step_slots().slot(static_cast<int>(env)).state.load(std::memory_order_acquire) !=
        SlotState::kInBatch) {
      pending.is_out = false;  // its simulator died
      --out_count_;
      continue;
    }
    packer_.add(pending.request, arena_.slabs().view(static_cast<int>(pending.slab)));
    packed_.push_back(static_cast<int>(env));
    ++account_.resent;
    bytes = packer_.bytes().size();
    if (bytes > options_.batch_bytes / 2 && (!send_batch() || is_silent))
      return;  // a dead link gets one batch
  }
  if (packer_.count() > 0) send_batch();
}

bool FrameSender::take_actions() {
  bool has_moved = false;
  bus_.take_actions(options_.feeder_id, [&](const dds::ActionBatch& batch) {
    if (batch.epoch != epoch_) return;  // for this worker's predecessor
    heard_s_ = clock_.now_s();
    if (batch.run_state == "refused") {
      refusal_ = batch.message.empty() ? "no reason was given" : batch.message;
      return;
    }
    has_run_ended_ |= batch.run_state == "stopping";
    if (batch.run_state == "leaving")
      arena_.control().leave_requested = 1;  // the supervisor stops simulators
    if (session_ != batch.session) begin_anew(batch.session);
    credit_ = batch.credit_index;
    arena_.control().schedule_env_frames = batch.schedule_env_frames;
    has_moved |= take_answers(batch.payload);
  });
  return has_moved;
}

/// The other end has given this host other places: it knows nothing of what was asked, and counts from 0.
void FrameSender::begin_anew(uint64_t session) {
  session_ = session;
  begun_ = 0;
  for (InHand& one : in_hand_) one.sent_s = 0;
  for (Pending& pending : pending_) {
    if (!pending.is_out) continue;
    begun_ += pending.request.step == 0;
    pending.sent_s = 0;
  }
}

bool FrameSender::take_answers(std::span<const std::byte> payload) {
  const shm::ArenaShape& shape = arena_.shape();
  const double now_s = clock_.now_s();
  const auto agents = static_cast<uint64_t>(shape.trajectory.env.num_agents);
  uint64_t decisions = 0;
  bool has_moved = false;
  std::vector<bool> is_split_acted;
  while (true) {
    const Expected<std::optional<FrameAnswer>> taken = take_answer(payload, shape.trajectory.env, choices_);
    if (!taken) {
      if (++account_.refused == 1) spdlog::warn("the other end sent {}", taken.error().message);
      break;
    }
    if (!*taken) break;
    const FrameAnswer& answer = **taken;
    if (answer.kind == kSealedKind) {
      take_sealed(answer);
      continue;
    }
    Pending* pending = answer.env_index < pending_.size() ? &pending_[answer.env_index] : nullptr;
    if (pending == nullptr || !pending->is_out || pending->request.step_id != answer.step_id ||
        pending->request.rollout_index != answer.rollout_index || pending->request.kind != answer.kind ||
        pending->request.step != answer.step) {
      ++account_.duplicates;
      continue;
    }
    const int env = static_cast<int>(answer.env_index);
    shm::StepSlot& slot = arena_.step_slots().slot(env);
    pending->is_out = false;
    --out_count_;
    if (answer.kind == static_cast<uint32_t>(RequestKind::kAct)) {
      const SlabView slab = arena_.slabs().view(static_cast<int>(pending->slab));
      std::ranges::copy(choices_, slab.action(static_cast<int>(answer.step), 0).data());
      decisions += agents;
    }
    if (pending->sent_s > 0) latency_.add((now_s - pending->sent_s) * 1e6);
    if (!shm::advance(slot, SlotState::kInBatch, SlotState::kActed)) continue;  // its simulator died
    has_moved = true;
    const int worker = env / shape.envs_per_worker, local = env % shape.envs_per_worker;
    const int split = shape.splits_per_worker > 1 && local >= shape.split_begin(1) ? 1 : 0;
    is_split_acted.resize(static_cast<std::size_t>(shape.sim_worker_count * shape.splits_per_worker));
    is_split_acted[static_cast<std::size_t>(worker * shape.splits_per_worker + split)] = true;
  }
  for (std::size_t place = 0; place < is_split_acted.size(); ++place)
    if (is_split_acted[place])
      shm::ring(arena_.step_slots().acted(static_cast<int>(place) / shape.splits_per_worker,
                                          static_cast<int>(place) % shape.splits_per_worker));
  account_.decisions += decisions;
  arena_.policy_counters(0).decisions.fetch_add(decisions, std::memory_order_relaxed);
  if (options_.compression == Compression::kAuto) choice_.count(decisions, now_s);
  return has_moved;
}

void FrameSender::drain() {
  for (const uint32_t slab : arena_.slabs().drain(arena_.shape().slab_count)) hold(slab);
  finish_done();
}

void FrameSender::hold(uint32_t slab) {
  const shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slab));
  InHand& one = in_hand_.emplace_back();
  one.slab = slab;
  one.request.rollout_index = header.rollout_index;
  one.request.env_index = header.env_index;
  one.request.kind = kSealedKind;
  one.request.step = header.length;
  one.is_done = one.is_delivered = header.length == 0;
}

/// Puts into the batch what the other end has to seal and was not told of. Whether there was any.
bool FrameSender::send_sealed() {
  bool has_any = false;
  for (std::size_t place = 0; place < in_hand_.size(); ++place) {
    InHand& one = in_hand_[place];
    if (one.is_done || one.sent_s > 0 || one.is_packed) continue;
    make_room(one.request);
    packer_.add(one.request, arena_.slabs().view(static_cast<int>(one.slab)));
    one.is_packed = has_any = true;
  }
  return has_any;
}

void FrameSender::take_sealed(const FrameAnswer& answer) {
  const auto found = std::ranges::find_if(in_hand_, [&](const InHand& one) {
    return one.request.env_index == answer.env_index && one.request.rollout_index == answer.rollout_index &&
           !one.is_done;
  });
  if (found == in_hand_.end()) {
    ++account_.duplicates;
    return;
  }
  found->is_done = true;
  found->is_delivered = answer.is_sealed == 1;
  finish_done();
}

void FrameSender::finish_done() {
  while (!in_hand_.empty() && in_hand_.front().is_done) {
    deliveries_.finish(in_hand_.front().slab, in_hand_.front().is_delivered);
    in_hand_.pop_front();
  }
}

void FrameSender::send_episodes() {
  for (int count = 0; count < kEpisodesAtOnce && credit_ > 0; ++count) {
    const std::optional<EpisodeRecord> record = arena_.episodes().read(shm::EpisodeReader::kLearner);
    if (!record) return;
    const Status written = bus_.write(dds::FeederEpisode{.feeder_id = options_.feeder_id, .record = *record});
    if (!written) spdlog::warn("the episode's score is lost: {}", written.error().message);
  }
}

double FrameSender::silent_s() const { return clock_.now_s() - heard_s_; }

FeederAccount FrameSender::deliveries() const {
  FeederAccount account = account_of(arena_, deliveries_);
  account.resent = account_.resent;
  return account;
}

FrameAccount FrameSender::account() const {
  FrameAccount account = account_;
  account.latency_us_p50 = latency_.quantile_us(0.5);
  account.latency_us_p90 = latency_.quantile_us(0.9);
  account.latency_us_p99 = latency_.quantile_us(0.99);
  return account;
}

}  // namespace comrad::link
