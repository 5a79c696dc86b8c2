#include "rollout_buffer/link/layout_grants.h"

namespace comrad::link {

void LayoutGrants::grant() {
  if (layout_count_ <= 0) return;
  for (int env = 0; env < arena_.shape().env_count(); ++env) {
    shm::LayoutDesk& desk = arena_.layout_desk(env);
    desk.heard.store(desk.reported.load(std::memory_order_acquire), std::memory_order_relaxed);
    const uint32_t granted = desk.granted.load(std::memory_order_relaxed);
    if (desk.taken.load(std::memory_order_acquire) != granted) continue;
    desk.layout_index.store(draws_.below(static_cast<uint32_t>(layout_count_)), std::memory_order_relaxed);
    desk.granted.store(granted + 1, std::memory_order_release);
  }
}

}  // namespace comrad::link
