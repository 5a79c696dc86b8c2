#include "scenarios/spec/vizdoom_config.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <sstream>

#include "rollout_buffer/core/text.h"

namespace comrad::scenarios {
namespace {

constexpr std::size_t kFileBytesMax = 1 << 20;
constexpr double kRewardMax = 1e9;
constexpr int kTicRateHz = 35;
constexpr const char* kScreenFormats[] = {"CRCGCB", "RGB24",  "RGBA32", "ARGB32", "CBCGCR",
                                          "BGR24",  "BGRA32", "ABGR32", "GRAY8",  "DOOM_256_COLORS8"};

/// One `key = value`; a list's words are split already.
struct Entry {
  std::string key;  ///< as written
  std::string value;
  std::string whole;  ///< the value with what a '#' would cut off: texts have no comments
  std::vector<std::string> words;
  bool is_list = false, appends = false;
  int line = 0;
};

/// Letters and digits alone, in upper case: how keys and names compare.
std::string folded(std::string_view text) {
  std::string result;
  for (const char c : text)
    if (c != '_' && c != '-') result += upper_case(c);
  return result;
}

std::vector<std::string> split_words(std::string_view text) {
  std::vector<std::string> words;
  std::string word;
  for (const char c : text) {
    if (!is_space(c) && c != ',') {
      word += c;
    } else if (!word.empty()) {
      words.push_back(std::move(word));
      word.clear();
    }
  }
  if (!word.empty()) words.push_back(std::move(word));
  return words;
}

/// A word for a message: printable, and not endless.
std::string shown(std::string_view text) {
  constexpr std::size_t kLengthMax = 60;
  std::string result;
  for (const char c : text.substr(0, kLengthMax)) result += c >= ' ' && c <= '~' ? c : '?';
  return text.size() > kLengthMax ? result + "..." : result;
}

/// Lines to entries. A '#' that begins a line or a word starts a comment.
Expected<std::vector<Entry>> read_entries(std::string_view text, const std::string& path) {
  std::vector<Entry> entries;
  const auto error = [&](int line, const std::string& what) {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}: {}", path, line, what)};
  };
  int line_number = 0;
  bool in_list = false, awaits_value = false;  // a list may open on the line after its key
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    std::string_view line = text.substr(0, end);
    text = end == std::string_view::npos ? std::string_view() : text.substr(end + 1);
    ++line_number;
    std::string_view whole = line;
    for (std::size_t i = 0; i < line.size(); ++i)
      if (line[i] == '#' && (i == 0 || is_space(line[i - 1]))) line = line.substr(0, i);
    line = trimmed(line);
    if (line.empty()) continue;

    if (awaits_value && line.front() == '{') {
      in_list = entries.back().is_list = true;
      line = line.substr(1);
    } else if (!in_list) {
      const std::size_t equals = line.find('=');
      if (equals == std::string_view::npos)
        return error(line_number, "'" + shown(line) + "' is no 'key = value' line");
      Entry& entry = entries.emplace_back();
      entry.line = line_number;
      entry.appends = equals > 0 && line[equals - 1] == '+';
      entry.key = std::string(trimmed(line.substr(0, equals - (entry.appends ? 1 : 0))));
      if (entry.key.empty()) return error(line_number, "a value without a key before '='");
      line = trimmed(line.substr(equals + 1));
      entry.whole = trimmed(whole.substr(whole.find('=') + 1));
      if (line.empty() || line.front() != '{') {
        awaits_value = line.empty();
        entry.value = std::string(line);
        entry.words = split_words(line);
        continue;
      }
      in_list = entry.is_list = true;
      line = line.substr(1);
    }
    awaits_value = false;
    const std::size_t close = line.find('}');
    for (std::string& word : split_words(line.substr(0, close)))
      entries.back().words.push_back(std::move(word));
    if (close == std::string_view::npos) continue;
    in_list = false;
    if (!trimmed(line.substr(close + 1)).empty())
      return error(line_number, "'" + shown(trimmed(line.substr(close + 1))) + "' after the '}' of a list");
  }
  if (in_list)
    return error(entries.back().line, "the list of " + shown(entries.back().key) + " has no '}' at its end");
  return entries;
}

/// One key that is understood.
struct Key {
  const char* name;
  std::function<Status(const Entry&)> read;
};

