// Words of people and files: names compare without case, and a mistyped one gets a suggestion. Letters are
// those of ASCII whatever the locale; other bytes stay as they are. Stage: loading and messages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace comrad {

constexpr char lower_case(char letter) {
  return letter >= 'A' && letter <= 'Z' ? static_cast<char>(letter - 'A' + 'a') : letter;
}
constexpr char upper_case(char letter) {
  return letter >= 'a' && letter <= 'z' ? static_cast<char>(letter - 'a' + 'A') : letter;
}
std::string lower_case(std::string_view text);
std::string upper_case(std::string_view text);

/// Neither text is copied.
constexpr bool same_ignoring_case(std::string_view left, std::string_view right) {
  if (left.size() != right.size()) return false;
  for (std::size_t place = 0; place < left.size(); ++place)
    if (lower_case(left[place]) != lower_case(right[place])) return false;
  return true;
}

/// Space, tab, and what ends a line or a page.
constexpr bool is_space(char letter) { return letter == ' ' || (letter >= '\t' && letter <= '\r'); }

/// Whether the bytes are UTF-8 (Unicode 15, table 3-7: no overlong forms, no surrogates, at most U+10FFFF).
bool is_utf8(std::string_view text);

/// The text without the space before and after it.
std::string_view trimmed(std::string_view text);

/// "20.0 MB", "1.5 GB".
std::string bytes_text(int64_t bytes);

/// The shortest decimal that reads back as the same value: "0.9995", "4e-04", "2.0", "inf", "nan". A whole number keeps
/// a ".0", so that TOML reads it as a real one.
std::string real_text(double value);

/// The finite number that the text is, as 0.5, +1 or 4e-4, with space around it; none for anything else.
std::optional<double> read_real(std::string_view text);

/// The text as one word of a shell, in quotes where something in it is special.
std::string shell_word(std::string_view text);

/// How many typing errors lie between two words: the optimal string alignment distance. A letter too many, a
/// letter missing, a wrong letter and two neighbours swapped count one each, and no part of a word is edited
/// twice (so "ca" to "abc" is 3, where the unrestricted Damerau-Levenshtein distance is 2). Case counts.
std::size_t edit_distance(std::string_view a, std::string_view b);

/// The word among `known` that `word` was most likely meant to be, in any case; empty when none is close. The
/// first of several that are as close.
std::string nearest_word(std::string_view word, const std::vector<std::string>& known);

/// "; did you mean 'rollout'?", the end of a message about a word that is not among `known`; empty when none is close.
std::string did_you_mean(std::string_view word, const std::vector<std::string>& known);

/// "a, b, c".
std::string joined(const std::vector<std::string>& words);

/// The same of any words or whole numbers, with any `separator` between them.
template <typename Items>
std::string joined(const Items& items, std::string_view separator = ", ") {
  std::string text;
  bool is_first = true;
  for (const auto& item : items) {
    if (!is_first) text += separator;
    is_first = false;
    if constexpr (std::is_convertible_v<decltype(item), std::string_view>)
      text += std::string_view(item);
    else
      text += std::to_string(item);
  }
  return text;
}

/// "unknown algorithm 'ipo'; did you mean 'ippo'? (known: ippo, mappo)".
std::string unknown_word(std::string_view what, std::string_view word, const std::vector<std::string>& known);

}  // namespace comrad
