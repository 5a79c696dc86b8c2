#include "sim_workers/env/map_info.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>
#include <set>

#include "rollout_buffer/core/text.h"

namespace comrad::sim {
namespace {

struct Token {
  std::string text;  ///< a sign, a word in lower case or a text
  int line = 0;
  bool is_text = false;
  bool is(std::string_view sign) const { return !is_text && text == sign; }
};

std::vector<Token> tokens_of(std::string_view text) {
  std::vector<Token> tokens;
  int line = 1;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    const std::string_view rest = text.substr(i);
    if (c == '\n') ++line;
    if (rest.starts_with("//") || c == ';') {
      i = std::min(text.find('\n', i), text.size());
    } else if (rest.starts_with("/*")) {
      const std::size_t end = std::min(text.find("*/", i), text.size());
      line += static_cast<int>(std::ranges::count(text.substr(i, end - i), '\n'));
      i = std::min(end + 2, text.size());
    } else if (c == '"') {
      const std::size_t end = std::min(text.find('"', i + 1), text.size());
      tokens.push_back({std::string(text.substr(i + 1, end - i - 1)), line, true});
      line += static_cast<int>(std::ranges::count(text.substr(i, end - i), '\n'));
      i = std::min(end + 1, text.size());
    } else if (c == '{' || c == '}' || c == '=' || c == ',') {
      tokens.push_back({std::string(1, c), line});
      ++i;
    } else if (static_cast<unsigned char>(c) <= ' ') {
      ++i;
    } else {
      const std::size_t end = std::min(text.find_first_of(" \t\r\n\"{}=,;", i), text.size());
      tokens.push_back({lower_case(text.substr(i, end - i)), line});
      i = end;
    }
  }
  return tokens;
}

template <std::size_t N>
bool is_one_of(const std::array<std::string_view, N>& names, std::string_view name) {
  return std::ranges::find(names, name) != names.end();
}

constexpr std::array<std::string_view, 9> kBlocks = {"map",          "defaultmap", "adddefaultmap",
                                                     "gamedefaults", "gameinfo",   "skill",
                                                     "cluster",      "clusterdef", "episode"};
/// Blocks and keys of stories, menus, sounds and pictures.
constexpr std::array<std::string_view, 6> kIdleBlocks = {"cluster",       "clusterdef",  "episode",
                                                         "clearepisodes", "clearskills", "intermission"};
constexpr std::array<std::string_view, 31> kIdleKeys = {"levelnum",
                                                        "next",
                                                        "secretnext",
                                                        "secret",
                                                        "music",
                                                        "intermusic",
                                                        "sky1",
                                                        "sky2",
                                                        "skybox",
                                                        "cluster",
                                                        "par",
                                                        "sucktime",
                                                        "titlepatch",
                                                        "author",
                                                        "entertext",
                                                        "exittext",
                                                        "exitpic",
                                                        "enterpic",
                                                        "nointermission",
                                                        "cdtrack",
                                                        "fade",
                                                        "outsidefog",
                                                        "lightning",
                                                        "evenlighting",
                                                        "smoothlighting",
                                                        "forcenoskystretch",
                                                        "skystretch",
                                                        "bordertexture",
                                                        "f1",
                                                        "redirect",
                                                        "doublesky"};

class Reader {
 public:
  Reader(std::string_view text, const std::string& label, std::string_view map, MapInfo* info,
         std::vector<std::string>* warnings)
      : tokens_(tokens_of(text)), label_(label), map_(lower_case(map)), info_(info), warnings_(warnings) {}

  void read() {
    while (!at_end()) {
      const std::string name = next().text;
      if (name == "map" && !at_end()) {
        const bool is_ours = lower_case(next().text) == map_;
        if (!at_end() && peek().is("lookup")) at_ = std::min(at_ + 2, tokens_.size());
        while (!at_end() && !starts_block() && !peek().is("{") && peek().is_text) next();  // its title
        block(is_ours);
      } else if (name == "defaultmap" || name == "adddefaultmap") {
        block(/*counts=*/true);
      } else if (name == "gameinfo") {
        block(true);
      } else if (is_one_of(kIdleBlocks, name) || name == "}") {
        skip_block();
      } else {
        warn(name);
        skip_block();
      }
    }
  }

