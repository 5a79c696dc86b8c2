#include "doomgen/acs/diagnostics.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <tuple>

namespace comrad::acs_compiler {
namespace {
constexpr std::size_t kWarningsMax = 100, kQuotedMax = 40;
}

std::string in_quotes(std::string_view text) {
  std::string result = "\"";
  for (const char c : text.substr(0, kQuotedMax)) result += c >= ' ' && c <= '~' ? c : '?';
  return result + (text.size() > kQuotedMax ? "...\"" : "\"");
}

std::string Diagnostics::where(Place place) const {
  return fmt::format("{}:{}:{}", (place.file < paths_.size() ? paths_[place.file] : std::string("?")),
                     place.line, place.column);
}

void Diagnostics::error(Place place, std::string_view found, std::string_view expected) {
  if (full()) return;
  std::string text = where(place) + ": " + std::string(found);
  if (!expected.empty()) text += "; expected " + std::string(expected);
  // Reports one cause once.
  if (std::none_of(errors_.begin(), errors_.end(), [&](const auto& other) { return other.second == text; }))
    errors_.emplace_back(place, std::move(text));
}

void Diagnostics::warn(Place place, std::string_view text) {
  if (warnings_.size() < kWarningsMax) warnings_.push_back(where(place) + ": " + std::string(text));
}

Error Diagnostics::to_error() const {
  std::string text;
  auto errors = errors_;
  std::stable_sort(errors.begin(), errors.end(), [](const auto& a, const auto& b) {
    return std::tie(a.first.file, a.first.line, a.first.column) <
           std::tie(b.first.file, b.first.line, b.first.column);
  });
  for (const auto& [place, error] : errors) text += (text.empty() ? "" : "\n") + error;
  if (full() && errors_max_ > 1) text += "\ntoo many errors; the rest of the source was not looked at";
  return {ErrorCode::kBadFormat, std::move(text)};
}

}  // namespace comrad::acs_compiler
