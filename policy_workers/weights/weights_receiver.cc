#include "policy_workers/weights/weights_receiver.h"

#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::policy {

Expected<bool> WeightsReceiver::refresh(const std::function<Status(std::span<const std::byte>)>& read) {
  const PolicyVersion published = arena_->control().policy_version.load(std::memory_order_acquire);
  if (version_ && *version_ == published) return false;
  if (!arena_->weights().has_any()) return false;
  COMRAD_TRY_ASSIGN(const PolicyVersion version, arena_->weights().read(buffer_));
  if (version_ && *version_ == version) return false;
  COMRAD_TRY(read(buffer_));
  version_ = version;
  return true;
}

}  // namespace comrad::policy
