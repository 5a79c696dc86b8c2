#include "sim_workers/engine/actors/decorate.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "doomgen/wad/special_names.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/actors/action_arguments.h"
#include "sim_workers/engine/actors/decorate_expression.h"
#include "sim_workers/engine/actors/decorate_lexer.h"
#include "sim_workers/engine/actors/decorate_properties.h"
#include "sim_workers/engine/actors/flag_names.h"
#include "sim_workers/engine/actors/state_labels.h"
#include "sim_workers/engine/actors/state_program.h"

namespace comrad::doom {
namespace {

// Far above what real lumps hold; a hostile one ends there.
constexpr std::size_t kActorsMax = 4096, kStatesMax = 100000, kLabelsPerTypeMax = 512, kArgsMax = 40;
constexpr std::size_t kWarningsMax = 200, kNameLettersMax = 128, kConstantsMax = 4096;
constexpr int kIncludeDepthMax = 16;

class DecorateParser {
 public:
  DecorateParser(std::string_view text, const std::string& label, ActorCatalog* catalog,
                 std::vector<std::string>* warnings, const DecorateIncludes& includes)
      : text_(text),
        lexer_(text),
        label_(label),
        catalog_(*catalog),
        warnings_(warnings),
        includes_(includes) {}

  Status run() {
    reserve_names(text_, 0);
    return read();
  }

 private:
  Status read() {
    while (true) {
      const Token token = lexer_.next();
      if (token.kind == Token::Kind::kEnd) return {};
      if (token.is(";")) continue;
      if (token.kind == Token::Kind::kBroken) return error_at(token, token.text);
      if (token.is_name("actor")) {
        COMRAD_TRY(actor());
      } else if (token.is_name("const") || token.is_name("enum")) {
        COMRAD_TRY(constants(token));
      } else if (token.is("#")) {
        COMRAD_TRY(directive());
      } else if (token.is_name("damagetype")) {
        warn(token, "damagetype " + lexer_.word().text + " is not supported and left out");
        COMRAD_TRY(skip_block(token));
      } else {
        return error_at(token, "'" + token.text + "' where an actor must begin");
      }
    }
  }

  void warn(const Token& token, const std::string& what) {
    if (warnings_ == nullptr || !warned_.insert(what).second || warnings_left_ == 0) return;
    --warnings_left_;
    warnings_->push_back(fmt::format("{}:{}: {}", label_, token.line, what));
  }

  DecorateNames names() {
    return {.constant = [this](std::string_view name) -> std::optional<double> {
              const auto own = constants_.find(lower_case(name));
              if (own != constants_.end()) return own->second;
              if (const std::optional<int32_t> known = find_constant(name)) return *known;
              return std::nullopt;
            },
            .unknown =
                [this](const Token& token) {
                  warn(token,
                       "'" + token.text + "' depends on the running game, which is not supported here");
                }};
  }

  /// Actors may name those that follow: each gets its place before the first is read.
  void reserve_names(std::string_view text, int include_depth) {
    DecorateLexer ahead(text);
    int depth = 0;
    while (true) {
      const Token token = ahead.next();
      if (token.kind == Token::Kind::kEnd || token.kind == Token::Kind::kBroken) return;
      if (token.is("{")) ++depth;
      if (token.is("}")) --depth;
      if (depth == 0 && token.is("#") && ahead.peek().is_name("include")) {
        ahead.next();
        const std::optional<std::string_view> more = included(ahead.word().text);
        if (more && include_depth < kIncludeDepthMax) reserve_names(*more, include_depth + 1);
      }
      if (depth != 0 || !token.is_name("actor")) continue;
      ActorType type;
      type.name = ahead.word().text;
      if (type.name.empty() || type.name.size() > kNameLettersMax || catalog_.find(type.name)) continue;
      if (reserved_.size() >= kActorsMax) return;
      reserved_.insert(lower_case(type.name));
      catalog_.add(std::move(type));
    }
  }

  Status directive() {
    const Token name = lexer_.next();
    if (name.is_name("include")) {
      const Token file = lexer_.word();
      lexer_.skip_line(name.line);
      return include(name, file.text);
    } else if (!name.is_name("region") && !name.is_name("endregion")) {
      return error_at(name, "unknown directive '#" + name.text + "'");
    }
    lexer_.skip_line(name.line);
    return {};
  }

  std::optional<std::string_view> included(const std::string& name) const {
    return includes_ ? includes_(name) : std::nullopt;
  }