class ConfigReader {
 public:
  ConfigReader(const std::string& path, VizdoomConfig* config) : config_(config) {
    config_->path = path;
    const std::size_t slash = path.find_last_of('/');
    folder_ = slash == std::string::npos ? "" : path.substr(0, slash + 1);
    add_keys();
  }

  Status read(const std::vector<Entry>& entries) {
    std::vector<std::string> unknown;
    for (const Entry& entry : entries) {
      const std::string key = folded(entry.key);
      const auto found = std::find_if(keys_.begin(), keys_.end(),
                                      [&](const Key& known) { return folded(known.name) == key; });
      if (found != keys_.end()) {
        COMRAD_TRY(found->read(entry));
      } else if (std::count(unknown.begin(), unknown.end(), key) == 0) {
        unknown.push_back(key);
        warn(entry, "unknown key " + shown(entry.key) + "; the nearest known one is " + nearest_key(key));
      }
    }
    COMRAD_TRY(read_arguments());
    return {};
  }

 private:
  Error error(const Entry& entry, const std::string& what, ErrorCode code = ErrorCode::kBadInput) const {
    return Error{code, fmt::format("{}:{}: {}", config_->path, entry.line, what)};
  }
  void warn(const Entry& entry, const std::string& what) {
    config_->warnings.push_back(fmt::format("{}:{}: {}", config_->path, entry.line, what));
  }

  std::string nearest_key(const std::string& key) const {
    const Key* best = &keys_.front();
    std::size_t best_distance = std::numeric_limits<std::size_t>::max();
    for (const Key& known : keys_) {
      const std::size_t distance = edit_distance(key.substr(0, 64), folded(known.name));
      if (distance < best_distance) best_distance = distance, best = &known;
    }
    return best->name;
  }

  Status read_integer(const Entry& entry, int64_t low, int64_t high, int64_t* target) const {
    int64_t value = 0;
    const std::string& text = entry.value;
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (code != std::errc() || end != text.data() + text.size() || value < low || value > high)
      return error(entry, fmt::format("{} = {}; it must be a whole number in {}..{}", entry.key, shown(text),
                                      low, high));
    *target = value;
    return {};
  }
  Status read_number(const Entry& entry, double* target) const {
    double value = 0;
    const std::string& text = entry.value;
    const char* const begin = text.data() + (text.starts_with('+') ? 1 : 0);
    const auto [end, code] = std::from_chars(begin, text.data() + text.size(), value);
    if (code != std::errc() || end != text.data() + text.size() || !std::isfinite(value) ||
        std::abs(value) > kRewardMax)
      return error(entry,
                   entry.key + " = " + shown(text) + "; it must be a number of at most a thousand million");
    *target = value;
    return {};
  }
  Status read_flag(const Entry& entry, bool* target) const {
    const std::string value = upper_case(entry.value);
    if (value == "TRUE" || value == "1" || value == "YES" || value == "ON") {
      *target = true;
    } else if (value == "FALSE" || value == "0" || value == "NO" || value == "OFF") {
      *target = false;
    } else {
      return error(entry, entry.key + " = " + shown(entry.value) + "; it must be true or false");
    }
    return {};
  }
  Status read_text(const Entry& entry, std::string* target) const {
    if (entry.is_list) return error(entry, entry.key + " takes one value, not a list");
    *target = entry.value;
    return {};
  }
  /// As ViZDoom reads it: a '#' in it is no comment.
  Status read_path(const Entry& entry, std::string* target) const {
    COMRAD_TRY(read_text(entry, target));
    *target = entry.whole;
    if (target->size() >= 2 && target->front() == '"' && target->back() == '"')
      *target = target->substr(1, target->size() - 2);
    if (target->find('\0') != std::string::npos) return error(entry, entry.key + " holds a zero byte");
    if (!target->empty() && target->front() != '/') *target = folder_ + *target;
    return {};
  }

