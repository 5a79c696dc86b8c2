// A small arena shape and helpers to tamper with segments, for tests of everything that meets in the arena.
#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>

#include "rollout_buffer/shm/arena.h"

namespace comrad::test {

/// Two simulators of four environments, two agents, tiny frames: 100 kB.
inline shm::ArenaShape small_arena_shape() {
  shm::ArenaShape shape;
  shape.trajectory.env = {.num_agents = 2,
                          .channels = 3,
                          .height = 4,
                          .width = 6,
                          .measurement_count = 2,
                          .global_state_count = 3,
                          .head_count = 2};
  shape.trajectory.env.head_sizes = {3, 4};
  shape.trajectory.rollout_steps = 8;
  shape.trajectory.recurrent_state_count = 5;
  shape.trajectory.final_capacity = 4;
  shape.sim_worker_count = 2;
  shape.envs_per_worker = 4;
  shape.splits_per_worker = 2;
  shape.policy_worker_count = 1;
  shape.slab_count = 24;
  shape.journal_steps = 64;
  shape.episode_ring_capacity = 128;
  shape.weights_bytes = 4096;
  return shape;
}

/// A sealed memfd with the first `size_bytes` of `bytes` (zeros beyond): what a hostile peer might hand over.
inline int sealed_copy(const std::byte* bytes, std::size_t byte_count, int64_t size_bytes,
                       int seals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) {
  const int descriptor = memfd_create("comrad-test", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (descriptor < 0 || ftruncate(descriptor, size_bytes) != 0) return -1;
  const std::size_t count = std::min(byte_count, static_cast<std::size_t>(size_bytes));
  if (pwrite(descriptor, bytes, count, 0) != static_cast<ssize_t>(count)) return -1;
  if (seals != 0 && fcntl(descriptor, F_ADD_SEALS, seals) != 0) return -1;
  return descriptor;
}

}  // namespace comrad::test
