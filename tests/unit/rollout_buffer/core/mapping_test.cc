#include "rollout_buffer/core/mapping.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <utility>

namespace comrad {
namespace mapping_test {

constexpr int64_t kPage = 4096;

Mapping anonymous_memory() {
  Mapping mapping;
  mapping.descriptor = memfd_create("mapping_test", MFD_CLOEXEC);
  EXPECT_EQ(ftruncate(mapping.descriptor, kPage), 0);
  mapping.data = static_cast<std::byte*>(
      mmap(nullptr, kPage, PROT_READ | PROT_WRITE, MAP_SHARED, mapping.descriptor, 0));
  mapping.size_bytes = kPage;
  return mapping;
}

bool is_open(int descriptor) { return fcntl(descriptor, F_GETFD) >= 0; }
bool is_mapped(std::byte* page) { return msync(page, kPage, MS_ASYNC) == 0; }

TEST(Mapping, GivesMemoryAndDescriptorBack) {
  int descriptor = -1;
  std::byte* data = nullptr;
  {
    const Mapping mapping = anonymous_memory();
    descriptor = mapping.descriptor;
    data = mapping.data;
    EXPECT_TRUE(is_open(descriptor));
    EXPECT_TRUE(is_mapped(data));
  }
  EXPECT_FALSE(is_open(descriptor));
  EXPECT_FALSE(is_mapped(data));
}

TEST(Mapping, MovesAndKeepsWhatItHeldUntilItsEnd) {
  int first = -1, second = -1;
  {
    Mapping one = anonymous_memory();
    Mapping other = anonymous_memory();
    first = one.descriptor;
    second = other.descriptor;
    one = std::move(other);
    EXPECT_EQ(one.descriptor, second);
    one.data[kPage - 1] = std::byte{7};
    const Mapping last(std::move(one));
    EXPECT_EQ(last.descriptor, second);
    EXPECT_EQ(last.data[kPage - 1], std::byte{7});
    EXPECT_EQ(one.data, nullptr);  // NOLINT(bugprone-use-after-move): a moved-from one owns nothing
    EXPECT_EQ(one.descriptor, -1);
  }
  EXPECT_FALSE(is_open(first));
  EXPECT_FALSE(is_open(second));
}

}  // namespace mapping_test
}  // namespace comrad
