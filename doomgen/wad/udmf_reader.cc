#include "doomgen/wad/udmf_reader.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <utility>

#include "rollout_buffer/core/text.h"

namespace comrad::wad {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_word_start(char c) { return (lower_case(c) >= 'a' && lower_case(c) <= 'z') || c == '_'; }

struct Token {
  enum class Kind { kEnd, kWord, kNumber, kText, kSign };
  Kind kind = Kind::kEnd;
  std::string text;  // word in lower case; text without quotes; the sign
  double number = 0;
  bool is_integer = false;
  int line = 1, column = 1;

  bool is_sign(char sign) const { return kind == Kind::kSign && text[0] == sign; }
  std::string shown() const {
    switch (kind) {
      case Kind::kEnd:
        return "the end of the text";
      case Kind::kText:
        return "a string";
      default:
        return "'" + text.substr(0, 32) + "'";
    }
  }
};

/// A block's key and value; the value is a number, a string or a word (true, false).
struct Assignment {
  std::string key;
  Token value;
};

class Parser {
 public:
  Parser(std::string_view text, const std::string& label) : text_(text), label_(label) {}

  Expected<UdmfMap> parse() {
    UdmfMap map;
    for (;;) {
      COMRAD_TRY_ASSIGN(const Token name, next());
      if (name.kind == Token::Kind::kEnd) {
        for (const std::string& field : unread_)
          map.warnings.push_back("the UDMF field '" + field + "' is not supported, its values are dropped");
        return map;
      }
      if (name.kind != Token::Kind::kWord)
        return wrong(name, "expected a key or the name of a block, found " + name.shown());
      COMRAD_TRY_ASSIGN(const Token sign, next());
      if (sign.is_sign('=')) {
        COMRAD_TRY_ASSIGN(Token value, value_and_semicolon(name.text));
        if (name.text == "namespace") {
          if (value.kind != Token::Kind::kText) return wrong(value, "namespace requires a string");
          map.name_space = value.text;
        }
      } else if (sign.is_sign('{')) {
        COMRAD_TRY(block(name, map));
      } else {
        return wrong(sign, "expected '=' or '{' after '" + name.text + "', found " + sign.shown());
      }
    }
  }

 private:
  Error wrong(int line, int column, const std::string& what) const {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: {}", label_, line, column, what)};
  }
  Error wrong(const Token& token, const std::string& what) const {
    return wrong(token.line, token.column, what);
  }

  // ---- characters

  bool at_end() const { return position_ >= text_.size(); }
  char peek(std::size_t ahead = 0) const {
    return position_ + ahead < text_.size() ? text_[position_ + ahead] : '\0';
  }
  void advance() {
    if (text_[position_] == '\n') {
      ++line_;
      column_ = 1;
    } else {
      ++column_;
    }
    ++position_;
  }

  Status skip_blanks() {
    while (!at_end()) {
      if (is_space(peek())) {
        advance();
      } else if (peek() == '/' && peek(1) == '/') {
        while (!at_end() && peek() != '\n') advance();
      } else if (peek() == '/' && peek(1) == '*') {
        const int line = line_, column = column_;
        advance(), advance();
        while (!at_end() && !(peek() == '*' && peek(1) == '/')) advance();
        if (at_end()) return wrong(line, column, "this comment never ends");
        advance(), advance();
      } else {
        break;
      }
    }
    return {};
  }

  // ---- tokens

  Expected<Token> next() {
    COMRAD_TRY(skip_blanks());
    Token token;
    token.line = line_, token.column = column_;
    if (at_end()) return token;
    const char c = peek();
    if (is_word_start(c)) {
      token.kind = Token::Kind::kWord;
      while (!at_end() && (is_word_start(peek()) || is_digit(peek()))) {
        token.text += lower_case(peek());
        advance();
      }
      return token;
    }
    if (c == '"') return string_token(std::move(token));
    if (is_digit(c) || ((c == '+' || c == '-' || c == '.') && (is_digit(peek(1)) || peek(1) == '.')))
      return number_token(std::move(token));
    if (c == '=' || c == '{' || c == '}' || c == ';') {
      token.kind = Token::Kind::kSign;
      token.text = c;
      advance();
      return token;
    }
    const auto code = static_cast<unsigned char>(c);
    return wrong(token, code >= 0x20 && code < 0x7F ? std::string("unexpected character '") + c + "'"
                                                    : fmt::format("unexpected byte {}", code));
  }

  Expected<Token> string_token(Token token) {
    token.kind = Token::Kind::kText;
    advance();
    while (!at_end() && peek() != '"') {
      if (peek() == '\\') advance();
      if (at_end()) break;
      token.text += peek();
      advance();
    }
    if (at_end()) return wrong(token, "this string never ends");
    advance();
    return token;
  }

