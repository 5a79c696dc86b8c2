#include "rollout_buffer/bench/frame_link.h"

#include <atomic>
#include <cstdlib>
#include <utility>

#include "rollout_buffer/link/frames/frame_receiver.h"
#include "rollout_buffer/link/frames/frame_sender.h"

namespace comrad::bench {
namespace {

const std::atomic<bool> kNever{false};

dds::BusConfig config_of(const BenchedLink& link, const char* whose) {
  dds::BusConfig config = dds::link_config(link.id);
  if (!link.keys.empty()) config.key_folder = link.keys + whose;
  return config;
}

}  // namespace

Status check_link(const BenchedLink& link) {
  for (const char* whose : {"/run", "/hosts/bench"}) COMRAD_TRY(dds::validate(config_of(link, whose)));
  return {};
}

void receive(const shm::Arena& arena, const BenchedLink& link) {
  Expected<dds::LinkBus> bus = dds::LinkBus::open(config_of(link, "/run"));
  if (!bus) return std::abort();
  link::FrameReceiver receiver(arena, std::move(*bus), {.worker_count = arena.shape().sim_worker_count});
  (void)receiver.run(kNever);
}

SentFrames send(const shm::Arena& arena, const BenchedLink& link) {
  Expected<dds::LinkBus> bus = dds::LinkBus::open(config_of(link, "/hosts/bench"));
  if (!bus) std::abort();
  link::FrameSenderOptions options;
  options.peer_id = 1;
  options.host = "bench";
  if (link.compression != "auto")
    options.compression = link.compression == "lz4" ? link::Compression::kAlways : link::Compression::kNever;
  link::FrameSender sender(arena, std::move(*bus), options);
  (void)sender.run(kNever);
  const link::FrameAccount account = *sender.frames();
  return {account.decisions, account.raw_bytes, account.sent_bytes, account.resent, account.is_compressed};
}

}  // namespace comrad::bench
