#include "deploy/tools/test_report.h"

#include <algorithm>
#include <cstdlib>

namespace comrad::deploy {
namespace {

/// Takes the next line off `text`.
std::string_view next_line(std::string_view& text) {
  const size_t end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return line;
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }

size_t digits(std::string_view line, size_t begin) {
  while (begin < line.size() && is_digit(line[begin])) ++begin;
  return begin;
}

/// What `test` printed, as ctest's log keeps it: from "Output:" and its rule to "<end of output>".
std::string_view output_of(std::string_view log, std::string_view test) {
  bool is_test = false;
  while (!log.empty()) {
    const std::string_view line = next_line(log);
    // " 7/63 Test: name": the number is padded to the width of the last one.
    const size_t number = std::min(line.find_first_not_of(' '), line.size());
    if (const size_t mark = line.find(" Test: "); mark != line.npos && digits(line, number) > number)
      is_test = line.substr(mark + 7) == test;
    if (!is_test || line != "Output:") continue;
    next_line(log);
    const size_t end = log.find("<end of output>");
    return log.substr(0, end);
  }
  return {};
}

}  // namespace

std::string_view skipped_test(std::string_view line) {
  const size_t verdict = line.find("***Skipped"), number = line.find(" Test ");
  if (verdict == line.npos || number == line.npos || number > verdict) return {};
  const size_t colon = line.find(": ", number);
  if (colon == line.npos || colon > verdict) return {};
  std::string_view name = line.substr(colon + 2, verdict - colon - 2);
  return name.substr(0, name.find(' '));
}

bool is_closing_line(std::string_view line) {
  const size_t end = digits(line, 0);
  return (end > 0 && line.substr(end).starts_with("% tests passed")) ||
         line.starts_with("No tests were found");
}

std::vector<std::string> skip_reasons(std::string_view log, std::string_view test) {
  constexpr std::string_view kRun = "[ RUN      ] ", kSkip = "[  SKIPPED ] ";
  std::vector<std::string> reasons;
  std::string_view output = output_of(log, test), running_case, last_line;
  std::string reason;
  bool in_reason = false;
  while (!output.empty()) {
    const std::string_view line = next_line(output);
    if (line.starts_with(kRun)) {
      running_case = line.substr(kRun.size());
      reason.clear();
      in_reason = false;
    } else if (line.starts_with(kSkip) && line.ends_with(" ms)")) {
      reasons.push_back(std::string(running_case) + ": " + (reason.empty() ? "no reason given" : reason));
    } else if (line.ends_with(": Skipped")) {
      in_reason = true;
    } else if (in_reason && !line.empty()) {
      reason += (reason.empty() ? "" : " ") + std::string(line);
    }
    if (!line.empty()) last_line = line;
  }
  if (reasons.empty()) reasons.emplace_back(last_line.empty() ? "no reason given" : last_line);
  return reasons;
}

std::optional<TestTime> test_time(std::string_view line) {
  const size_t number = line.find(" Test "), colon = line.find(": ", number), end = line.rfind(" sec");
  if (number == line.npos || colon == line.npos || end == line.npos || end < colon) return std::nullopt;
  const std::string_view name = line.substr(colon + 2);
  const std::string seconds(line.substr(line.rfind(' ', end - 1) + 1, end));
  char* rest = nullptr;
  TestTime time{std::string(name.substr(0, name.find(' '))), std::strtod(seconds.c_str(), &rest)};
  if (rest == seconds.c_str()) return std::nullopt;
  return time;
}

std::vector<std::string> allowed_words(std::string_view page) {
  std::vector<std::string> words;
  while (!page.empty()) {
    std::string_view line = next_line(page);
    if (!line.starts_with('|') || !line.ends_with('|')) continue;
    line.remove_suffix(1);
    line.remove_prefix(line.rfind('|'));
    for (size_t begin; (begin = line.find('`')) != line.npos;) {
      line.remove_prefix(begin + 1);
      const size_t end = std::min(line.find('`'), line.size());
      words.emplace_back(line.substr(0, end));
      line.remove_prefix(std::min(end + 1, line.size()));
    }
  }
  return words;
}

bool is_allowed(std::string_view reason, const std::vector<std::string>& words) {
  return std::ranges::any_of(words, [&](const std::string& one) { return reason.find(one) != reason.npos; });
}

}  // namespace comrad::deploy
