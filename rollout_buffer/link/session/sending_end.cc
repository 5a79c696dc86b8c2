#include "rollout_buffer/link/session/sending_end.h"

#include <utility>
#include <vector>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/is_stopping.h"
#include "rollout_buffer/shm/layout_mailbox.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {
namespace {

constexpr double kDeliverForS = 5.0;        // after a stop; the supervisor waits 8 s
constexpr double kKeepUpIntervalS = 0.004;  // a turn may be far shorter
constexpr double kAnswerWithinS = 1.0;      // to what was sent last: both hosts count it alike

dds::PeerHello hello_of(const shm::Arena& arena, const SendingOptions& options) {
  return {.peer_id = options.peer_id,
          .fingerprint = options.fingerprint,
          .slab_bytes = static_cast<uint64_t>(arena.slabs().offsets().slab_bytes),
          .epoch = (arena.learner_counters().epoch.load() + 1) << 16,  // of the life that begins
          .sim_workers = static_cast<uint32_t>(arena.shape().sim_worker_count),
          .envs_per_worker = static_cast<uint32_t>(arena.shape().envs_per_worker),
          .host = options.host};
}

}  // namespace

SendingEnd::SendingEnd(const shm::Arena& arena, dds::LinkBus bus, const SendingOptions& options,
                       const Clock& clock)
    : arena_(arena),
      clock_(clock),
      bus_(std::move(bus)),
      resend_after_s_(options.resend_after_s),
      session_(hello_of(arena, options), options.patience_s, clock.now_s()),
      layout_count_(options.layout_count),
      layout_draws_(RngKey(options.peer_id).split("layouts")) {}

Status SendingEnd::run(const std::atomic<bool>& stop) {
  COMRAD_TRY(begin());
  while (!shm::is_stopping(stop, arena_) && !has_run_ended()) {
    COMRAD_TRY(turn());
    COMRAD_TRY(keep_up());
    wait();
  }
  const auto deliver_while = [&](double for_s, auto is_wanted) {
    for (const double end_s = clock_.now_s() + for_s;
         is_open() && !has_run_ended() && is_wanted() && clock_.now_s() < end_s; bus_.wait(kWaitMs))
      deliver();
  };
  deliver_while(kDeliverForS, [&] { return !in_hand_.empty() || arena_.slabs().sealed_count() > 0; });
  deliver_while(kAnswerWithinS, [&] { return !in_hand_.empty() && in_hand_.front().was_sent; });
  leave();
  if (every_second_) every_second_();
  return {};
}

void SendingEnd::leave() {
  send_episodes();
  (void)say_hello(/*is_leaving=*/true);
  arena_.learner_counters().state = shm::WorkerState::kStopped;
}

Status SendingEnd::begin() {
  arena_.learner_counters().begin_life();
  adopt();
  arena_.learner_counters().state = shm::WorkerState::kRunning;
  return {};
}

/// Resumes from a predecessor's counts, with the slabs that it had drained and was not done with.
void SendingEnd::adopt() {
  delivered_ = arena_.learner_counters().decisions.load();
  lost_ = arena_.control().decisions_lost_on_the_way.load();
  arena_.control().learner_decisions_before = delivered_;
  std::vector<uint32_t> slabs = arena_.slabs().adopt();
  uint64_t held = 0;
  for (const uint32_t slab : slabs) held += decisions_of(slab);
  // A predecessor that died between counting its oldest one and giving it back has counted more than was taken.
  if (!slabs.empty() && delivered_ + lost_ + held > arena_.accounts().counts().taken) {
    arena_.slabs().release(slabs.front());
    slabs.erase(slabs.begin());
  }
  for (const uint32_t slab : slabs) in_hand_.add(slab, /*was_sent=*/true);
  if (!slabs.empty())
    spdlog::warn("{} trajectories of this worker's predecessor are sent again", slabs.size());
}

bool SendingEnd::hear(const dds::PeerState& state) {
  const PeerSession::Heard heard = session_.hear(state, clock_.now_s());
  if (heard == PeerSession::Heard::kNothing) return false;
  if (session_.is_asked_to_leave()) arena_.control().leave_requested = 1;  // the supervisor stops simulators
  if (heard == PeerSession::Heard::kNewSession) {
    in_hand_.restart();
    renew();
    return false;
  }
  if (heard == PeerSession::Heard::kBackFromSilence) in_hand_.resend_all();
  arena_.control().schedule_env_frames = state.schedule_env_frames;
  return true;
}

Status SendingEnd::keep_up() {
  const double now_s = clock_.now_s();
  if (now_s - kept_up_s_ < kKeepUpIntervalS) return {};
  kept_up_s_ = now_s;
  COMRAD_TRY(session_.check("the learner's host", now_s));
  if (is_open()) send_episodes();
  // Each environment that took its last map is assigned another; how episodes ended does not matter here.
  for (int env = 0; layout_count_ > 0 && env < arena_.shape().env_count(); ++env) {
    shm::LayoutMailbox& mailbox = arena_.layout_mailboxes().of(env);
    if (mailbox.is_due()) mailbox.assign(layout_draws_.below(static_cast<uint32_t>(layout_count_)));
  }
  if (session_.is_hello_due(now_s))
    if (const Status said = say_hello(/*is_leaving=*/false);
        !said && said.error().code != ErrorCode::kTimeout)
      spdlog::warn("{}", said.error().message);
  if (every_second_ && now_s - told_s_ >= 1) told_s_ = now_s, every_second_();
  return {};
}

void SendingEnd::send_episodes() {
  for (int count = 0; count < kEpisodesAtOnce && is_open(); ++count) {
    const std::optional<EpisodeRecord> record = arena_.episodes().read(shm::EpisodeReader::kLearner);
    if (!record) return;
    if (const Status written = bus_.write(dds::PeerEpisode{session_.newest().peer_id, *record}); !written)
      spdlog::warn("the episode's score is lost: {}", written.error().message);
  }
}

void SendingEnd::give_back_done() {
  for (; !in_hand_.empty() && in_hand_.front().is_done; in_hand_.pop_front(clock_.now_s())) {
    const Outbox::Item& item = in_hand_.front();
    (item.is_delivered ? delivered_ : lost_) += decisions_of(item.slab);
    if (item.is_delivered) {
      arena_.learner_counters().decisions = delivered_;
      arena_.learner_counters().batches.fetch_add(1);
    } else {
      arena_.control().decisions_lost_on_the_way = lost_;
    }
    arena_.slabs().release(item.slab);
  }
}

uint64_t SendingEnd::decisions_of(uint32_t slab) const {
  return uint64_t{arena_.slabs().header(static_cast<int>(slab)).length} *
         static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
}

SenderAccount SendingEnd::account() const {
  SenderAccount account{.delivered = delivered_, .lost = lost_, .resent = resent_};
  for (int sim = 0; sim < arena_.shape().sim_worker_count; ++sim)
    account.played += arena_.sim_counters(sim).decisions.load();
  for (int index = 0; index < arena_.shape().slab_count; ++index) {
    const shm::SlabState state = arena_.slabs().header(index).state.load(std::memory_order_acquire);
    if (state == shm::SlabState::kSealed || state == shm::SlabState::kLearning)
      account.waiting += decisions_of(static_cast<uint32_t>(index));
    else if (state == shm::SlabState::kFilling)
      account.unfinished += decisions_of(static_cast<uint32_t>(index));
  }
  return account;
}

}  // namespace comrad::link