  Status include(const Token& keyword, const std::string& name) {
    const std::optional<std::string_view> text = included(name);
    if (!text) {
      warn(keyword, "#include \"" + name + "\": there is no such lump; its actors are left out");
      return {};
    }
    if (include_depth_ >= kIncludeDepthMax)
      return error_at(keyword,
                      fmt::format("lumps that include each other more than {} deep", kIncludeDepthMax));
    const DecorateLexer outer_lexer = std::exchange(lexer_, DecorateLexer(*text));
    const std::string outer_label = std::exchange(label_, label_ + ":" + name);
    ++include_depth_;
    const Status status = read();
    --include_depth_;
    lexer_ = outer_lexer;
    label_ = outer_label;
    if (!status) return Error{status.error().code, name + ":" + status.error().message};
    return {};
  }

  /// "const int a = 3;" or "enum { a, b = 4 }".
  Status constants(const Token& keyword) {
    if (keyword.is_name("const")) {
      const Token kind = lexer_.next();
      if (!kind.is_name("int") && !kind.is_name("float"))
        return error_at(kind, "'int' or 'float' is missing");
      const Token name = lexer_.next();
      if (name.kind != Token::Kind::kName) return error_at(name, "the name of a constant is missing");
      COMRAD_TRY(expect("="));
      COMRAD_TRY(add_constant(name, kind.is_name("int")));
      return expect(";");
    }
    Token token = lexer_.next();
    if (token.kind == Token::Kind::kName) token = lexer_.next();
    if (!token.is("{")) return error_at(token, "'{' of an enum is missing");
    double value = 0.0;
    while (!lexer_.peek().is("}")) {
      const Token name = lexer_.next();
      if (name.kind != Token::Kind::kName) return error_at(name, "the name of a constant is missing");
      if (lexer_.peek().is("=")) {
        lexer_.next();
        COMRAD_TRY(add_constant(name, true));
        value = constants_[lower_case(name.text)];
      } else {
        COMRAD_TRY(add_constant(name, value));
      }
      value += 1.0;
      if (!lexer_.peek().is(",")) break;
      lexer_.next();
    }
    return expect("}");
  }

  Status add_constant(const Token& name, bool whole) {
    COMRAD_TRY_ASSIGN(const DecorateValue value, read_expression(&lexer_, names()));
    if (value.kind != DecorateValue::Kind::kNumber) return error_at(name, "a constant must be a number");
    return add_constant(name, whole ? std::trunc(value.number) : value.number);
  }
  Status add_constant(const Token& name, double value) {
    if (constants_.size() >= kConstantsMax) return error_at(name, "too many constants");
    constants_[lower_case(name.text)] = value;
    return {};
  }

  Status expect(std::string_view symbol) {
    const Token token = lexer_.next();
    if (token.is(symbol)) return {};
    if (token.kind == Token::Kind::kBroken) return error_at(token, token.text);
    return error_at(token, "'" + std::string(symbol) + "' is missing" +
                               (token.text.empty() ? std::string() : " before '" + token.text + "'"));
  }

  /// Skips "{ ... }".
  Status skip_block(const Token& start) {
    int depth = 0;
    do {
      const Token token = lexer_.next();
      if (token.kind == Token::Kind::kBroken) return error_at(token, token.text);
      if (token.kind == Token::Kind::kEnd) return error_at(start, "this block has no closing '}'");
      if (token.is("{")) ++depth;
      if (token.is("}")) --depth;
    } while (depth > 0);
    return {};
  }

  // ---------------------------------------------------------------- actors

