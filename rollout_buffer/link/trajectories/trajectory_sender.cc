#include "rollout_buffer/link/trajectories/trajectory_sender.h"

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::link {
namespace {

constexpr std::size_t kMostInHand = 64;

/// A session's first half is the learner's arena.
uint64_t arena_of(uint64_t session) { return session >> 32; }

}  // namespace

TrajectorySender::TrajectorySender(const shm::Arena& arena, dds::LinkBus bus, const SendingOptions& options,
                                   const Clock& clock)
    : SendingEnd(arena, std::move(bus), options, clock),
      cutter_(arena.slabs().offsets()),
      weights_(arena.shape().weights_bytes) {}

Status TrajectorySender::turn() {
  deliver();
  return {};
}

void TrajectorySender::deliver() {
  hear_all();
  drain();
  send();
  const double now_s = clock_.now_s();
  if (session_.is_heard(now_s) && in_hand_.resend_if_stuck(now_s, resend_after_s_)) cutting_.reset();
}

void TrajectorySender::hear_all() {
  bus_.take<dds::PeerState>([this](const dds::PeerState& state) {
    if (!hear(state)) return;
    // None of it is done that was not sent in this life.
    for (uint64_t index = in_hand_.first_index();
         index < std::min(state.done_index, in_hand_.end_index()) && in_hand_.at(index).was_sent; ++index)
      in_hand_.at(index).is_done = in_hand_.at(index).is_delivered = true;
    give_back_done();
  });
  bus_.take<dds::WeightsChunk>([this](const dds::WeightsChunk& chunk) {
    const Expected<bool> whole = weights_.take(chunk);
    if (!whole) spdlog::warn("{}", whole.error().message);
    if (whole && *whole && (!arena_.weights().has_any() || arena_.weights().version() != weights_.version()))
      arena_.weights().publish(weights_.weights(), weights_.version());
  });
}

/// Where the other end's arena is new, what was sent may have been learned by the one before: it is not sent twice.
void TrajectorySender::renew() {
  cutting_.reset();
  if (arena_of(session_.session()) == arena_of(session_.session_before())) return;
  for (Outbox::Item& item : in_hand_) {
    if (!item.was_sent) break;
    item.is_done = true;
  }
  give_back_done();
  in_hand_.restart();
}

/// Takes no more than may be sent: what waits in the arena is this host's back-pressure.
void TrajectorySender::drain() {
  const uint64_t credit = is_open() ? session_.newest().credit_index : 0;
  if (credit <= in_hand_.end_index() || in_hand_.size() >= kMostInHand) return;
  const uint64_t room = std::min<uint64_t>(credit - in_hand_.end_index(), kMostInHand - in_hand_.size());
  for (const uint32_t slab : arena_.slabs().drain(static_cast<int>(room))) in_hand_.add(slab);
}

/// False where the network did not take all that may be sent.
bool TrajectorySender::send() {
  for (uint64_t index = in_hand_.first_index(); index < in_hand_.end_index() && session_.has_credit(index);
       ++index) {
    Outbox::Item& item = in_hand_.at(index);
    if (item.is_sent) continue;
    if (cutting_ != index) {
      cutter_.begin(arena_.slabs().view(static_cast<int>(item.slab)),
                    arena_.slabs().header(static_cast<int>(item.slab)),
                    {.peer_id = session_.newest().peer_id, .send_index = index, .epoch = session_.epoch()});
      cutting_ = index;
      next_fragment_ = 0;
      resent_ += item.was_sent;
      item.was_sent = true;
    }
    for (; next_fragment_ < cutter_.fragment_count(); ++next_fragment_)
      if (const Status written = bus_.write(cutter_.cut(next_fragment_)); !written) {
        if (written.error().code != ErrorCode::kTimeout) spdlog::warn("{}", written.error().message);
        return false;
      }
    cutting_.reset();
    in_hand_.sent(index, clock_.now_s());
  }
  return true;
}

Status TrajectorySender::say_hello(bool is_leaving) {
  const SenderAccount now = account();
  return bus_.write(dds::SenderReport{.hello = session_.hello(clock_.now_s(), is_leaving),
                                      .decisions_played = now.played,
                                      .decisions_delivered = now.delivered,
                                      .decisions_lost = now.lost});
}

}  // namespace comrad::link