 private:
  bool at_end() const { return at_ >= tokens_.size(); }
  const Token& peek() const { return tokens_[at_]; }
  const Token& next() { return tokens_[at_++]; }
  bool starts_block() const {
    return !peek().is_text && is_one_of(kBlocks, peek().text) && is_first_of_line();
  }
  bool is_first_of_line() const { return at_ == 0 || tokens_[at_ - 1].line != tokens_[at_].line; }

  /// Of one property: the tokens behind '=', or of its line in Hexen's form.
  std::vector<std::string> values(bool has_braces) {
    std::vector<std::string> found;
    const int line = tokens_[at_ - 1].line;
    if (!at_end() && peek().is("=")) {
      next();
      while (!at_end() && !peek().is("}")) {
        found.push_back(next().text);
        if (at_end() || !peek().is(",")) break;
        next();
      }
    } else if (!has_braces) {
      while (!at_end() && peek().line == line) found.push_back(next().text);
    }
    return found;
  }

  void block(bool counts) {
    const bool has_braces = !at_end() && peek().is("{");
    if (has_braces) next();
    while (!at_end()) {
      if (has_braces && peek().is("}")) return void(next());
      if (!has_braces && starts_block()) return;
      const std::string key = next().text;
      if (key == "{") {  // of a key that is not known
        --at_;
        skip_block();
        continue;
      }
      const std::vector<std::string> given = values(has_braces);
      if (counts) take(key, given);
    }
  }

  void skip_block() {
    while (!at_end() && !peek().is("{") && !starts_block()) next();
    if (at_end() || !peek().is("{")) return;
    int depth = 0;
    do {
      if (peek().is("{")) ++depth;
      if (peek().is("}")) --depth;
      next();
    } while (!at_end() && depth > 0);
  }

  void take(const std::string& key, const std::vector<std::string>& given) {
    doom::LevelRules& rules = info_->rules;
    if (key == "nojump" || key == "allowjump") {
      rules.no_jump = key == "nojump";
    } else if (key == "nocrouch" || key == "allowcrouch") {
      rules.no_crouch = key == "nocrouch";
    } else if (key == "gravity" && given.size() == 1) {
      const double units = std::clamp(std::strtod(given[0].c_str(), nullptr), -100'000.0, 100'000.0);
      rules.gravity = static_cast<doom::Fixed>(units / 800 * doom::kFracUnit);
    } else if (key == "playerclasses" && !given.empty()) {
      info_->player_class = given[0];
    } else if (!is_one_of(kIdleKeys, key)) {
      warn(key);
    }
  }

  void warn(const std::string& key) {
    if (!key.empty() && named_.insert(key).second)
      warnings_->push_back(label_ + ": '" + key + "' is not supported and has no effect");
  }

  std::vector<Token> tokens_;
  std::size_t at_ = 0;
  const std::string& label_;
  std::string map_;
  MapInfo* info_;
  std::vector<std::string>* warnings_;
  std::set<std::string> named_;
};

}  // namespace

void read_map_info(std::string_view text, const std::string& label, std::string_view map, MapInfo* info,
                   std::vector<std::string>* warnings) {
  Reader(text, label, map, info, warnings).read();
}

void read_key_conf(std::string_view text, const std::string& label, MapInfo* info,
                   std::vector<std::string>* warnings) {
  const std::vector<Token> tokens = tokens_of(text);
  bool has_slots = false;
  for (std::size_t i = 0; i < tokens.size(); ++i) {
    if (i > 0 && tokens[i - 1].line == tokens[i].line) continue;  // commands begin lines
    const std::string& command = tokens[i].text;
    if (command == "clearplayerclasses") info->player_class.clear();
    if (command == "addplayerclass" && i + 1 < tokens.size() && info->player_class.empty())
      info->player_class = tokens[i + 1].text;
    has_slots |= command == "setslot" || command == "addslot" || command == "addslotdefault";
  }
  if (has_slots)
    warnings->push_back(label + ": slots of weapons ('setslot') are not supported and have no effect");
}

}  // namespace comrad::sim
