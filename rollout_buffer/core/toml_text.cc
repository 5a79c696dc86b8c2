#include "rollout_buffer/core/toml_text.h"

#include <spdlog/fmt/fmt.h>

#include <cstddef>

#include <algorithm>

#include "rollout_buffer/core/text.h"

namespace comrad {

std::optional<std::string> toml_scalar_text(const toml::node& node) {
  if (const auto* value = node.as_string()) return value->get();
  if (const auto* value = node.as_integer()) return std::to_string(value->get());
  if (const auto* value = node.as_floating_point()) return real_text(value->get());
  if (const auto* value = node.as_boolean()) return value->get() ? "true" : "false";
  return std::nullopt;
}

namespace {

/// Where the string that begins at text[at] ends: the place behind its last quote. One that is left open ends with
/// its line, or with the text where three quotes began it; toml++ reports it.
std::size_t end_of_toml_string(std::string_view text, std::size_t at) {
  const char quote = text[at];
  const std::string three(3, quote);
  const bool is_long = text.substr(at, 3) == three;
  for (std::size_t i = at + (is_long ? 3 : 1); i < text.size(); ++i) {
    if (text[i] == '\\' && quote == '"') {
      ++i;
    } else if (is_long ? text.substr(i, 3) == three : text[i] == quote) {
      return i + (is_long ? 3 : 1);
    } else if (text[i] == '\n' && !is_long) {
      return i;
    }
  }
  return text.size();
}

/// A key of thousands of parts makes as many tables in one another, and taking those down overflows the stack.
Status check_toml_depth(std::string_view text, const std::string& label) {
  constexpr int kPartsMax = 64;
  int dots = 0;
  std::size_t line = 1, line_begin = 0;
  const auto count_line = [&](std::size_t newline) { ++line, line_begin = newline + 1; };
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '"' || c == '\'') {
      const std::size_t end = end_of_toml_string(text, i);
      for (; i < end; ++i)
        if (text[i] == '\n') count_line(i);
      continue;
    }
    if (c == '#') {
      i = std::min(text.find('\n', i), text.size());
      continue;
    }
    if (c == '.' && ++dots > kPartsMax)
      return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: a key of more than {} parts", label, line,
                                                      i - line_begin + 1, kPartsMax)};
    if (std::string_view("=,[]{}\n").find(c) != std::string_view::npos) dots = 0;
    if (c == '\n') count_line(i);
    ++i;
  }
  return {};
}

/// toml++ 3.3 assumes, unchecked in release builds, that a table's header continues with a key.
Status check_toml_headers(std::string_view text, const std::string& label) {
  const auto byte_at = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const auto is_blank = [](unsigned char c) {
    return c <= ' ' || c >= 0x7F;
  };                     // some of these are blanks to toml++
  bool at_start = true;  // nothing but blanks since the line began
  std::size_t line = 1, line_begin = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const unsigned char c = byte_at(i);
    if (c == '\n') ++line, line_begin = i + 1;
    if (c == '\n' || c == '\r' || c == '\v' || c == '\f') at_start = true;
    if (is_blank(c)) continue;
    if (c == '[' && at_start) {
      std::size_t key = i + 1;
      const auto skip_blanks = [&] {
        while (key < text.size() && (text[key] == ' ' || text[key] == '\t')) ++key;
      };
      skip_blanks();
      if (key < text.size() && text[key] == '[') ++key;
      skip_blanks();
      const unsigned char first =
          key < text.size() ? byte_at(key) : 'x';  // the end: toml++ reports that itself
      const bool is_key = (first >= 'a' && first <= 'z') || (first >= 'A' && first <= 'Z') ||
                          (first >= '0' && first <= '9') || first == '_' || first == '-' || first == '"' ||
                          first == '\'' || first == ']';
      if (!is_key)
        return Error{
            ErrorCode::kBadFormat,
            fmt::format("{}:{}:{}: a table's name begins with a letter, a digit, '_', '-' or a quote", label,
                        line, key - line_begin + 1)};
    }
    at_start = false;
  }
  return {};
}

}  // namespace

Status check_toml_text(std::string_view text, const std::string& label) {
  COMRAD_TRY(check_toml_depth(text, label));
  return check_toml_headers(text, label);
}

}  // namespace comrad