  void add_integer(const char* name, int64_t low, int64_t high, int* target) {
    keys_.push_back({name, [=, this](const Entry& entry) -> Status {
                       int64_t value = 0;
                       COMRAD_TRY(read_integer(entry, low, high, &value));
                       *target = static_cast<int>(value);
                       return {};
                     }});
  }
  void add_number(const char* name, double* target, double sign = 1.0) {
    keys_.push_back({name, [=, this](const Entry& entry) -> Status {
                       COMRAD_TRY(read_number(entry, target));
                       *target *= sign;
                       return {};
                     }});
  }
  void add_flag(const char* name, bool* target) {
    keys_.push_back({name, [=, this](const Entry& entry) { return read_flag(entry, target); }});
  }
  /// A key that changes nothing that COMRAD shows.
  void add_ignored(const char* name) {
    keys_.push_back({name, [](const Entry&) { return Status(); }});
  }
  /// A buffer that COMRAD does not fill; asking for it is worth a word.
  void add_unserved(const char* name) {
    keys_.push_back({name, [=, this](const Entry& entry) -> Status {
                       bool wanted = false;
                       COMRAD_TRY(read_flag(entry, &wanted));
                       if (wanted)
                         warn(entry, std::string(name) + " is not served: there is no such buffer here");
                       return {};
                     }});
  }

  /// A buffer that Python alone shows.
  void add_buffer(const char* name, bool* target) {
    keys_.push_back({name, [=, this](const Entry& entry) -> Status {
                       COMRAD_TRY(read_flag(entry, target));
                       if (*target)
                         config_->buffer_warnings.push_back(fmt::format(
                             "{}:{}: {} is not served here: Python's comrad.gym_env alone has this buffer",
                             config_->path, entry.line, name));
                       return {};
                     }});
  }

  void add_keys() {
    VizdoomConfig& config = *config_;
    VizdoomRewards& rewards = config.rewards;
    keys_.push_back({"doom_scenario_path", [this](const Entry& entry) {
                       config_->scenario_line = entry.line;
                       return read_path(entry, &config_->scenario_path);
                     }});
    keys_.push_back({"doom_game_path", [this](const Entry& entry) {
                       config_->game_line = entry.line;
                       return read_path(entry, &config_->game_path);
                     }});
    keys_.push_back({"doom_map", [this](const Entry& entry) -> Status {
                       COMRAD_TRY(read_text(entry, &config_->map));
                       if (config_->map.empty() || config_->map.size() > 8)
                         return error(entry, "doom_map = " + shown(config_->map) +
                                                 "; a map's name has 1 to 8 characters");
                       config_->map = upper_case(config_->map);
                       config_->map_line = entry.line;
                       return {};
                     }});
    keys_.push_back({"seed", [this](const Entry& entry) -> Status {
                       int64_t value = 0;
                       COMRAD_TRY(read_integer(entry, 0, UINT32_MAX, &value));
                       config_->seed = static_cast<uint64_t>(value);
                       return {};
                     }});
    keys_.push_back({"available_buttons", [this](const Entry& entry) { return read_buttons(entry); }});
    keys_.push_back(
        {"available_game_variables", [this](const Entry& entry) { return read_variables(entry); }});
    keys_.push_back({"screen_resolution", [this](const Entry& entry) { return read_resolution(entry); }});
    keys_.push_back({"game_args", [this](const Entry& entry) -> Status {
                       if (!entry.appends) arguments_.clear();
                       for (const std::string& word : entry.is_list ? entry.words : split_words(entry.whole))
                         arguments_.push_back({word, entry});
                       return {};
                     }});
    add_integer("doom_skill", 1, 5, &config.skill);
    add_integer("episode_start_time", 0, 1'000'000, &config.rules.start_tics);
    add_integer("episode_timeout", 0, INT32_MAX, &config.timeout_tics);
    add_number("living_reward", &rewards.living);
    add_number("death_penalty", &rewards.death_penalty);
    add_number("death_reward", &rewards.death);
    add_number("map_exit_reward", &rewards.map_exit);
    add_number("kill_reward", &rewards.kill);
    add_number("secret_reward", &rewards.secret);
    add_number("item_reward", &rewards.item);
    add_number("frag_reward", &rewards.frag);
    add_number("hit_reward", &rewards.hit);
    add_number("hit_taken_reward", &rewards.hit_taken);
    add_number("hit_taken_penalty", &rewards.hit_taken, -1.0);
    add_number("damage_made_reward", &rewards.damage_made);
    add_number("damage_taken_reward", &rewards.damage_taken);
    add_number("damage_taken_penalty", &rewards.damage_taken, -1.0);
    add_number("health_reward", &rewards.health);
    add_number("armor_reward", &rewards.armor);
    add_flag("render_hud", &config.hud);
    add_flag("render_minimal_hud", &config.minimal_hud);
    add_flag("render_weapon", &config.weapon);
    add_flag("render_crosshair", &config.crosshair);
    add_flag("render_screen_flashes", &config.screen_flashes);
    add_flag("render_corpses", &config.corpses);
    add_flag("render_decals", &config.decals);
    add_flag("render_particles", &config.particles);
    add_flag("render_effects_sprites", &config.effects_sprites);
    add_flag("render_messages", &config.messages);
    for (const char* const name :
         {"mode", "window_visible", "console_enabled", "sound_enabled", "ticrate", "render_all_frames",
          "vizdoom_path", "doom_config_path", "audio_buffer_size", "audio_sampling_rate",
          "notifications_buffer_size", "automap_render_textures", "automap_render_objects_as_sprites"})
      add_ignored(name);
    for (const char* const name : {"audio_buffer_enabled", "notifications_buffer_enabled",
                                   "objects_info_enabled", "sectors_info_enabled"})
      add_unserved(name);
    add_buffer("depth_buffer_enabled", &config.buffers.depth);
    add_buffer("labels_buffer_enabled", &config.buffers.labels);
    add_buffer("automap_buffer_enabled", &config.buffers.automap);
    add_flag("automap_rotate", &config.buffers.automap_rotates);
    keys_.push_back({"screen_format", [this](const Entry& entry) -> Status {
                       const std::string format = upper_case(entry.value);
                       if (std::ranges::count(kScreenFormats, format) == 0)
                         return error(entry, entry.key + " = " + shown(entry.value) + "; it must be one of " +
                                                 joined(kScreenFormats));
                       config_->buffers.gray = format == "GRAY8";
                       if (config_->buffers.gray)
                         config_->buffer_warnings.push_back(
                             fmt::format("{}:{}: screen_format = GRAY8 is not served here, and pictures are "
                                         "RGB24: Python's comrad.gym_env alone has gray ones",
                                         config_->path, entry.line));
                       return {};
                     }});
    keys_.push_back({"automap_mode", [this](const Entry& entry) -> Status {
                       const std::string mode = upper_case(entry.value);
                       const auto known = {"NORMAL", "WHOLE", "OBJECTS", "OBJECTS_WITH_SIZE"};
                       if (std::find(known.begin(), known.end(), mode) == known.end())
                         return error(entry, entry.key + " = " + shown(entry.value) +
                                                 "; it must be NORMAL, WHOLE, OBJECTS or OBJECTS_WITH_SIZE");
                       config_->buffers.automap_mode = mode;
                       return {};
                     }});
  }

