#include "rollout_buffer/link/trajectories/trajectory_receiver.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::link {

TrajectoryReceiver::TrajectoryReceiver(const shm::Arena& arena, dds::LinkBus bus,
                                       const TrajectoryReceiverOptions& options, const Clock& clock)
    : ServingEnd(arena, std::move(bus),
                 {.first_worker = options.first_worker,
                  .worker_count = arena.shape().sim_worker_count - options.first_worker,
                  .fingerprint = fingerprint_of(options.offer),
                  .silent_after_s = options.silent_after_s,
                  .kind = "other hosts",
                  .flag = "--serve_workers",
                  .most_peers = options.most_peers},
                 clock),
      own_(options),
      endpoint_(options.offer),
      weights_pace_(options.weights) {}

bool TrajectoryReceiver::take_all() {
  bus_.take_questions([this](const dds::JoinQuestion& question) {
    if (const Status written = bus_.write(endpoint_.answer(question)); !written)
      spdlog::warn("a host that requests to join is not answered: {}", written.error().message);
  });
  bus_.take<dds::SenderReport>([this](const dds::SenderReport& report) {
    hear(report.hello);
    if (Peer* const peer = find(report.hello.peer_id)) {
      peer->record.played_there = report.decisions_played;
      peer->record.lost_there = report.decisions_lost;
    }
  });
  bus_.take<dds::TrajectoryFragment>([this](const dds::TrajectoryFragment& fragment) { take(fragment); });
  take_episodes();
  send_weights_if_due();
  return false;
}

void TrajectoryReceiver::drop_all() {
  bus_.take<dds::SenderReport>([](const dds::SenderReport&) {});
  bus_.take<dds::TrajectoryFragment>([](const dds::TrajectoryFragment&) {});
}

Status TrajectoryReceiver::send_state(Peer&, const dds::PeerState& state) { return bus_.write(state); }

std::unique_ptr<Peer> TrajectoryReceiver::make_peer() const {
  return std::make_unique<SlabPeer>(arena_.slabs().offsets());
}

void TrajectoryReceiver::take(const dds::TrajectoryFragment& fragment) {
  Peer* const found = find(fragment.peer_id);
  // What is not due is sent again in time: it was lost with a network, or comes from before.
  if (found == nullptr || !found->session.is_due(fragment.epoch, fragment.send_index) ||
      found->reserved.empty())
    return;
  auto& peer = static_cast<SlabPeer&>(*found);
  peer.session.touch(clock_.now_s());
  if (fragment.fragment_index == 0) {
    peer.assembler.begin(arena_.slabs().view(static_cast<int>(peer.reserved.front())));
    peer.is_assembling = true;
  }
  if (!peer.is_assembling || fragment.fragment_index != peer.assembler.next_index()) {
    peer.is_assembling = false;
    return;
  }
  const Expected<bool> whole = peer.assembler.take(fragment);
  if (whole && !*whole) return;
  peer.is_assembling = false;
  peer.session.finish_one();
  if (whole)
    seal(peer, fragment);
  else
    refuse(peer, whole.error().message);
}

void TrajectoryReceiver::seal(SlabPeer& peer, const dds::TrajectoryFragment& fragment) {
  const int env = env_of(peer, fragment.env_index);
  if (env < 0)
    return refuse(peer,
                  fmt::format("a trajectory of environment {}, which it does not have", fragment.env_index));
  const uint64_t rollout_index = places_.rollout_of(env, fragment.rollout_index);
  const int64_t ahead = places_.ahead(env, rollout_index);
  if (ahead < 0) {
    ++peer.record.duplicates;
    return;
  }
  peer.record.missing += static_cast<uint64_t>(ahead);
  const uint32_t index = peer.reserved.front();
  peer.reserved.pop_front();
  const SlabView slab = arena_.slabs().view(static_cast<int>(index));
  for (int step = 0; step < arena_.shape().trajectory.rollout_steps; ++step) slab.layout_index(step) = 0;
  peer.record.decisions += places_.seal(env, index,
                                        {.rollout_index = rollout_index,
                                         .length = fragment.length,
                                         .layout_id = fragment.layout_id,
                                         .first_episode = {.episode_id = fragment.first_episode_id,
                                                           .episode_seed = fragment.first_episode_seed}});
  ++peer.record.slabs;
}

void TrajectoryReceiver::send_weights_if_due() {
  const auto here = static_cast<std::size_t>(
      std::ranges::count_if(peers_, [](const auto& entry) { return entry.second->record.is_here; }));
  if (here == 0 || !arena_.weights().has_any()) return;
  if (are_weights_sent_ && arena_.weights().version() == weights_version_) return;
  const double now_s = clock_.now_s();
  if (!weights_pace_.is_due(now_s, here)) return;
  // On a bad line a newer version in the place of one that is half there would never let any arrive.
  if (weights_pace_.since_sent_s(now_s) < own_.weights_wait_s && !bus_.has_sent_weights()) return;
  weights_pace_.sent(now_s, weights_.size(), here, 0);  // what fails below is not tried at once again
  const Stopwatch watch;                                // Cyclone writes in this thread
  const auto send = [&]() -> Status {
    COMRAD_TRY_ASSIGN(weights_version_, arena_.weights().read(weights_));
    if (own_.bf16_parameters > 0) {
      std::swap(weights_, as_in_arena_);
      COMRAD_TRY(narrow_weights(as_in_arena_, own_.bf16_parameters, weights_));
    }
    return send_weights(bus_, weights_, weights_version_, own_.bf16_parameters);
  };
  const Status sent = send();
  weights_pace_.sent(now_s, weights_.size(), here, watch.cpu_elapsed());
  are_weights_sent_ = sent.has_value();  // else all of them once more, a little later
  if (!sent && sent.error().code != ErrorCode::kTimeout) spdlog::warn("{}", sent.error().message);
}

}  // namespace comrad::link
