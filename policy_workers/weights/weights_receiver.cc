#include "policy_workers/weights/weights_receiver.h"

#include <algorithm>
#include <string>

namespace comrad::policy {

Expected<bool> WeightsReceiver::refresh(const PolicyNet& policy) {
  const PolicyVersion published = arena_->control().policy_version.load(std::memory_order_acquire);
  if (version_ && *version_ == published) return false;
  if (!arena_->has_weights()) return false;
  COMRAD_TRY_ASSIGN(const PolicyVersion version, arena_->read_weights(buffer_));
  if (version_ && *version_ == version) return false;
  COMRAD_TRY(policy.read_weights(buffer_));
  version_ = version;
  return true;
}

Status WeightsReceiver::hear(const dds::WeightsUpdate& update, const PolicyNet& policy) {
  announced_ = std::max(announced_, update.version);
  if (update.bytes != 0 && update.bytes != static_cast<uint64_t>(policy.weights_bytes()))
    return Error{ErrorCode::kBadFormat, "the learner announces weights of " + std::to_string(update.bytes) +
                                            " bytes, this network has " +
                                            std::to_string(policy.weights_bytes())};
  return {};
}

uint32_t WeightsReceiver::behind() const {
  const PolicyVersion newest =
      std::max(announced_, arena_->control().policy_version.load(std::memory_order_acquire));
  return version_ && newest > *version_ ? newest - *version_ : 0;
}

}  // namespace comrad::policy
