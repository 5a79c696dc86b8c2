// The end of the trajectory link on the learner's host: slabs of other hosts are put together in free ones of its arena,
// checked, and sealed as a simulator seals its own; so nothing behind `seal` depends on the link. Stages: acquire, seal.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "rollout_buffer/link/join/endpoint.h"
#include "rollout_buffer/link/session/serving_end.h"
#include "rollout_buffer/link/trajectories/slab_stream.h"
#include "rollout_buffer/link/trajectories/weights_pace.h"
#include "rollout_buffer/link/trajectories/weights_stream.h"

namespace comrad::link {

struct TrajectoryReceiverOptions {
  int first_worker = 0;       ///< simulators of the arena from this one on are played by other hosts
  Offer offer;                ///< what hosts that join receive
  int window = 4;             ///< slabs that are kept free for each host, its credits
  double silent_after_s = 5;  ///< as ServingOptions
  std::size_t most_peers = kMostPeers;
  WeightsLimits weights = {};  ///< how often versions go to other hosts
  uint64_t bf16_parameters =
      0;  ///< so many parameters are sent as bfloat16, the statistics behind them as f32; 0: all as they are
  double weights_wait_s =
      3;  ///< a version has so long to reach every host before a newer one takes its place
};

/// Exactly once: a slab is known by its host, environment and rollout index. How far each environment came is in
/// the arena, so a receiver that is killed and starts again takes no slab twice. Threads: one.
class TrajectoryReceiver final : public ServingEnd {
 public:
  TrajectoryReceiver(const shm::Arena& arena, dds::LinkBus bus, const TrajectoryReceiverOptions& options,
                     const Clock& clock = kMachineClock);

 private:
  struct SlabPeer final : Peer {
    explicit SlabPeer(const SlabOffsets& offsets) : assembler(offsets) {}
    SlabAssembler assembler;
    bool is_assembling = false;
  };

  bool take_all() override;
  void drop_all() override;
  Status send_state(Peer& peer, const dds::PeerState& state) override;
  std::unique_ptr<Peer> make_peer() const override;
  void opened(Peer& peer) override { renewed(peer); }
  void renewed(Peer& peer) override { static_cast<SlabPeer&>(peer).is_assembling = false; }
  void gave_back(Peer& peer) override { renewed(peer); }
  std::size_t wanted_slabs(const Peer&) const override { return static_cast<std::size_t>(own_.window); }

  void take(const dds::TrajectoryFragment& fragment);
  void seal(SlabPeer& peer, const dds::TrajectoryFragment& fragment);
  void send_weights_if_due();

  const TrajectoryReceiverOptions own_;
  const JoinEndpoint endpoint_;
  std::vector<std::byte> weights_, as_in_arena_;
  PolicyVersion weights_version_ = 0;
  bool are_weights_sent_ = false;
  WeightsPace weights_pace_;
};

}  // namespace comrad::link