  Status read_buttons(const Entry& entry) {
    if (!entry.appends) config_->buttons.clear(), config_->button_names.clear();
    for (const std::string& word : entry.words) {
      std::string name = upper_case(word);
      if (name == "ACTIVATE_SELECTED_WEAPON") name = "ACTIVATE_SELECTED_ITEM";  // ViZDoom's word for it
      const auto button = find_button(name);
      if (!button)
        return error(entry,
                     "'" + shown(word) + "' is no button; the nearest is " + nearest(name, button_names()));
      if (std::count(config_->button_names.begin(), config_->button_names.end(), name) > 0) continue;
      config_->buttons.push_back(*button);
      config_->button_names.push_back(name);
    }
    return {};
  }
  Status read_variables(const Entry& entry) {
    if (!entry.appends) config_->variables.clear(), config_->variable_names.clear();
    for (const std::string& word : entry.words) {
      const auto variable = find_variable(upper_case(word));
      if (!variable)
        return error(entry, "'" + shown(word) + "' is no game variable; the nearest is " +
                                nearest(upper_case(word), variable_names()));
      const std::string name = upper_case(word);
      if (std::count(config_->variable_names.begin(), config_->variable_names.end(), name) > 0) continue;
      config_->variables.push_back(*variable);
      config_->variable_names.push_back(name);
    }
    return {};
  }
  static std::string nearest(const std::string& word, const std::vector<std::string>& names) {
    return *std::min_element(names.begin(), names.end(), [&](const std::string& a, const std::string& b) {
      return edit_distance(word.substr(0, 64), a) < edit_distance(word.substr(0, 64), b);
    });
  }