  Status actor() {
    const Token name = lexer_.word();
    if (name.text.empty()) return error_at(name, "the name of an actor is missing");
    if (name.text.size() > kNameLettersMax) return error_at(name, "the name of an actor is too long");
    if (++actor_count_ > kActorsMax) return error_at(name, "too many actors in one lump");
    std::string parent_name = "Actor";
    if (lexer_.peek().is(":")) {
      lexer_.next();
      const Token parent = lexer_.word();
      if (parent.text.empty()) return error_at(parent, "the name of the parent is missing");
      parent_name = parent.text;
    }
    const std::optional<uint32_t> parent = catalog_.find(parent_name);
    if (!parent || reserved_.contains(lower_case(parent_name)))
      return error_at(name, "actor " + name.text + ": unknown parent '" + parent_name +
                                "' (a parent must come before its descendants)");
    if (const std::optional<uint32_t> own = catalog_.find(name.text); own && catalog_.is_a(*parent, *own))
      return error_at(name, "actor " + name.text + " would be its own ancestor");

    ActorType type = catalog_.derived(*parent, name.text);
    if (lexer_.peek().is_name("replaces")) {
      lexer_.next();
      const Token other = lexer_.word();
      const std::optional<uint32_t> replaced = catalog_.find(other.text);
      if (!replaced) {
        warn(other, "actor " + name.text + " replaces unknown actor '" + other.text + "'");
      } else {
        type.replaces = *replaced;
      }
    }
    if (const Token number = lexer_.peek(); number.kind == Token::Kind::kInteger || number.is("-")) {
      COMRAD_TRY_ASSIGN(const DecorateValue value, read_property_value(&lexer_, names()));
      type.editor_number = std::clamp(value.integer(), -1, 65535);
    }
    if (lexer_.peek().is_name("native")) lexer_.next();
    COMRAD_TRY(expect("{"));

    StateProgram states;
    PropertyTarget target{.catalog = &catalog_, .type = &type, .warn = {}};
    while (true) {
      const Token token = lexer_.next();
      if (token.is("}")) break;
      if (token.is(";")) continue;
      if (token.kind == Token::Kind::kEnd)
        return error_at(token, "actor " + name.text + " has no closing '}'");
      if (token.kind == Token::Kind::kBroken) return error_at(token, token.text);
      target.warn = [&](const std::string& what) { warn(token, "actor " + name.text + ": " + what); };
      if (token.is("+") || token.is("-")) {
        COMRAD_TRY(flag(&type, token.is("+")));
      } else if (token.is_name("states")) {
        COMRAD_TRY(state_block(&states, name.text));
      } else if (token.is_name("const") || token.is_name("enum")) {
        COMRAD_TRY(constants(token));
      } else if (token.is_name("var")) {
        warn(token, "actor " + name.text + ": user variables are not supported");
        while (!lexer_.peek().is(";") && lexer_.peek().kind != Token::Kind::kEnd && !lexer_.peek().is("}"))
          lexer_.next();
      } else if (token.kind == Token::Kind::kName) {
        COMRAD_TRY(property(token, &target));
      } else if (token.is("#")) {
        COMRAD_TRY(directive());
      } else {
        return error_at(token, "'" + token.text + "' where a property, a flag or States must stand");
      }
    }

    std::vector<StateTarget> missing;
    COMRAD_TRY(states.finish(&catalog_, &type, &missing));
    for (const StateTarget& jump : missing)
      warn({.kind = Token::Kind::kName, .text = {}, .line = jump.line, .column = jump.column},
           "actor " + name.text + ": no state label '" + jump.label + "' to jump to");
    if (type.labels.size() > kLabelsPerTypeMax) return error_at(name, "too many state labels");
    if (catalog_.state_count() > kStatesMax) return error_at(name, "too many states");
    catalog_.add(std::move(type));
    reserved_.erase(lower_case(name.text));
    return {};
  }

  /// "SOLID" or "WEAPON.NOAUTOFIRE" after its sign.
  Status flag(ActorType* type, bool on) {
    const Token token = lexer_.next();
    if (token.kind != Token::Kind::kName) return error_at(token, "the name of a flag is missing");
    std::string name = token.text;
    while (lexer_.peek().is(".")) {
      lexer_.next();
      name += "." + lexer_.next().text;
      if (name.size() > kNameLettersMax) return error_at(token, "the name of a flag is too long");
    }
    if (const std::optional<ActorFlag> known = find_flag(name)) {
      if (on && !has_effect(*known)) warn(token, "flag " + name + " has no effect");
      type->flags.set(*known, on);
    } else if (!is_idle_flag(name)) {
      warn(token, "unknown flag " + name);
    }
    return {};
  }

