#include "tests/simulation/schedule.h"

#include <charconv>
#include <cstdio>
#include <sstream>

namespace comrad::simulation {
namespace {

struct Word {
  const char* word;
  bool has_place, has_number;
};
// In the order of Verb.
constexpr Word kWords[kVerbs] = {{"wait", false, true},
                                 {"join", true, false},
                                 {"join_again", true, false},
                                 {"play", true, true},
                                 {"ask", true, false},
                                 {"answer", true, false},
                                 {"take", true, false},
                                 {"train", true, false},
                                 {"report", true, false},
                                 {"save", true, false},
                                 {"snapshot", true, false},
                                 {"finish", true, false},
                                 {"leave", true, false},
                                 {"episode", true, true},
                                 {"exit", true, true},
                                 {"die", true, true},
                                 {"hang", true, false},
                                 {"slow", true, true},
                                 {"unstartable", true, false},
                                 {"pause", false, false},
                                 {"resume", false, false},
                                 {"checkpoint", false, false},
                                 {"refused_pause", false, false},
                                 {"refused_resume", false, false},
                                 {"refused_checkpoint", false, false},
                                 {"stop", false, false},
                                 {"interrupt", false, false},
                                 {"terminate", false, false},
                                 {"hang_up", false, false},
                                 {"let_go", false, false}};
constexpr const char* kKinds[] = {"train", "lock_step", "evaluate"};

const Word& word_of(Verb verb) { return kWords[static_cast<std::size_t>(verb)]; }

std::string number_text(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.10g", number);
  return text;
}

bool read_number(const std::string& text, double& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() && number >= 0 && number < 1e9;
}

Expected<Setting> parse_setting(std::istringstream& words) {
  Setting setting;
  std::string kind, word;
  words >> kind;
  bool is_known = false;
  for (int i = 0; i < 3; ++i)
    if (kind == kKinds[i]) setting.kind = static_cast<RunKind>(i), is_known = true;
  if (!is_known) return Error{ErrorCode::kBadFormat, "'" + kind + "' is no kind of run"};
  while (words >> word) {
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals);
    double value = 0;
    if (equals == std::string::npos || !read_number(word.substr(equals + 1), value))
      return Error{ErrorCode::kBadFormat, "'" + word + "' is no name=number"};
    const int count = static_cast<int>(value);
    if (name == "sims" && count >= 1 && count <= 16)
      setting.sims = count;
    else if (name == "policies" && count >= 1 && count <= 16)
      setting.policies = count;
    else if (name == "hosts" && count <= 16)
      setting.hosts = count;
    else if (name == "needed")
      setting.are_needed = count != 0;
    else if (name == "evaluations")
      setting.evaluates = count != 0;
    else if (name == "tick" && value >= 0.01 && value <= 0.25)
      setting.tick_s = value;
    else if (name == "leave")
      setting.leave_s = value;
    else
      return Error{ErrorCode::kBadFormat, "'" + word + "' is no setting of a run"};
  }
  return setting;
}

Expected<Step> parse_step(const std::string& verb, std::istringstream& words, const Setting& setting) {
  Step step;
  int index = 0;
  while (index < kVerbs && verb != kWords[index].word) ++index;
  if (index == kVerbs) return Error{ErrorCode::kBadFormat, "'" + verb + "' is no step"};
  step.verb = static_cast<Verb>(index);
  std::string word;
  if (has_place(step.verb)) {
    words >> word;
    for (int place = 0; place < setting.place_count(); ++place)
      if (word == setting.name(place)) step.place = place;
    if (step.place < 0) return Error{ErrorCode::kBadFormat, "'" + word + "' is no process of this run"};
  }
  if (has_number(step.verb)) {
    word.clear();
    words >> word;
    if (!read_number(word, step.number)) return Error{ErrorCode::kBadFormat, "'" + word + "' is no number"};
  }
  if (words >> word) return Error{ErrorCode::kBadFormat, "'" + word + "' is an unexpected argument"};
  return step;
}

}  // namespace

bool has_place(Verb verb) { return word_of(verb).has_place; }
bool has_number(Verb verb) { return word_of(verb).has_number; }

std::string Setting::name(int place) const {
  if (is_sim(place)) return "sim-" + std::to_string(place);
  if (is_policy(place)) return "policy-" + std::to_string(place - sims);
  if (is_learner(place)) return "learner";
  if (is_host(place)) return "host-" + std::to_string(place - worker_count());
  return "evaluation";
}

std::string text_of(const Step& step, const Setting& setting) {
  std::string text = word_of(step.verb).word;
  if (has_place(step.verb)) text += " " + setting.name(step.place);
  if (has_number(step.verb)) text += " " + number_text(step.number);
  return text;
}

std::string text_of(const Schedule& schedule) {
  const Setting& setting = schedule.setting;
  std::string text =
      std::string("run ") + kKinds[static_cast<std::size_t>(setting.kind)] +
      " sims=" + std::to_string(setting.sims) + " policies=" + std::to_string(setting.policies) +
      " hosts=" + std::to_string(setting.hosts) + " needed=" + (setting.are_needed ? "1" : "0") +
      " evaluations=" + (setting.evaluates ? "1" : "0") + " tick=" + number_text(setting.tick_s) +
      " leave=" + number_text(setting.leave_s) + "\n";
  for (const Step& step : schedule.steps) text += text_of(step, setting) + "\n";
  return text;
}

Expected<Schedule> parse_schedule(std::string_view text) {
  Schedule schedule;
  std::istringstream lines{std::string(text)};
  std::string line;
  bool has_setting = false;
  for (int number = 1; std::getline(lines, line); ++number) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::string verb;
    if (!(words >> verb)) continue;
    const auto at_line = [&](const Error& error) {
      return Error{error.code, "line " + std::to_string(number) + ": " + error.message};
    };
    if (!has_setting) {
      if (verb != "run")
        return at_line({ErrorCode::kBadFormat, "a schedule begins with 'run', not with '" + verb + "'"});
      const Expected<Setting> setting = parse_setting(words);
      if (!setting) return at_line(setting.error());
      schedule.setting = *setting;
      has_setting = true;
      continue;
    }
    const Expected<Step> step = parse_step(verb, words, schedule.setting);
    if (!step) return at_line(step.error());
    schedule.steps.push_back(*step);
  }
  if (!has_setting) return Error{ErrorCode::kBadFormat, "the schedule is empty"};
  return schedule;
}

}  // namespace comrad::simulation
