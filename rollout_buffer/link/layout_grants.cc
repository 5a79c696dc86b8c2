#include "rollout_buffer/link/layout_grants.h"

#include "rollout_buffer/shm/layout_mailbox.h"

namespace comrad::link {

void LayoutGrants::grant() {
  if (layout_count_ <= 0) return;
  for (int env = 0; env < arena_.shape().env_count(); ++env) {
    shm::LayoutMailbox& mailbox = arena_.layout_mailboxes().of(env);
    if (mailbox.is_due()) mailbox.assign(draws_.below(static_cast<uint32_t>(layout_count_)));
  }
}

}  // namespace comrad::link
