#include "rollout_buffer/core/mapping.h"

#include <sys/mman.h>
#include <unistd.h>

#include <utility>

namespace comrad {

Mapping::Mapping(Mapping&& other) noexcept
    : data(std::exchange(other.data, nullptr)),
      size_bytes(std::exchange(other.size_bytes, 0)),
      descriptor(std::exchange(other.descriptor, -1)) {}

Mapping& Mapping::operator=(Mapping&& other) noexcept {
  std::swap(data, other.data);
  std::swap(size_bytes, other.size_bytes);
  std::swap(descriptor, other.descriptor);
  return *this;
}

Mapping::~Mapping() {
  if (data != nullptr) munmap(data, static_cast<std::size_t>(size_bytes));
  if (descriptor >= 0) close(descriptor);
}

}  // namespace comrad
