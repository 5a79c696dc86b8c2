#include "policy_workers/weights/weights_receiver.h"

#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/weight_buffers.h"

namespace comrad::policy {

bool WeightsReceiver::has_any() const {
  return local_ != nullptr ? local_->version().has_value() : arena_->weights().has_any();
}

Expected<bool> WeightsReceiver::refresh(const ActorCritic& policy) {
  if (local_ == nullptr)
    return refresh([&policy](std::span<const std::byte> bytes) { return policy.read_weights(bytes); });
  if (version_ == local_->version()) return false;
  version_ = local_->read(policy.weight_tensors());
  policy.state_changed();
  return true;
}

Expected<bool> WeightsReceiver::refresh(const std::function<Status(std::span<const std::byte>)>& read) {
  if (!has_any() || version_ == arena_->weights().version()) return false;
  COMRAD_TRY_ASSIGN(const PolicyVersion version, arena_->weights().read(buffer_));
  if (version_ && *version_ == version) return false;
  COMRAD_TRY(read(buffer_));
  count_copied(buffer_.size());
  version_ = version;
  return true;
}

}  // namespace comrad::policy
