// Reads texts such as checkpoint_<version>_<env_frames>.pt from the left. Stage: beside the flow.
#pragma once

#include <charconv>
#include <cstdint>
#include <string_view>
#include <system_error>

namespace comrad {

/// Parses "<prefix><number>..." and moves `text` behind it. False where it does not begin so; `text` is then of no use.
inline bool take_number(std::string_view& text, std::string_view prefix, uint64_t& number) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (code != std::errc()) return false;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return true;
}

}  // namespace comrad