  Expected<Token> number_token(Token token) {
    token.kind = Token::Kind::kNumber;
    while (!at_end() &&
           (is_digit(peek()) || is_word_start(peek()) || peek() == '.' || peek() == '+' || peek() == '-')) {
      token.text += peek();
      advance();
    }
    std::string_view digits = token.text;
    const bool negative = digits.front() == '-';
    if (negative || digits.front() == '+') digits.remove_prefix(1);
    const char* end = digits.data() + digits.size();
    uint64_t integer = 0;
    std::from_chars_result read{};
    if (digits.size() > 2 && digits[0] == '0' && lower_case(digits[1]) == 'x') {
      read = std::from_chars(digits.data() + 2, end, integer, 16);
      token.is_integer = true;
    } else if (digits.size() > 1 && std::all_of(digits.begin(), digits.end(), is_digit) && digits[0] == '0') {
      read = std::from_chars(digits.data(), end, integer, 8);
      token.is_integer = true;
    } else if (std::all_of(digits.begin(), digits.end(), is_digit)) {
      read = std::from_chars(digits.data(), end, integer, 10);
      token.is_integer = true;
    } else {
      read = std::from_chars(digits.data(), end, token.number, std::chars_format::general);
    }
    if (token.is_integer) token.number = static_cast<double>(integer);
    if (read.ec != std::errc() || read.ptr != end || !std::isfinite(token.number))
      return wrong(token, "'" + token.text.substr(0, 32) + "' is no number");
    if (negative) token.number = -token.number;
    return token;
  }

  Expected<Token> value_and_semicolon(const std::string& key) {
    COMRAD_TRY_ASSIGN(Token value, next());
    if (value.kind == Token::Kind::kEnd || value.kind == Token::Kind::kSign)
      return wrong(value, "expected a value for '" + key + "', found " + value.shown());
    COMRAD_TRY_ASSIGN(const Token semicolon, next());
    if (!semicolon.is_sign(';'))
      return wrong(semicolon, "expected ';' after the value of '" + key + "', found " + semicolon.shown());
    return value;
  }

  // ---- values of known keys

  Status read(const Assignment& from, int32_t& to) const {
    const Token& value = from.value;
    if (value.kind != Token::Kind::kNumber || value.number != std::floor(value.number) ||
        value.number < std::numeric_limits<int32_t>::min() ||
        value.number > std::numeric_limits<int32_t>::max())
      return wrong(value, "'" + from.key + "' requires a whole number of 32 bits, found " + value.shown());
    to = static_cast<int32_t>(value.number);
    return {};
  }
  Status read(const Assignment& from, double& to) const {
    if (from.value.kind != Token::Kind::kNumber)
      return wrong(from.value, "'" + from.key + "' requires a number, found " + from.value.shown());
    to = from.value.number;
    return {};
  }
  Status read(const Assignment& from, bool& to) const {
    if (from.value.kind != Token::Kind::kWord || (from.value.text != "true" && from.value.text != "false"))
      return wrong(from.value, "'" + from.key + "' requires true or false, found " + from.value.shown());
    to = from.value.text == "true";
    return {};
  }
  Status read(const Assignment& from, std::string& to) const {
    if (from.value.kind != Token::Kind::kText)
      return wrong(from.value, "'" + from.key + "' requires a string, found " + from.value.shown());
    to = upper_case(from.value.text);
    return {};
  }

  // ---- blocks

  /// A field that this engine does not know: it is named in a warning.
  Status unread() {
    is_read_ = false;
    return {};
  }
  static bool is_for_editors(const std::string& key) {
    return key == "comment" || key == "flags" || key.starts_with("user_");
  }

  /// Reads `key = value;` up to '}' and hands each to `take`.
  template <typename Take>
  Status assignments(const Token& name, Take&& take) {
    for (;;) {
      COMRAD_TRY_ASSIGN(Token key, next());
      if (key.is_sign('}')) return {};
      if (key.kind == Token::Kind::kEnd) return wrong(name, "this block of '" + name.text + "' never ends");
      if (key.kind != Token::Kind::kWord)
        return wrong(key, "expected a key or '}' in '" + name.text + "', found " + key.shown());
      COMRAD_TRY_ASSIGN(const Token sign, next());
      if (!sign.is_sign('='))
        return wrong(sign, "expected '=' after '" + key.text + "', found " + sign.shown());
      Assignment assignment;
      COMRAD_TRY_ASSIGN(assignment.value, value_and_semicolon(key.text));
      assignment.key = std::move(key.text);
      is_read_ = true;
      COMRAD_TRY(take(assignment));
      if (!is_read_ && !is_for_editors(assignment.key)) unread_.insert(name.text + " " + assignment.key);
    }
  }