  Status read_resolution(const Entry& entry) {
    const std::string text = folded(entry.value);  // RES320X240
    int size[2] = {0, 0};
    const char* at = text.data();
    const char* const end = text.data() + text.size();
    if (text.starts_with("RES")) at += 3;
    const auto width = std::from_chars(at, end, size[0]);
    const bool has_height = width.ec == std::errc() && width.ptr != end && *width.ptr == 'X';
    const auto height = has_height ? std::from_chars(width.ptr + 1, end, size[1]) : width;
    const bool in_range = size[0] >= 16 && size[0] <= 4096 && size[1] >= 16 && size[1] <= 4096;
    if (!has_height || height.ec != std::errc() || height.ptr != end || !in_range)
      return error(entry, "screen_resolution = " + shown(entry.value) +
                              "; write RES_<width>X<height>, each in 16..4096");
    config_->width = size[0], config_->height = size[1];
    return {};
  }

  struct Argument {
    std::string word;
    Entry entry;
  };

  static uint64_t bits_of(double value) {
    return static_cast<uint32_t>(static_cast<int64_t>(std::clamp(value, -2147483648.0, 4294967295.0)));
  }
  static int tics_of(double seconds) {
    return static_cast<int>(std::clamp(seconds, 0.0, 36'000.0) * kTicRateHz);
  }
  /// Console variables (folded) of windows, sounds, names and cheats: play is the same with any value.
  static bool shows_only(const std::string& variable) {
    static constexpr std::string_view kBegins[] = {
        "VIZAM", "VIZRENDER", "VIZNOCHEAT", "VIZDEBUG", "VIZCONNECT", "VID",      "SND",
        "NAME",  "COLOR",     "GENDER",     "SKIN",     "FREELOOK",   "SVCHEATS", "FULLSCREEN"};
    return std::any_of(std::begin(kBegins), std::end(kBegins),
                       [&](std::string_view begin) { return variable.starts_with(begin); });
  }

  /// Arguments of the engine's command line: switches, and console variables as `+name value`.
  Status read_arguments() {
    GameRules& rules = config_->rules;
    rules.skill = config_->skill;
    wad::GameFlags& flags = rules.flags;
    std::optional<int> respawn_tics;
    int time_limit_tics = 0;  // 0: none
    const std::pair<const char*, std::function<void(double)>> variables[] = {
        {"dmflags", [&](double value) { flags.bits = (flags.bits >> 32 << 32) | bits_of(value); }},
        {"dmflags2", [&](double value) { flags.bits = (flags.bits & 0xffff'ffffu) | bits_of(value) << 32; }},
        {"cl_run", [&](double value) { rules.always_run = value != 0; }},
        {"timelimit", [&](double value) { time_limit_tics = tics_of(value * 60); }},
        {"fraglimit",
         [&](double value) { rules.frag_limit = static_cast<int>(std::clamp(value, 0.0, 1e6)); }},
        {"sv_gravity", [&](double value) { rules.gravity = std::clamp(value, 0.0, 80'000.0) / 800; }},
        {"sv_aircontrol", [&](double value) { rules.air_control = std::clamp(value, 0.0, 100.0); }},
        {"viz_respawn_delay", [&](double value) { respawn_tics = tics_of(value); }},
        {"skill", [&](double value) { rules.skill = static_cast<int>(std::clamp(value, 0.0, 4.0)) + 1; }},
    };
    const auto setter_of = [&](const std::string& name) -> std::function<void(double)> {
      for (const auto& [known, set] : variables)
        if (folded(known) == name) return set;
      for (const wad::GameFlagName& known : wad::kGameFlagNames)
        if (folded(known.variable) == name)
          return [&flags, flag = known.flag](double value) { flags.set(flag, value != 0); };
      return nullptr;
    };
    for (std::size_t i = 0; i < arguments_.size(); ++i) {
      const auto& word = arguments_[i].word;
      const auto& entry = arguments_[i].entry;
      const std::string name = folded(word);
      if (name == "NOMONSTERS") {  // the dash is folded away
        rules.no_monsters = true;
      } else if (name == "DEATHMATCH") {
        rules.deathmatch = true;
      } else if (name == "HOST" || name == "PORT" || name == "WARP" || name == "JOIN" || name == "NETMODE") {
        if (i + 1 < arguments_.size() && arguments_[i + 1].word[0] != '-' && arguments_[i + 1].word[0] != '+')
          ++i;  // its value
        if (name != "HOST") {
          warn(entry, "game_args: " + shown(word) + " is ignored");
          continue;
        }
        const std::string& players = arguments_[i].word;  // or -host itself, where no number follows
        int count = 0;
        const auto [end, code] = std::from_chars(players.data(), players.data() + players.size(), count);
        if (code != std::errc() || end != players.data() + players.size() || count < 1 || count > kMaxAgents)
          return error(entry, fmt::format("game_args: -host {}; the number of players must be 1 to {}",
                                          shown(players), kMaxAgents));
        config_->host_count = count;
        rules.network_game = true;
      } else if (word[0] == '+' && word.size() > 1) {
        const bool has_value = i + 1 < arguments_.size() && arguments_[i + 1].word[0] != '+' &&
                               (arguments_[i + 1].word[0] != '-' ||
                                (arguments_[i + 1].word.size() > 1 && arguments_[i + 1].word[1] >= '0' &&
                                 arguments_[i + 1].word[1] <= '9'));
        const std::string value_text = has_value ? arguments_[++i].word : "";
        const std::string variable = folded(std::string_view(word).substr(1));
        if (shows_only(variable)) continue;
        const auto set = setter_of(variable);
        if (set == nullptr) {
          warn(entry, "game_args: " + shown(word) + " is not known and is ignored");
          continue;
        }
        double value = 1;
        if (has_value) {
          const auto [end, code] =
              std::from_chars(value_text.data(), value_text.data() + value_text.size(), value);
          if (code != std::errc() || end != value_text.data() + value_text.size() || !std::isfinite(value))
            return error(entry, "game_args: " + shown(word) + " " + shown(value_text) +
                                    "; its value must be a number");
        }
        set(value);
      } else {
        warn(entry, "game_args: " + shown(word) + " is not known and is ignored");
      }
    }
    rules.start_tics = std::max(rules.start_tics, 1);
    if (time_limit_tics > 0) {  // counted from the map's start, unlike the timeout
      const int limit = std::max(time_limit_tics - rules.start_tics, 1);
      config_->timeout_tics = config_->timeout_tics > 0 ? std::min(config_->timeout_tics, limit) : limit;
    }
    using enum wad::GameFlag;  // without them, what ViZDoom's player may do by default
    rules.no_monsters |= flags.has(kNoMonsters);
    rules.infinite_ammo = flags.has(kInfiniteAmmo);
    rules.autoaim = !flags.has(kNoAutoaim);
    rules.free_look = !flags.has(kNoFreeLook);
    rules.allow_jump = !flags.has(kNoJump);
    rules.allow_crouch = !flags.has(kNoCrouch);
    config_->forced_respawn = flags.has(kForceRespawn) && !flags.has(kNoRespawn);
    // A network game waits a second by default, and one tic at least.
    config_->respawn_delay_tics =
        rules.network_game ? std::max(respawn_tics.value_or(kTicRateHz), 1) : respawn_tics.value_or(0);
    return {};
  }

  VizdoomConfig* config_;
  std::string folder_;
  std::vector<Key> keys_;
  std::vector<Argument> arguments_;
};

}  // namespace

std::string existing_file(const std::string& path) {
  std::error_code failure;
  const std::filesystem::path wanted(path);
  if (std::filesystem::exists(wanted, failure)) return path;
  const std::filesystem::path folder = wanted.has_parent_path() ? wanted.parent_path() : ".";
  for (const auto& entry : std::filesystem::directory_iterator(folder, failure))
    if (same_ignoring_case(entry.path().filename().string(), wanted.filename().string()))
      return entry.path().string();
  return path;
}

Expected<VizdoomConfig> parse_vizdoom_config(std::string_view text, const std::string& path) {
  if (text.size() > kFileBytesMax)
    return Error{ErrorCode::kBadFormat, path + ": larger than a megabyte; is it a ViZDoom .cfg?"};
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  COMRAD_TRY_ASSIGN(const std::vector<Entry> entries, read_entries(text, path));
  VizdoomConfig config;
  COMRAD_TRY(ConfigReader(path, &config).read(entries));
  return config;
}

Expected<VizdoomConfig> load_vizdoom_config(const std::string& path) {
  std::error_code failure;
  const auto size = std::filesystem::file_size(path, failure);
  if (failure) return Error{ErrorCode::kNotFound, path + ": " + failure.message()};
  if (size > kFileBytesMax)
    return Error{ErrorCode::kBadFormat, path + ": larger than a megabyte; is it a ViZDoom .cfg?"};
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file) return Error{ErrorCode::kNotFound, path + ": cannot be read"};
  return parse_vizdoom_config(text.str(), path);
}

}  // namespace comrad::scenarios
