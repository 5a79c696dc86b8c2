#include "rollout_buffer/link/feeder.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/timing.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::link {
namespace {

constexpr double kReportIntervalS = 0.5;
constexpr double kDeliverForS = 5.0;    // after a stop; the supervisor waits 8 s
constexpr double kAnswerWithinS = 1.0;  // to what was sent last: both hosts count it alike
constexpr double kSilentAfterS = 2.0;   // without a state of the learner's host nothing is sent again
constexpr std::size_t kMostInHand = 64;
constexpr uint32_t kEpochsOfALife = 1 << 16;  // between two epochs of one life of this process

/// A session's first half is the learner's arena, its second the life of the process that receives.
uint64_t arena_of(uint64_t session) { return session >> 32; }

}  // namespace

Feeder::Feeder(const shm::Arena& arena, dds::LinkBus bus, const FeederOptions& options, const Clock& clock)
    : arena_(arena),
      clock_(clock),
      bus_(std::move(bus)),
      options_(options),
      cutter_(arena.slabs().offsets()),
      weights_(arena.shape().weights_bytes),
      deliveries_(arena),
      layouts_(arena, options.feeder_id, options.layout_count) {}

Status Feeder::run(const std::atomic<bool>& stop) {
  shm::WorkerCounters& counters = arena_.learner_counters();
  counters.begin_life();
  epoch_ = counters.epoch.load();
  for (const uint32_t slab : deliveries_.begin_life()) in_hand_.push_back({.slab = slab, .was_sent = true});
  if (!in_hand_.empty())
    spdlog::warn("{} trajectories of this worker's predecessor are sent again", in_hand_.size());
  counters.state = shm::WorkerState::kRunning;
  heard_s_ = progress_s_ = clock_.now_s();
  while (!shm::is_stopping(stop, arena_) && !has_run_ended_) {
    COMRAD_TRY(hear());
    drain();
    send();
    resend_if_stuck();
    send_episodes();
    layouts_.grant();
    if (clock_.now_s() - reported_s_ >= kReportIntervalS) report(/*is_leaving=*/false);
    if (every_second_ && clock_.now_s() - told_s_ >= 1) told_s_ = clock_.now_s(), every_second_();
    bus_.wait(kWaitMs);
  }
  // What is sealed by now is delivered, if the other end goes on.
  for (const double end_s = clock_.now_s() + kDeliverForS;
       is_fed() && !has_run_ended_ && !(in_hand_.empty() && arena_.slabs().sealed_count() == 0) &&
       clock_.now_s() < end_s;) {
    COMRAD_TRY(hear());
    drain();
    send();
    resend_if_stuck();
    bus_.wait(kWaitMs);
  }
  const auto is_unanswered = [this] { return !in_hand_.empty() && in_hand_.front().was_sent; };
  for (const double end_s = clock_.now_s() + kAnswerWithinS;
       is_fed() && !has_run_ended_ && is_unanswered() && clock_.now_s() < end_s;) {
    COMRAD_TRY(hear());
    bus_.wait(kWaitMs);
  }
  send_episodes();
  report(/*is_leaving=*/true);
  if (every_second_) every_second_();
  counters.state = shm::WorkerState::kStopped;
  return {};
}

Status Feeder::hear() {
  bus_.take_states(options_.feeder_id, [this](const dds::FeedState& state) { take_state(state); });
  if (!refusal_.empty())
    return Error{ErrorCode::kBadInput, "the run does not take this host in: " + refusal_};
  bus_.take_weights([this](const dds::WeightsChunk& chunk) {
    const Expected<bool> whole = weights_.take(chunk);
    if (!whole) spdlog::warn("{}", whole.error().message);
    if (whole && *whole && (!arena_.weights().has_any() || arena_.weights().version() != weights_.version()))
      arena_.weights().publish(weights_.weights(), weights_.version());
  });
  if (clock_.now_s() - heard_s_ > options_.patience_s)
    return Error{ErrorCode::kNotFound, "nothing was heard of the learner's host for " +
                                           std::to_string(static_cast<int>(options_.patience_s)) +
                                           " s; is the run still alive, and the network up?"};
  return {};
}

void Feeder::take_state(const dds::FeedState& state) {
  const bool was_silent = clock_.now_s() - heard_s_ > kSilentAfterS;
  heard_s_ = clock_.now_s();
  if (state.epoch != epoch_) return;  // it answers this worker's predecessor, or an earlier count
  if (state.run_state == "refused") {
    refusal_ = state.message.empty() ? "no reason was given" : state.message;
    return;
  }
  has_run_ended_ |= state.run_state == "stopping";
  if (state.run_state == "leaving") arena_.control().leave_requested = 1;  // the supervisor stops simulators
  if (session_ != state.session && session_ != 0) return begin_anew(state.session);
  session_ = state.session;
  state_ = state;
  arena_.control().schedule_env_frames = state.schedule_env_frames;
  while (first_index_ < state.done_index && !in_hand_.empty() && in_hand_.front().was_sent)
    finish_first(true);
  if (was_silent)  // what was under way when the network went is gone
    for (InHand& one : in_hand_) one.is_sent = false;
}