  Status missing(const Token& name, const char* key) const {
    return wrong(name, "this " + name.text + " has no '" + key + "'");
  }

  static std::optional<std::size_t> numbered(const std::string& key, std::string_view prefix, char first,
                                             char last) {
    if (key.size() != prefix.size() + 1 || key.compare(0, prefix.size(), prefix) != 0) return std::nullopt;
    if (key.back() < first || key.back() > last) return std::nullopt;
    return static_cast<std::size_t>(key.back() - first);
  }

  Status block(const Token& name, UdmfMap& map) {
    if (name.text == "vertex") return vertex(name, map);
    if (name.text == "linedef") return linedef(name, map);
    if (name.text == "sidedef") return sidedef(name, map);
    if (name.text == "sector") return sector(name, map);
    if (name.text == "thing") return thing(name, map);
    return assignments(name, [](const Assignment&) { return Status(); });
  }

  Status vertex(const Token& name, UdmfMap& map) {
    UdmfVertex vertex;
    vertex.text_line = name.line;
    bool has_x = false, has_y = false;
    COMRAD_TRY(assignments(name, [&](const Assignment& a) -> Status {
      if (a.key == "x") return has_x = true, read(a, vertex.x);
      if (a.key == "y") return has_y = true, read(a, vertex.y);
      if (a.key == "zfloor" || a.key == "zceiling") return vertex.has_height = true, Status();
      return unread();
    }));
    if (!has_x || !has_y) return missing(name, has_x ? "y" : "x");
    map.vertices.push_back(vertex);
    return {};
  }

  Status linedef(const Token& name, UdmfMap& map) {
    static constexpr std::pair<std::string_view, bool UdmfLinedef::*> kLineFlags[] = {
        {"blockeverything", &UdmfLinedef::block_everything},
        {"blockfloaters", &UdmfLinedef::block_floaters},
        {"blockplayers", &UdmfLinedef::block_players},
        {"blockprojectiles", &UdmfLinedef::block_projectiles},
        {"blockhitscan", &UdmfLinedef::block_hitscan},
        {"blockuse", &UdmfLinedef::block_use},
        {"blocksight", &UdmfLinedef::block_sight},
        {"blocksound", &UdmfLinedef::block_sound},
        {"jumpover", &UdmfLinedef::jump_over},
        {"secret", &UdmfLinedef::secret},
        {"repeatspecial", &UdmfLinedef::repeat_special},
        {"firstsideonly", &UdmfLinedef::first_side_only},
        {"passuse", &UdmfLinedef::pass_use},
        {"checkswitchrange", &UdmfLinedef::check_switch_range},
        {"playercross", &UdmfLinedef::player_cross},
        {"playeruse", &UdmfLinedef::player_use},
        {"playerpush", &UdmfLinedef::player_push},
        {"playeruseback", &UdmfLinedef::player_use_back},
        {"monstercross", &UdmfLinedef::monster_cross},
        {"monsteruse", &UdmfLinedef::monster_use},
        {"monsterpush", &UdmfLinedef::monster_push},
        {"monsteractivate", &UdmfLinedef::monster_activate},
        {"impact", &UdmfLinedef::impact},
        {"missilecross", &UdmfLinedef::missile_cross},
        {"anycross", &UdmfLinedef::any_cross},
        {"translucent", &UdmfLinedef::translucent},
        {"transparent", &UdmfLinedef::transparent},
        {"wrapmidtex", &UdmfLinedef::wrap_midtex},
        {"clipmidtex", &UdmfLinedef::clip_midtex},
    };
    UdmfLinedef line;
    line.text_line = name.line;
    bool has_v1 = false, has_v2 = false, has_front = false;
    COMRAD_TRY(assignments(name, [&](const Assignment& a) -> Status {
      if (a.key == "v1") return has_v1 = true, read(a, line.v1);
      if (a.key == "v2") return has_v2 = true, read(a, line.v2);
      if (a.key == "sidefront") return has_front = true, read(a, line.side_front);
      if (a.key == "sideback") return read(a, line.side_back);
      if (a.key == "id") return read(a, line.id);
      if (a.key == "special") return read(a, line.special);
      if (a.key == "blocking") return read(a, line.blocking);
      if (a.key == "blockmonsters") return read(a, line.block_monsters);
      if (a.key == "twosided") return read(a, line.two_sided);
      if (a.key == "dontpegtop") return read(a, line.dont_peg_top);
      if (a.key == "dontpegbottom") return read(a, line.dont_peg_bottom);
      if (a.key == "alpha") return read(a, line.alpha);
      if (a.key == "renderstyle") return read(a, line.render_style);
      if (a.key == "arg0str") return read(a, line.arg0_text);
      if (a.key == "locknumber") return read(a, line.lock_number);
      if (const auto index = numbered(a.key, "arg", '0', '4')) return read(a, line.args[*index]);
      for (const auto& [key, flag] : kLineFlags)
        if (a.key == key) return read(a, line.*flag);
      if (a.key == "midtex3d" || a.key == "midtex3dimpassible") return read(a, line.midtex_3d);
      return unread();
    }));
    if (!has_v1 || !has_v2 || !has_front) return missing(name, !has_v1 ? "v1" : !has_v2 ? "v2" : "sidefront");
    map.linedefs.push_back(line);
    return {};
  }

