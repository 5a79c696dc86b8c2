#include "rollout_buffer/settings/reference_scores.h"

#include <spdlog/fmt/fmt.h>

#include <toml++/toml.h>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/toml_text.h"

namespace comrad {

Expected<std::optional<ReferenceScores>> find_reference_scores(std::string_view text,
                                                               const std::string& label,
                                                               const std::string& scenario,
                                                               int64_t num_agents) {
  using Found = std::optional<ReferenceScores>;
  COMRAD_TRY(check_toml_text(text, label));
  try {
    const toml::table document = toml::parse(text, label);
    const toml::table* scores = document[scenario].as_table();
    if (scores == nullptr || (*scores)["num_agents"].value<int64_t>() != num_agents) return Found();
    const auto random = (*scores)["random"].value<double>(), scripted = (*scores)["scripted"].value<double>();
    if (!random || !scripted || !(*scripted > *random))
      return Error{ErrorCode::kBadFormat,
                   label + ": " + scenario + " needs numbers 'random' and 'scripted', the second the larger"};
    return Found({.random = *random, .scripted = *scripted});
  } catch (const toml::parse_error& failure) {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: {}", label, failure.source().begin.line,
                                                    failure.source().begin.column, failure.description())};
  }
}

Expected<std::optional<ReferenceScores>> read_reference_scores(const std::string& scenario,
                                                               int64_t num_agents) {
  const std::string path = data_dir() + "/scenarios/reference_scores.toml";
  const std::optional<std::string> text = read_file(path);
  if (!text) return std::optional<ReferenceScores>();
  return find_reference_scores(*text, path, scenario, num_agents);
}

}  // namespace comrad
