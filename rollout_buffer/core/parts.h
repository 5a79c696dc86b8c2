// Lists in one text: "a,b,c". Stage: loading.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

namespace comrad {

/// The parts of "a,b,c" between separators, in order; empty ones are left out.
inline std::vector<std::string> parts_of(std::string_view text, char separator) {
  std::vector<std::string> parts;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(separator), text.size());
    if (end > 0) parts.emplace_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return parts;
}

}  // namespace comrad
