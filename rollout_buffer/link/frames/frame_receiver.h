// The end of the frame link on the host with the policy: on its arena it stands where simulators stand. Rows of other
// hosts' simulators are written into free slabs, committed, answered by this host's policy workers as any other, and the
// whole slab is sealed when the simulator has sealed its own; so neither policy workers nor the learner know of the link.
// Stages: acquire, commit, seal.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "rollout_buffer/link/frames/frame_stream.h"
#include "rollout_buffer/link/session/serving_end.h"

namespace comrad::link {

/// Bounded: a host has one request under way for each environment, and may begin no more trajectories than there are
/// slabs for. Threads: one.
class FrameReceiver final : public ServingEnd {
 public:
  /// `kind` and `flag` of the options are the receiver's own.
  FrameReceiver(const shm::Arena& arena, dds::LinkBus bus, ServingOptions options,
                const Clock& clock = kMachineClock);
  void begin() override;

 private:
  /// A copy of a simulator's slab, to be sealed when the simulator has sealed its own.
  struct Copy {
    uint32_t slab = 0;
    RemoteRollout rollout;  ///< its index is that of the simulators' host
  };
  /// One environment of another host, and the slab in which it plays here.
  struct Mirror {
    int env = 0;  ///< of this arena
    bool has_slab = false, is_out = false, is_answered = false;
    bool is_whole = false;       ///< every row of the slab was seen, from the first one on
    uint32_t counted_epoch = 0;  ///< in which its first row was counted as begun
    Copy copy;                   ///< in the making
    FrameRequest request;        ///< the newest
    FrameAnswer answer;
    std::vector<int32_t> choices;  ///< of `answer`
    std::deque<Copy> whole;        ///< copies
    std::deque<std::pair<uint64_t, bool>>
        answered;  ///< rollouts, and whether they were sealed: requested again, reported again
  };
  struct FramePeer final : Peer {
    std::vector<Mirror> mirrors;  ///< by the host's own environment index
    uint64_t next_batch = 0;
    std::vector<std::byte> payload;
  };

  bool take_all() override;
  void drop_all() override;
  void wait() override;
  Status send_state(Peer& peer, const dds::PeerState& state) override;
  std::unique_ptr<Peer> make_peer() const override { return std::make_unique<FramePeer>(); }
  void opened(Peer& peer) override;
  void renewed(Peer& peer) override { static_cast<FramePeer&>(peer).next_batch = 0; }
  void closing(Peer& peer) override;
  std::size_t wanted_slabs(const Peer& peer) const override;
  bool has_news(const Peer& peer) const override {
    return !static_cast<const FramePeer&>(peer).payload.empty();
  }

  void take(FramePeer& peer, const dds::FrameBatch& batch);
  void mirror(FramePeer& peer, const FrameRequest& request, const FrameUnpacker& frames);
  bool begin_slab(FramePeer& peer, Mirror& mirror, const FrameRequest& request);
  void abandon(FramePeer& peer, Mirror& mirror);
  bool collect();
  void finish(FramePeer& peer, Mirror& mirror);
  void answer(FramePeer& peer, const FrameAnswer& given, std::span<const int32_t> choices);
  void confirm(FramePeer& peer, Mirror& mirror, const FrameRequest& request);
  bool seal(FramePeer& peer, const Mirror& mirror, const Copy& copy);
  void lose(FramePeer& peer, const Copy& copy);
  void count_lost(FramePeer& peer, uint64_t steps) const;
  shm::Doorbell& acted() const;

  std::vector<std::byte> raw_;
  std::vector<uint32_t> round_;  ///< requests of each split in the batch under way
  int out_count_ = 0;
  int waiting_for_ = -1;  ///< a split that is being answered
  uint32_t heard_acted_ = 0;
};

}  // namespace comrad::link
