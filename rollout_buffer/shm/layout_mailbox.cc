#include "rollout_buffer/shm/layout_mailbox.h"

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {

void LayoutMailbox::take_assignment() {
  const uint32_t newest = assigned.load(std::memory_order_acquire);
  if (newest == taken.load(std::memory_order_relaxed)) {
    late.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  playing.store(layout_index.load(std::memory_order_relaxed), std::memory_order_relaxed);
  taken.store(newest, std::memory_order_release);
}

void LayoutMailbox::assign(uint32_t layout_index_of_pool) {
  layout_index.store(layout_index_of_pool, std::memory_order_relaxed);
  assigned.fetch_add(1, std::memory_order_release);
}

LayoutMailboxes::LayoutMailboxes(const ArenaShape& shape, Region& region)
    : count_(shape.env_count()), mailboxes_(region.take<LayoutMailbox>(count_)) {}

LayoutMailbox& LayoutMailboxes::of(int env_index) const {
  return element(mailboxes_, env_index, count_, "environment index is in range");
}

}  // namespace comrad::shm
