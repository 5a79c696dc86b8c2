// Names in Doom's data compare without case. Stage: loading.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace comrad::doom {

constexpr char lower_case(char letter) {
  return letter >= 'A' && letter <= 'Z' ? static_cast<char>(letter - 'A' + 'a') : letter;
}

inline std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& letter : lower) letter = lower_case(letter);
  return lower;
}

constexpr bool same_ignoring_case(std::string_view left, std::string_view right) {
  if (left.size() != right.size()) return false;
  for (std::size_t place = 0; place < left.size(); ++place)
    if (lower_case(left[place]) != lower_case(right[place])) return false;
  return true;
}

}  // namespace comrad::doom
