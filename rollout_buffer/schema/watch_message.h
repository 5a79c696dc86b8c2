// What a simulator sends to the process that shows it (`comrad watch`, `comrad play`): a head, then its bytes. Answers are commands,
// one JSON object a line.
#pragma once

#include <cstdint>
#include <cstring>
#include <string_view>

namespace comrad {

/// What a message's bytes are: words are a JSON object; agent i's picture is a JPEG of kind kPicture + i.
enum class WatchKind : uint8_t { kWords = 0, kPicture = 1 };

/// In the byte order of this machine, which both ends share.
struct WatchHead {
  uint32_t bytes = 0;  ///< behind the head
  uint8_t kind = 0;    ///< WatchKind
  uint8_t unused[3] = {};
};
static_assert(sizeof(WatchHead) == 8);

/// A longer message is none.
constexpr uint32_t kWatchMessageBytesMax = 4u << 20;
/// A longer command is none.
constexpr std::size_t kWatchCommandBytesMax = 4096;

}  // namespace comrad