  Status property(const Token& first, PropertyTarget* target) {
    std::string name = lower_case(first.text);
    while (lexer_.peek().is(".")) {
      lexer_.next();
      name += "." + lower_case(lexer_.next().text);
      if (name.size() > kNameLettersMax) return error_at(first, "the name of a property is too long");
    }
    if (name == "skip_super") {
      ActorType fresh = catalog_.derived(*catalog_.find("Actor"), target->type->name);
      fresh.parent = target->type->parent, fresh.replaces = target->type->replaces;
      fresh.editor_number = target->type->editor_number;
      *target->type = std::move(fresh);
      return {};
    }
    const PropertyShape shape = property_shape(name);
    if (shape == PropertyShape::kUnknown) {
      warn(first, "unknown property " + name);
      skip_property(first.line);
      return {};
    }
    if (shape == PropertyShape::kNoValues) {
      apply_property(target, name, {});
      return {};
    }
    std::vector<DecorateValue> values;
    while (true) {
      COMRAD_TRY_ASSIGN(DecorateValue value, read_property_value(&lexer_, names()));
      values.push_back(std::move(value));
      if (values.size() > kArgsMax) return error_at(first, "too many values of " + name);
      const Token next = lexer_.peek();
      if (next.is(",")) {
        lexer_.next();
      } else if (next.line != first.line ||
                 (next.kind != Token::Kind::kInteger && next.kind != Token::Kind::kDecimal &&
                  next.kind != Token::Kind::kText)) {
        break;
      }
    }
    if (const std::optional<std::string> wrong = apply_property(target, name, values))
      return error_at(first, name + ": " + *wrong);
    return {};
  }

  /// What an unknown property may have behind it: the rest of its line, as far as the actor continues.
  void skip_property(int32_t line) {
    for (Token next = lexer_.peek(); next.line == line; next = lexer_.peek()) {
      if (next.is("}") || next.is("{") || next.kind == Token::Kind::kEnd || next.kind == Token::Kind::kBroken)
        return;
      lexer_.next();
    }
  }

  // ---------------------------------------------------------------- states

  Status state_block(StateProgram* states, const std::string& actor_name) {
    if (lexer_.peek().is("(")) {  // "States(Actor, Weapon)": whose they are
      while (!lexer_.peek().is("{") && lexer_.peek().kind != Token::Kind::kEnd &&
             lexer_.peek().kind != Token::Kind::kBroken)
        lexer_.next();
    }
    COMRAD_TRY(expect("{"));
    std::string sprite = "TNT1";
    char frame = 'A';
    while (true) {
      if (const Token next = lexer_.peek(); next.is("}")) {
        lexer_.next();
        return {};
      } else if (next.is(";")) {
        lexer_.next();
        continue;
      } else if (next.kind == Token::Kind::kEnd || next.kind == Token::Kind::kBroken) {
        return error_at(next,
                        next.text.empty() ? "States of " + actor_name + " have no closing '}'" : next.text);
      }
      const Token word = lexer_.word();
      if (word.text.empty()) return error_at(word, "'" + lexer_.next().text + "' where a state must stand");
      if (lexer_.peek().is(":")) {
        lexer_.next();
        if (word.text.size() > kNameLettersMax) return error_at(word, "a state label is too long");
        if (++label_count_ > kLabelsPerTypeMax * kActorsMax) return error_at(word, "too many state labels");
        states->add_label(word.text);
        continue;
      }
      bool good = true;
      if (word.is_name("loop")) {
        good = states->loop();
      } else if (word.is_name("wait")) {
        good = states->wait();
      } else if (word.is_name("stop")) {
        good = states->stop();
      } else if (word.is_name("fail")) {
        good = states->fail();
      } else if (word.is_name("goto")) {
        COMRAD_TRY_ASSIGN(StateTarget target, read_target());
        good = states->go_to(std::move(target));
      } else {
        COMRAD_TRY(state(states, word, &sprite, &frame));
      }
      if (!good) {
        // "stop" behind "goto" and the like: never reached, and common in old lumps.
        if (states->size() > 0) continue;
        return error_at(word, "'" + word.text + "' without a state before it");
      }
    }
  }

  /// "See", "Missile.Rocket+2", "Super::See".
  Expected<StateTarget> read_target() {
    StateTarget target;
    Token word = lexer_.word();
    target.line = word.line, target.column = word.column;
    if (lexer_.peek().is("::")) {
      lexer_.next();
      target.scope = word.text;
      word = lexer_.word();
    }
    return split_target(std::move(target), word.text, word);
  }

  /// "Label+3" into its parts; a "+ 3" that stands apart is read from the lump.
  Expected<StateTarget> split_target(StateTarget target, std::string_view text, const Token& where,
                                     bool in_text = false) {
    if (const std::size_t scope = text.find("::"); scope != std::string_view::npos) {
      target.scope = text.substr(0, scope);
      text.remove_prefix(scope + 2);
    }
    const std::size_t plus = text.find('+');
    target.label = text.substr(0, plus);
    std::string digits;
    if (plus != std::string_view::npos) {
      digits = text.substr(plus + 1);
      if (digits.empty() && !in_text) digits = lexer_.next().text;
    } else if (!in_text && lexer_.peek().is("+")) {
      lexer_.next();
      digits = lexer_.next().text;
    }
    for (const char digit : digits) {
      if (digit < '0' || digit > '9' || digits.size() > 6)
        return error_at(where, "'" + digits + "' is no number of states");
      target.offset = target.offset * 10 + (digit - '0');
    }
    if (target.label.empty() || (plus != std::string_view::npos && digits.empty()))
      return error_at(where, "a state label is missing");
    return target;
  }