  Status sidedef(const Token& name, UdmfMap& map) {
    UdmfSidedef side;
    side.text_line = name.line;
    bool has_sector = false;
    COMRAD_TRY(assignments(name, [&](const Assignment& a) -> Status {
      if (a.key == "sector") return has_sector = true, read(a, side.sector);
      if (a.key == "offsetx") return read(a, side.offset_x);
      if (a.key == "offsety") return read(a, side.offset_y);
      if (a.key == "texturetop") return read(a, side.texture_top);
      if (a.key == "texturebottom") return read(a, side.texture_bottom);
      if (a.key == "texturemiddle") return read(a, side.texture_middle);
      if (a.key == "light") return read(a, side.light);
      if (a.key == "lightabsolute") return read(a, side.light_absolute);
      if (a.key == "nofakecontrast") return read(a, side.no_fake_contrast);
      if (a.key == "smoothlighting") return read(a, side.smooth_lighting);
      if (a.key == "wrapmidtex") return read(a, side.wrap_midtex);
      if (a.key == "clipmidtex") return read(a, side.clip_midtex);
      static constexpr std::string_view kParts[] = {"_top", "_mid", "_bottom"};
      for (std::size_t part = 0; part < side.parts.size(); ++part) {
        if (!std::string_view(a.key).ends_with(kParts[part])) continue;
        const std::string_view what = std::string_view(a.key).substr(0, a.key.size() - kParts[part].size());
        if (what == "offsetx") return read(a, side.parts[part].offset_x);
        if (what == "offsety") return read(a, side.parts[part].offset_y);
        if (what == "scalex") return read(a, side.parts[part].scale_x);
        if (what == "scaley") return read(a, side.parts[part].scale_y);
      }
      return unread();
    }));
    if (!has_sector) return missing(name, "sector");
    map.sidedefs.push_back(std::move(side));
    return {};
  }

  Status sector(const Token& name, UdmfMap& map) {
    UdmfSector sector;
    sector.text_line = name.line;
    COMRAD_TRY(assignments(name, [&](const Assignment& a) -> Status {
      if (a.key == "heightfloor") return read(a, sector.height_floor);
      if (a.key == "heightceiling") return read(a, sector.height_ceiling);
      if (a.key == "texturefloor") return read(a, sector.texture_floor);
      if (a.key == "textureceiling") return read(a, sector.texture_ceiling);
      if (a.key == "lightlevel") return read(a, sector.light_level);
      if (a.key == "special") return read(a, sector.special);
      if (a.key == "id") return read(a, sector.id);
      if (a.key == "damageamount") return read(a, sector.damage_amount);
      if (a.key == "damageinterval") return read(a, sector.damage_interval);
      if (a.key == "damagetype") return read(a, sector.damage_type);
      if (a.key == "leakiness") return read(a, sector.leakiness);
      if (a.key == "gravity") return read(a, sector.gravity);
      if (a.key == "lightcolor") return read(a, sector.light_color);
      if (a.key == "fadecolor") return read(a, sector.fade_color);
      if (a.key == "silent") return read(a, sector.silent);
      if (a.key == "hidden") return read(a, sector.hidden);
      if (a.key == "secret") return read(a, sector.secret);
      if (a.key == "nofallingdamage") return read(a, sector.no_falling_damage);
      if (a.key == "moreids") return read(a, sector.more_ids);
      if (a.key.starts_with("floorplane_") || a.key.starts_with("ceilingplane_"))
        return sector.is_sloped = true, Status();
      for (auto* plane : {&sector.floor, &sector.ceiling}) {
        const std::string end = plane == &sector.floor ? "floor" : "ceiling";
        if (a.key == "xpanning" + end) return read(a, plane->panning_x);
        if (a.key == "ypanning" + end) return read(a, plane->panning_y);
        if (a.key == "xscale" + end) return read(a, plane->scale_x);
        if (a.key == "yscale" + end) return read(a, plane->scale_y);
        if (a.key == "rotation" + end) return read(a, plane->rotation);
        if (a.key == "light" + end) return read(a, plane->light);
        if (a.key == "light" + end + "absolute") return read(a, plane->light_absolute);
      }
      return unread();
    }));
    if (sector.texture_floor.empty() || sector.texture_ceiling.empty())
      return missing(name, sector.texture_floor.empty() ? "texturefloor" : "textureceiling");
    map.sectors.push_back(std::move(sector));
    return {};
  }