/// The other end is another one. Where its arena is new, what was sent may have been learned by the one before: it is
/// not sent twice. Indices begin at 0 again under another epoch, so that no fragment on its way is taken for a new one.
void Feeder::begin_anew(uint64_t session) {
  while (arena_of(session_) != arena_of(session) && !in_hand_.empty() && in_hand_.front().was_sent)
    finish_first(/*is_delivered=*/false);
  session_ = session;
  epoch_ += kEpochsOfALife;
  first_index_ = 0;
  cutting_.reset();
  for (InHand& one : in_hand_) one.is_sent = false;
  state_.reset();
  report(/*is_leaving=*/false);
}

void Feeder::finish_first(bool is_delivered) {
  deliveries_.finish(in_hand_.front().slab, is_delivered);
  if (is_delivered) progress_s_ = clock_.now_s();
  in_hand_.pop_front();
  if (cutting_ == first_index_) cutting_.reset();
  ++first_index_;
}

/// Takes no more than may be sent: what waits in the arena is this host's back-pressure.
void Feeder::drain() {
  if (!is_fed()) return;
  const uint64_t end_index = first_index_ + in_hand_.size();
  if (state_->credit_index <= end_index || in_hand_.size() >= kMostInHand) return;
  const uint64_t room = std::min<uint64_t>(state_->credit_index - end_index, kMostInHand - in_hand_.size());
  for (const uint32_t slab : arena_.slabs().drain(static_cast<int>(room))) in_hand_.push_back({.slab = slab});
}

/// False where the network did not take all that may be sent.
bool Feeder::send() {
  if (!is_fed()) return true;
  for (std::size_t place = 0; place < in_hand_.size(); ++place) {
    InHand& one = in_hand_[place];
    const uint64_t index = first_index_ + place;
    if (index >= state_->credit_index) break;
    if (one.is_sent) continue;
    if (cutting_ != index) {
      cutter_.begin(arena_.slabs().view(static_cast<int>(one.slab)),
                    arena_.slabs().header(static_cast<int>(one.slab)),
                    {.feeder_id = options_.feeder_id, .epoch = epoch_, .send_index = index});
      cutting_ = index;
      next_fragment_ = 0;
      resent_ += one.was_sent;
      one.was_sent = true;
    }
    for (; next_fragment_ < cutter_.fragment_count(); ++next_fragment_)
      if (const Status written = bus_.write(cutter_.cut(next_fragment_)); !written) {
        if (written.error().code != ErrorCode::kTimeout) spdlog::warn("{}", written.error().message);
        return false;
      }
    cutting_.reset();
    one.is_sent = true;
    progress_s_ = clock_.now_s();
  }
  return true;
}

void Feeder::resend_if_stuck() {
  const double now_s = clock_.now_s();
  if (in_hand_.empty() || !in_hand_.front().is_sent) return;
  if (now_s - progress_s_ < options_.resend_after_s || now_s - heard_s_ > kSilentAfterS) return;
  for (InHand& one : in_hand_) one.is_sent = false;
  cutting_.reset();
  progress_s_ = now_s;
}

void Feeder::send_episodes() {
  if (!is_fed()) return;
  for (int count = 0; count < kEpisodesAtOnce; ++count) {
    const std::optional<EpisodeRecord> record = arena_.episodes().read(shm::EpisodeReader::kLearner);
    if (!record) return;
    const Status written = bus_.write(dds::FeederEpisode{.feeder_id = options_.feeder_id, .record = *record});
    if (!written) spdlog::warn("the episode's score is lost: {}", written.error().message);
  }
}

void Feeder::report(bool is_leaving) {
  reported_s_ = clock_.now_s();
  const shm::ArenaShape& shape = arena_.shape();
  const FeederAccount now = account();
  const Status written =
      bus_.write(dds::FeedReport{.feeder_id = options_.feeder_id,
                                 .epoch = epoch_,
                                 .beat = ++beat_,
                                 .fingerprint = options_.fingerprint,
                                 .slab_bytes = static_cast<uint64_t>(arena_.slabs().offsets().slab_bytes),
                                 .sim_workers = static_cast<uint32_t>(shape.sim_worker_count),
                                 .envs_per_worker = static_cast<uint32_t>(shape.envs_per_worker),
                                 .is_leaving = is_leaving,
                                 .weights_version = arena_.weights().version(),
                                 .decisions_played = now.played,
                                 .decisions_delivered = now.delivered,
                                 .decisions_lost = now.lost,
                                 .host = options_.host});
  if (!written && written.error().code != ErrorCode::kTimeout) spdlog::warn("{}", written.error().message);
}

double Feeder::silent_s() const { return clock_.now_s() - heard_s_; }

FeederAccount Feeder::account() const {
  FeederAccount account = account_of(arena_, deliveries_);
  account.resent = resent_;
  return account;
}

}  // namespace comrad::link