  static bool is_link(const Token& token) {
    for (const std::string_view link : {"loop", "wait", "stop", "fail", "goto"})
      if (token.is_name(link)) return true;
    return false;
  }
  bool label_follows() const {
    DecorateLexer ahead = lexer_;
    ahead.word();
    return ahead.next().is(":");
  }

  Status state(StateProgram* states, const Token& sprite_word, std::string* sprite, char* frame) {
    if (sprite_word.text.size() != 4)
      return error_at(sprite_word, "'" + sprite_word.text + "' is no sprite: they have four letters");
    // "####" and "----" keep what is shown; written down, that is the row before.
    if (sprite_word.text != "####" && sprite_word.text != "----") *sprite = sprite_word.text;
    const Token frames = lexer_.word();
    if (frames.text.empty() || frames.text.size() > 256)
      return error_at(frames, "the frames of '" + sprite_word.text + "' are missing");
    State state;
    state.sprite = catalog_.add_sprite(*sprite);

    COMRAD_TRY_ASSIGN(const DecorateValue tics, read_property_value(&lexer_, names()));
    if (tics.kind == DecorateValue::Kind::kText) return error_at(frames, "a state needs a duration in tics");
    const int32_t lowest = std::clamp(tics.integer(), -1, 32767);
    state.tics = static_cast<int16_t>(lowest);
    if (tics.kind == DecorateValue::Kind::kRandom) {
      state.tics = static_cast<int16_t>(std::max(lowest, 0));
      state.random_tics = static_cast<int16_t>(std::clamp(tics.high - state.tics, 0.0, 32767.0 - state.tics));
    }

    std::vector<PendingArg> args;
    bool has_action = false;
    for (Token next = lexer_.peek(); next.line == sprite_word.line; next = lexer_.peek()) {
      if (next.is("{")) {
        warn(next, "blocks of actions are not supported");
        COMRAD_TRY(skip_block(next));
        continue;
      }
      if (next.kind != Token::Kind::kName || has_action || is_link(next) || label_follows()) break;
      const Token word = lexer_.next();
      if (word.is_name("bright")) {
        state.bright = true;
      } else if (word.is_name("fast")) {
        state.fast = true;
      } else if (word.is_name("slow") || word.is_name("nodelay") || word.is_name("canraise")) {
        // slow-monster skills, actions at spawning, raising in this state
        if (!word.is_name("slow")) warn(word, "state keyword " + word.text + " has no effect");
      } else if (word.is_name("offset") || word.is_name("light")) {
        COMRAD_TRY(expect("("));
        COMRAD_TRY_ASSIGN(const DecorateValue first, read_expression(&lexer_, names()));
        DecorateValue second;
        if (lexer_.peek().is(",")) {
          lexer_.next();
          COMRAD_TRY_ASSIGN(second, read_expression(&lexer_, names()));
        }
        COMRAD_TRY(expect(")"));
        if (word.is_name("offset")) {
          state.offset_x = static_cast<int16_t>(std::clamp(first.integer(), -32768, 32767));
          state.offset_y = static_cast<int16_t>(std::clamp(second.integer(), -32768, 32767));
        }
      } else {
        has_action = true;
        COMRAD_TRY(action(word, &state, &args));
      }
    }

    for (const char letter : frames.text) {
      if (letter != '#') *frame = upper_case(letter);
      if (*frame < 'A' || *frame > ']')
        return error_at(frames, "'" + std::string(1, letter) + "' is no frame: they are A to Z, [, \\ and ]");
      state.frame = static_cast<uint8_t>(*frame - 'A');
      if (states->size() >= kStatesPerTypeMax) return error_at(frames, "too many states in one actor");
      states->add_state(state, args);
    }
    return {};
  }