  /// A number with a point is none to ViZDoom, also 1.0.
  Status thing_health(const Assignment& from, int32_t& to) const {
    if (from.value.kind == Token::Kind::kNumber && !from.value.is_integer) return to = 0, Status();
    return read(from, to);
  }

  Status thing(const Token& name, UdmfMap& map) {
    UdmfThing thing;
    thing.text_line = name.line;
    bool has_x = false, has_y = false, has_type = false;
    COMRAD_TRY(assignments(name, [&](const Assignment& a) -> Status {
      if (a.key == "x") return has_x = true, read(a, thing.x);
      if (a.key == "y") return has_y = true, read(a, thing.y);
      if (a.key == "type") return has_type = true, read(a, thing.type);
      if (a.key == "height") return read(a, thing.height);
      if (a.key == "id") return read(a, thing.id);
      if (a.key == "angle") return read(a, thing.angle);
      if (a.key == "special") return read(a, thing.special);
      if (a.key == "single") return read(a, thing.single);
      if (a.key == "coop") return read(a, thing.coop);
      if (a.key == "dm") return read(a, thing.dm);
      if (a.key == "ambush") return read(a, thing.ambush);
      if (a.key == "dormant") return read(a, thing.dormant);
      if (const auto index = numbered(a.key, "arg", '0', '4')) return read(a, thing.args[*index]);
      if (const auto index = numbered(a.key, "skill", '1', '8')) return read(a, thing.skill[*index]);
      if (a.key.starts_with("class") && a.key.size() <= 7) return thing_class(a, thing.class_filter);
      if (a.key == "standing") return read(a, thing.standing);
      if (a.key == "friend" || a.key == "strifeally") return read(a, thing.friendly);
      if (a.key == "invisible") return read(a, thing.invisible);
      if (a.key == "translucent") return read(a, thing.translucent);
      if (a.key == "countsecret") return read(a, thing.count_secret);
      if (a.key == "pitch") return read(a, thing.pitch);
      if (a.key == "alpha") return read(a, thing.alpha);
      if (a.key == "health") return thing_health(a, thing.health);
      if (a.key == "gravity") return read(a, thing.gravity);
      if (a.key == "score") return read(a, thing.score);
      if (a.key == "arg0str") return read(a, thing.arg0_text);
      if (a.key == "scalex") return read(a, thing.scale_x);
      if (a.key == "scaley") return read(a, thing.scale_y);
      if (a.key == "scale") return thing_scale(a, thing);
      return unread();
    }));
    if (!has_x || !has_y || !has_type) return missing(name, !has_x ? "x" : !has_y ? "y" : "type");
    map.things.push_back(thing);
    return {};
  }

  Status thing_scale(const Assignment& from, UdmfThing& thing) const {
    COMRAD_TRY(read(from, thing.scale_x));
    thing.scale_y = thing.scale_x;
    return {};
  }

  /// "class3 = false": not for the third player class.
  Status thing_class(const Assignment& from, uint32_t& filter) const {
    unsigned number = 0;
    const char* const end = from.key.data() + from.key.size();
    const std::from_chars_result digits = std::from_chars(from.key.data() + 5, end, number);
    if (digits.ec != std::errc() || digits.ptr != end || number < 1 || number > 16) return {};
    bool there = true;
    COMRAD_TRY(read(from, there));
    filter = there ? filter | 1u << (number - 1) : filter & ~(1u << (number - 1));
    return {};
  }

  std::string_view text_;
  const std::string& label_;
  std::set<std::string> unread_;  ///< "thing conversation"
  bool is_read_ = true;
  std::size_t position_ = 0;
  int line_ = 1, column_ = 1;
};

}  // namespace

Expected<UdmfMap> parse_udmf(std::string_view text, const std::string& label) {
  return Parser(text, label).parse();
}

}  // namespace comrad::wad