  Status action(const Token& name, State* state, std::vector<PendingArg>* args) {
    std::optional<ActionId> id = find_action(name.text);
    // Every special of lines is an action too, by its name.
    if (const std::optional<int32_t> special = id ? std::nullopt : wad::find_special(name.text)) {
      id = ActionId::kCallSpecial;
      args->emplace_back().value = {ActionArg::Kind::kInteger, *special, 0};
    }
    if (!id) warn(name, "unknown action function " + name.text);
    state->action = id.value_or(ActionId::kNone);
    if (!lexer_.peek().is("(")) return {};
    lexer_.next();
    while (!lexer_.peek().is(")")) {
      COMRAD_TRY_ASSIGN(PendingArg arg,
                        argument(name, id ? argument_meaning(*id, args->size()) : ArgumentMeaning::kText));
      args->push_back(std::move(arg));
      if (args->size() > kArgsMax) return error_at(name, "too many arguments of " + name.text);
      if (!lexer_.peek().is(",")) break;
      lexer_.next();
    }
    if (!id) args->clear();
    return expect(")");
  }

  Expected<PendingArg> argument(const Token& action, ArgumentMeaning meaning) {
    PendingArg arg;
    const Token start = lexer_.peek();
    // "Super::See" without quotes reads like no expression.
    if (meaning == ArgumentMeaning::kLabel && start.kind == Token::Kind::kName) {
      arg.is_target = true;
      COMRAD_TRY_ASSIGN(arg.target, read_target());
      return arg;
    }
    COMRAD_TRY_ASSIGN(const DecorateValue value, read_expression(&lexer_, names()));
    using Kind = ActionArg::Kind;
    if (value.kind != DecorateValue::Kind::kText) {
      if (meaning == ArgumentMeaning::kLabel) {
        arg.is_target = value.integer() != 0;  // so many states further on; 0: nowhere
        arg.target.offset = value.integer();
        arg.target.line = start.line, arg.target.column = start.column;
      } else if (value.kind == DecorateValue::Kind::kRandom) {
        if (value.step != 1.0 && value.step != -1.0)
          warn(start, action.text + ": a draw times a number is drawn evenly between its ends");
        DecorateValue high;
        high.number = value.high;
        arg.value = {Kind::kRandom, value.integer(), high.integer()};
      } else {
        arg.value = value.decimal ? ActionArg{Kind::kFixed, value.fixed_cut(), 0}
                                  : ActionArg{Kind::kInteger, value.integer(), 0};
      }
      return arg;
    }
    const bool is_nothing = value.text.empty() || same_ignoring_case(value.text, "none") ||
                            same_ignoring_case(value.text, "null");
    switch (meaning) {
      case ArgumentMeaning::kLabel: {
        if (is_nothing) return arg;
        arg.is_target = true;
        arg.target.line = start.line, arg.target.column = start.column;
        COMRAD_TRY_ASSIGN(arg.target, split_target(std::move(arg.target), value.text, start, true));
        return arg;
      }
      case ArgumentMeaning::kClass:
        if (is_nothing) return arg;
        if (const std::optional<uint32_t> type = catalog_.find(value.text)) {
          arg.value = {Kind::kType, static_cast<int32_t>(*type), 0};
        } else {
          warn(start, action.text + ": unknown actor '" + value.text + "'");
        }
        return arg;
      case ArgumentMeaning::kNumber:
        if (value.name) {
          warn(start, action.text + ": '" + value.text +
                          "' is no constant; values of the running game are not supported");
          arg.value = {Kind::kInteger, 0, 0};
          return arg;
        }
        break;
      case ArgumentMeaning::kText:
        break;
    }
    arg.value = {Kind::kText, catalog_.add_text(value.text), 0};
    return arg;
  }

  std::string_view text_;
  DecorateLexer lexer_;
  std::string label_;
  ActorCatalog& catalog_;
  std::vector<std::string>* warnings_;
  const DecorateIncludes& includes_;
  int include_depth_ = 0;
  std::size_t warnings_left_ = kWarningsMax;
  std::unordered_set<std::string> warned_;
  std::unordered_set<std::string> reserved_;  // named in this lump and not read yet
  std::unordered_map<std::string, double> constants_;
  std::size_t actor_count_ = 0, label_count_ = 0;
};

}  // namespace

Status parse_decorate(std::string_view text, const std::string& label, ActorCatalog* catalog,
                      std::vector<std::string>* warnings, const DecorateIncludes& includes) {
  ActorCatalog changed = *catalog;
  const Status status = DecorateParser(text, label, &changed, warnings, includes).run();
  if (!status) return Error{status.error().code, label + ":" + status.error().message};
  changed.refresh_known();
  *catalog = std::move(changed);
  return {};
}

}  // namespace comrad::doom
