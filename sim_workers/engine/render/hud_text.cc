#include "sim_workers/engine/render/hud_text.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>

#include "rollout_buffer/core/log.h"

namespace comrad::doom {
namespace {

constexpr char kEscape = '\x1C';
constexpr int kReferenceRows = 120;  // text is no larger than on this screen; on a smaller one it shrinks
constexpr int kTextColorBold = 10;
constexpr std::size_t kCanvasesKept = 16;

/// What the levels [first, last] of a text colour become: from `dark` to `bright`.
struct Shades {
  int color, first, last;
  ArtArchive::Color dark, bright;
};
constexpr Shades kShades[] = {
    {0, 0, 256, {0x47, 0x00, 0x00}, {0xFF, 0xB8, 0xB8}},  // brick
    {1, 0, 256, {0x33, 0x2B, 0x13}, {0xFF, 0xEB, 0xDF}},  // tan
    {2, 0, 256, {0x27, 0x27, 0x27}, {0xEF, 0xEF, 0xEF}},  // gray
    {3, 0, 256, {0x0B, 0x17, 0x07}, {0x77, 0xFF, 0x6F}},  // green
    {4, 0, 256, {0x53, 0x3F, 0x2F}, {0xBF, 0xA7, 0x8F}},  // brown
    {5, 0, 256, {0x73, 0x2B, 0x00}, {0xFF, 0xFF, 0x73}},  // gold
    {6, 0, 256, {0x3F, 0x00, 0x00}, {0xFF, 0x00, 0x00}},  // red
    {7, 0, 256, {0x00, 0x00, 0x27}, {0x00, 0x00, 0xFF}},  // blue
    {8, 0, 256, {0x20, 0x00, 0x00}, {0xFF, 0x80, 0x00}},  // orange
    {9, 0, 256, {0x24, 0x24, 0x24}, {0xFF, 0xFF, 0xFF}},  // white
    {10, 0, 64, {0x27, 0x27, 0x27}, {0x51, 0x51, 0x51}},  // yellow
    {10, 65, 207, {0x78, 0x49, 0x18}, {0xF3, 0xA7, 0x18}},
    {10, 208, 256, {0xF3, 0xA8, 0x2A}, {0xFC, 0xD0, 0x43}},
    {12, 0, 256, {0x13, 0x13, 0x13}, {0x50, 0x50, 0x50}},  // black
    {13, 0, 256, {0x00, 0x00, 0x73}, {0xB4, 0xB4, 0xFF}},  // light blue
    {14, 0, 256, {0xCF, 0x83, 0x53}, {0xFF, 0xD7, 0xBB}},  // cream
    {15, 0, 256, {0x2F, 0x37, 0x1F}, {0x7B, 0x7F, 0x50}},  // olive
    {16, 0, 256, {0x0B, 0x17, 0x07}, {0x43, 0x93, 0x37}},  // dark green
    {17, 0, 256, {0x2B, 0x00, 0x00}, {0xAF, 0x2B, 0x2B}},  // dark red
    {18, 0, 256, {0x1F, 0x17, 0x0B}, {0xA3, 0x6B, 0x3F}},  // dark brown
    {19, 0, 256, {0x23, 0x00, 0x23}, {0xCF, 0x00, 0xCF}},  // purple
    {20, 0, 256, {0x23, 0x23, 0x23}, {0x8B, 0x8B, 0x8B}},  // dark gray
    {21, 0, 256, {0x00, 0x1F, 0x1F}, {0x00, 0xF0, 0xF0}},  // cyan
};

/// Names in \c[Name] escapes, in the order of the numbers.
constexpr std::array<std::string_view, kTextColorCount> kColorNames = {
    "brick",     "tan",     "gray",      "green",        "brown",    "gold",      "red",   "blue",
    "orange",    "white",   "yellow",    "untranslated", "black",    "lightblue", "cream", "olive",
    "darkgreen", "darkred", "darkbrown", "purple",       "darkgray", "cyan"};

int luminance(const ArtArchive::Color& color) { return color[0] * 77 + color[1] * 143 + color[2] * 37; }

uint32_t u16(std::span<const uint8_t> bytes, std::size_t at) {
  return bytes[at] | static_cast<uint32_t>(bytes[at + 1]) << 8;
}

}  // namespace

// The reference engine brings accented letters for such a font along, and a line is as high as its highest letter.
constexpr int kAccentedHeight = 9;

Font Font::from_graphics(const ArtArchive& archive, std::string_view prefix, int last_letter) {
  Font font;
  for (int code = '!'; code <= last_letter; ++code) {
    char name[16];
    std::snprintf(name, sizeof name, "%.5s%03d", std::string(prefix).c_str(), code);
    const Expected<IndexedImage> image = archive.graphic(name);
    if (!image) continue;
    font.add(code, Glyph{.width = image->width,
                         .height = image->height,
                         .left_offset = image->left_offset,
                         .top_offset = image->top_offset,
                         .texels = image->texels,
                         .levels = {}});
  }
  if (const Glyph* wide = font.glyph('N')) font.space_width_ = (wide->width + 1) / 2;
  font.finish(archive);
  font.height_ = std::max(font.height_, kAccentedHeight);
  return font;
}

Expected<Font> Font::from_fon2(std::span<const uint8_t> lump, const ArtArchive& archive) {
  const auto broken = [](const char* what) {
    return Error{ErrorCode::kBadFormat, std::string("font of format FON2: ") + what};
  };
  if (lump.size() < 12 || lump[0] != 'F' || lump[1] != 'O' || lump[2] != 'N' || lump[3] != '2')
    return broken("no FON2 header");
  const int height = static_cast<int>(u16(lump, 4)), first = lump[6], last = lump[7];
  const bool constant_width = lump[8] != 0, has_kerning = (lump[11] & 1) != 0;
  const std::size_t color_count = std::size_t{lump[10]} + 1;
  if (height < 1 || height > 256 || last < first) return broken("impossible sizes");
  std::size_t at = 12;
  Font font;
  if (has_kerning) {
    if (at + 2 > lump.size()) return broken("cut short");
    font.kerning_ = std::clamp<int>(static_cast<int16_t>(u16(lump, at)), -64, 64);
    at += 2;
  }
  const std::size_t count = static_cast<std::size_t>(last - first) + 1;
  const std::size_t width_bytes = 2 * (constant_width ? 1 : count);
  if (at + width_bytes + 3 * color_count > lump.size()) return broken("cut short");
  std::vector<int> widths;
  for (std::size_t i = 0; i < count; ++i)
    widths.push_back(static_cast<int>(u16(lump, at + (constant_width ? 0 : 2 * i))));
  at += width_bytes;
  std::array<uint8_t, 256> colors{};
  for (std::size_t i = 1; i + 1 < color_count; ++i)  // the first and the last are holes
    colors[i] = archive.nearest({lump[at + 3 * i], lump[at + 3 * i + 1], lump[at + 3 * i + 2]});
  at += 3 * color_count;
  for (std::size_t i = 0; i < count; ++i) {
    if (widths[i] == 0) continue;
    if (widths[i] > 256) return broken("a letter is wider than 256 texels");
    Glyph glyph{
        .width = widths[i], .height = height, .left_offset = 0, .top_offset = 0, .texels = {}, .levels = {}};
    const std::size_t size = static_cast<std::size_t>(widths[i]) * static_cast<std::size_t>(height);
    while (glyph.texels.size() < size) {
      if (at >= lump.size()) return broken("the letters are cut short");
      const int code = static_cast<int8_t>(lump[at++]);
      if (code == -128) continue;
      const std::size_t run = static_cast<std::size_t>(code >= 0 ? code + 1 : 1 - code);
      const std::size_t bytes = code >= 0 ? run : 1;
      if (at + bytes > lump.size() || glyph.texels.size() + run > size)
        return broken("a run of texels passes the end of its letter");
      for (std::size_t k = 0; k < run; ++k) glyph.texels.push_back(colors[lump[at + (code >= 0 ? k : 0)]]);
      at += bytes;
    }
    font.add(first + static_cast<int>(i), std::move(glyph));
  }
  if (const Glyph* space = font.glyph(' ')) {
    font.space_width_ = space->width;
  } else if (const Glyph* wide = font.glyph('N')) {
    font.space_width_ = (wide->width + 1) / 2;
  }
  font.finish(archive);
  font.height_ = height;
  return font;
}

void Font::finish(const ArtArchive& archive) {
  int darkest = INT32_MAX, brightest = 0;
  const auto each = [&](auto visit) {
    for (Glyph& glyph : glyphs_)
      for (std::size_t i = 0; i < glyph.texels.size(); ++i)
        if (glyph.texels[i] != kTransparentIndex)
          visit(glyph, i, luminance(archive.palette(0)[glyph.texels[i]]));
  };
  each([&](Glyph&, std::size_t, int bright) {
    darkest = std::min(darkest, bright), brightest = std::max(brightest, bright);
  });
  for (Glyph& glyph : glyphs_) {
    glyph.levels.assign(glyph.texels.size(), 0);
    height_ = std::max(height_, glyph.height - std::min(0, glyph.top_offset));
  }
  each([&](Glyph& glyph, std::size_t i, int bright) {
    glyph.levels[i] =
        static_cast<uint16_t>((bright - darkest) * (kTextLevels - 1) / std::max(1, brightest - darkest));
  });
}

void Font::add(int letter, Glyph glyph) {
  if (letter < 0 || letter > 255) return;
  by_letter_[static_cast<std::size_t>(letter)] = static_cast<int16_t>(glyphs_.size());
  glyphs_.push_back(std::move(glyph));
}

const Glyph* Font::glyph(unsigned char letter) const {
  int16_t found = by_letter_[letter];
  if (found < 0 && std::isalpha(letter))
    found = by_letter_[static_cast<unsigned char>(std::isupper(letter) ? std::tolower(letter)
                                                                       : std::toupper(letter))];
  return found < 0 ? nullptr : &glyphs_[static_cast<std::size_t>(found)];
}

int Font::advance(unsigned char letter) const {
  const Glyph* found = glyph(letter);
  if (found != nullptr) return found->width + kerning_;
  return space_width_ + kerning_;  // a letter that the font does not have leaves a gap
}

HudText::HudText(std::shared_ptr<const ArtArchive> archive, int width, int height, int view_rows,
                 double screen_aspect)
    : archive_(std::move(archive)),
      width_(width),
      height_(height),
      view_rows_(view_rows),
      screen_aspect_(screen_aspect) {}

const Font& HudText::font(std::string_view name) {
  std::string key(name);
  for (char& letter : key) letter = static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
  if (const auto found = fonts_.find(key); found != fonts_.end()) return found->second;
  Font made;
  for (const std::string& lump :
       key == "BIGFONT" ? std::vector<std::string>{"BIGFONT", "DBIGFONT"} : std::vector<std::string>{key}) {
    const std::span<const uint8_t> bytes = archive_->bytes(lump);
    if (bytes.empty()) continue;
    Expected<Font> read = Font::from_fon2(bytes, *archive_);
    if (read) made = std::move(read).value();
    if (!made.empty()) break;
  }
  // As in ZDoom the small font has no letters behind the underscore: `|`, `{` and `}` are gaps.
  if (made.empty()) made = Font::from_graphics(*archive_, "STCFN", key == "SMALLFONT" ? '_' : '~');
  if (made.empty())
    spdlog::warn("font {}: no letters in the IWAD or the PWADs; its texts are not drawn", key);
  return fonts_.emplace(std::move(key), std::move(made)).first->second;
}

const Glyph* HudText::graphic(const std::string& name) {
  if (const auto found = graphics_.find(name); found != graphics_.end()) return &found->second;
  Glyph made;
  if (Expected<IndexedImage> image = archive_->graphic(name)) {
    made.width = image->width, made.height = image->height;
    made.left_offset = image->left_offset, made.top_offset = image->top_offset;
    made.texels = std::move(image->texels);
    made.levels.assign(made.texels.size(), 0);
  } else {
    spdlog::warn("{}; the script's picture is not drawn", image.error().message);
  }
  return &graphics_.emplace(name, std::move(made)).first->second;
}

const HudText::Ramp& HudText::ramp(int color) {
  const auto at = static_cast<std::size_t>(color);
  if (ramp_made_[at]) return ramps_[at];
  ramp_made_[at] = true;
  for (const Shades& shades : kShades) {
    if (shades.color != color) continue;
    for (int level = shades.first; level <= shades.last; ++level) {
      ArtArchive::Color shade{};
      for (std::size_t channel = 0; channel < 3; ++channel) {
        const int dark = shades.dark[channel], bright = shades.bright[channel];
        shade[channel] = static_cast<uint8_t>(dark + (bright - dark) * (level - shades.first) /
                                                         (shades.last - shades.first));
      }
      // The reference engine leaves out the palette's last entry here.
      ramps_[at][static_cast<std::size_t>(level)] = archive_->nearest(shade, 254);
    }
  }
  return ramps_[at];
}

HudText::Phase HudText::phase(const acs::HudMessage& message, std::size_t letter_count) {
  Phase result;
  int64_t age = message.age_tics;
  if (message.kind == 2 && message.type_tics > 0) {
    const int64_t typing = int64_t{message.type_tics} * static_cast<int64_t>(letter_count) >> kFracBits;
    if (age < typing) {
      result.letters = static_cast<std::size_t>((age << kFracBits) / message.type_tics);
      result.alpha = message.alpha;
      return result;
    }
    age -= typing;
  }
  const auto share = [](int64_t part, int64_t whole) {
    return std::clamp(static_cast<float>(part) / static_cast<float>(whole), 0.0f, 1.0f);
  };
  if (age < message.fade_in_tics)
    result.alpha = share(age, message.fade_in_tics);
  else if (message.hold_tics > 0 && message.fade_out_tics > 0 &&
           age >= int64_t{message.fade_in_tics} + message.hold_tics)
    result.alpha = 1.0f - share(age - message.fade_in_tics - message.hold_tics, message.fade_out_tics);
  result.alpha *= message.alpha;
  return result;
}

/// Takes the escapes out of a text; every letter gets its colour.
void HudText::spell(const acs::HudMessage& message) {
  letters_.clear();
  const auto own = static_cast<uint8_t>(
      message.color >= 0 && message.color < kTextColorCount ? message.color : kTextColorPlain);
  uint8_t color = own;
  const std::string& text = message.text;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool escaped = text[i] == kEscape;
    if (!escaped && !(text[i] == '\\' && i + 1 < text.size() && text[i + 1] == 'c')) {
      letters_.push_back({static_cast<unsigned char>(text[i]), color});
      continue;
    }
    i += escaped ? 1 : 2;
    if (i >= text.size()) break;
    const int code = std::tolower(static_cast<unsigned char>(text[i]));
    if (code >= 'a' && code < 'a' + kTextColorCount) {
      color = static_cast<uint8_t>(code - 'a');
    } else if (code == '-') {
      color = own;
    } else if (code == '+') {
      color = kTextColorBold;
    } else if (code == '[') {
      const std::size_t end = text.find(']', i);
      if (end == std::string::npos) break;
      std::string name = text.substr(i + 1, end - i - 1);
      for (char& letter : name) letter = static_cast<char>(std::tolower(static_cast<unsigned char>(letter)));
      const auto found = std::find(kColorNames.begin(), kColorNames.end(), name);
      if (found != kColorNames.end()) color = static_cast<uint8_t>(found - kColorNames.begin());
      i = end;
    }
  }
}

/// Breaks the letters into lines, at their ends and between words.
void HudText::wrap(const Font& font, int width) {
  lines_.clear();
  Line line;
  std::size_t word = 0;  // begin of the present word, and the line's width before it
  int width_before_word = 0;
  for (std::size_t i = 0; i < letters_.size(); ++i) {
    const unsigned char code = letters_[i].code;
    if (code == '\n') {
      line.end = i;
      lines_.push_back(line);
      line = {.begin = i + 1, .end = i + 1, .width = 0};
      word = i + 1, width_before_word = 0;
      continue;
    }
    if (code == ' ') word = i + 1, width_before_word = line.width;
    const int advance = font.advance(code);
    if (width > 0 && line.width + advance > width && word > line.begin && code != ' ') {
      lines_.push_back({.begin = line.begin, .end = word - 1, .width = width_before_word});
      line = {.begin = word, .end = i, .width = 0};
      for (std::size_t k = word; k < i; ++k) line.width += font.advance(letters_[k].code);
      width_before_word = 0;
    }
    line.width += advance;
  }
  line.end = letters_.size();
  lines_.push_back(line);
}

int HudText::Axis::first_pixel(int unit) const {
  if (units.empty()) return static_cast<int>(std::floor(begin + unit * pixels_per_unit));
  return static_cast<int>(std::ranges::lower_bound(units, unit) - units.begin());
}

const HudText::Canvas& HudText::canvas(const acs::HudMessage& message) {
  const bool own_size = message.hud_width > 0 && message.hud_height > 0;
  const int hud_width = own_size ? message.hud_width : 0, hud_height = own_size ? message.hud_height : 0;
  const bool covers_bar = own_size && message.hud_covers_bar;
  for (const Canvas& known : canvases_)
    if (known.hud_width == hud_width && known.hud_height == hud_height && known.covers_bar == covers_bar)
      return known;
  if (canvases_.size() >= kCanvasesKept) canvases_.clear();
  Canvas canvas;
  canvas.hud_width = hud_width, canvas.hud_height = hud_height, canvas.covers_bar = covers_bar;
  const double below = static_cast<double>(view_rows_) / height_;  // part of the screen above the bar
  const auto scale = [](Axis* axis, int pixels, double begin, double share, double units) {
    axis->begin = begin, axis->pixels_per_unit = pixels * share / units;
    axis->step = static_cast<int64_t>(65536.0 / axis->pixels_per_unit);
  };
  if (own_size) {
    // The 4:3 part in the middle of the screen; it ends above the status bar unless the script requires it too.
    const double wide = std::min(1.0, (4.0 / 3.0) / screen_aspect_);
    canvas.width = hud_width, canvas.height = hud_height;
    scale(&canvas.across, width_, width_ * (1 - wide) / 2, wide, hud_width);
    scale(&canvas.down, height_, 0, covers_bar ? 1 : below, hud_height);
  } else {
    // A texel a pixel, as in ZDoom. Pictures smaller than its smallest screen show that one made smaller.
    const bool small = height_ < kReferenceRows;
    const double columns = small ? kReferenceRows * screen_aspect_ : width_;
    const double rows = small ? kReferenceRows : height_;
    canvas.width = static_cast<int>(std::lround(columns));
    canvas.height = static_cast<int>(std::lround(rows * below));
    scale(&canvas.across, width_, 0, 1, columns);
    scale(&canvas.down, height_, 0, 1, rows);
    for (auto& [axis, pixels] : {std::pair{&canvas.across, width_}, {&canvas.down, height_}})
      for (int pixel = 0; pixel < pixels; ++pixel)
        axis->units.push_back(static_cast<int>(std::floor((pixel + 0.5) / axis->pixels_per_unit)));
  }
  return canvases_.emplace_back(std::move(canvas));
}

HudText::Box HudText::clip(const acs::HudMessage& message, const Canvas& canvas) const {
  Box box{0, 0, width_, height_};
  if (message.clip[2] <= 0 || message.clip[3] <= 0) return box;
  const auto pixel = [&](const Axis& axis, int64_t unit) {
    return static_cast<int>(std::lround(std::clamp(axis.begin + unit * axis.pixels_per_unit, -1e5, 1e5)));
  };
  box.left = std::max(0, pixel(canvas.across, message.clip[0]));
  box.top = std::max(0, pixel(canvas.down, message.clip[1]));
  box.right = std::min(width_, pixel(canvas.across, int64_t{message.clip[0]} + message.clip[2]));
  box.bottom = std::min(height_, pixel(canvas.down, int64_t{message.clip[1]} + message.clip[3]));
  return box;
}

void HudText::draw(std::span<const acs::HudMessage> messages, int player, const uint32_t* colors,
                   uint8_t* picture) {
  for (const acs::HudMessage& message : messages) {
    if (message.player >= 0 && message.player != player) continue;
    if (!message.text.empty()) draw_text(message, colors, picture);
  }
}

void HudText::draw_text(const acs::HudMessage& message, const uint32_t* colors, uint8_t* picture) {
  std::string name = message.font.empty() ? "SMALLFONT" : message.font;
  for (char& letter : name) letter = static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
  const bool is_font = name == "SMALLFONT" || name == "BIGFONT" || name == "CONFONT" || name == "DBIGFONT" ||
                       name == "SMALLFNT" || name == "CONSOLEFONT";
  const Canvas& place = canvas(message);
  const Box box = clip(message, place);
  const Glyph* shown = is_font ? nullptr : graphic(name);
  const Font* letters = is_font ? &font(name) : nullptr;
  int box_width = 0, box_height = 0;
  if (shown != nullptr) {
    box_width = shown->width, box_height = shown->height;
  } else {
    spell(message);
    wrap(*letters, message.no_wrap ? 0 : message.wrap_width > 0 ? message.wrap_width : place.width);
    for (const Line& line : lines_) box_width = std::max(box_width, line.width);
    box_height = static_cast<int>(lines_.size()) * letters->height();
  }
  const Phase now = phase(message, message.text.size());
  if (now.alpha <= 0) return;

  bool centered = false;
  int left = 0, top = 0;
  if (message.hud_width > 0 && message.hud_height > 0) {
    // The whole part is the place; the tenths say of what: 0 the middle, 1 the left or upper edge, 2 the
    // right or lower one; 4 more centre each line.
    const auto tenths = [](Fixed value) {
      const Fixed part = std::abs(value % kFracUnit);
      return static_cast<int>((int64_t{part} * 10 + kFracUnit / 2) >> kFracBits);
    };
    const auto edge = [](int at, int size, int rule) {
      return rule == 1 ? at : rule == 2 ? at - size : at - size / 2;
    };
    centered = tenths(message.x) >= 4;
    left = edge(message.x / kFracUnit, box_width, tenths(message.x) % 4);
    top = edge(message.y / kFracUnit, box_height, tenths(message.y) % 4);
  } else {
    // 0 to 1: from one edge of the screen to the other as far as the box fits; below 0: its middle; beyond 1
    // and below -1 the same with each line centred.
    double x = to_double(message.x), y = to_double(message.y);
    if (std::abs(x) > 1) centered = true, x -= x > 0 ? 1 : -1;
    x = std::clamp(x, -1.0, 1.0), y = std::clamp(y, -1.0, 1.0);
    left = x >= 0 ? static_cast<int>((place.width - box_width) * x)
                  : static_cast<int>(-x * place.width) - box_width / 2;
    top = y >= 0 ? static_cast<int>((place.height - box_height) * y)
                 : static_cast<int>(-y * place.height) - box_height / 2;
  }

  if (shown != nullptr) {
    draw_glyph(*shown, kTextColorPlain, left, top, place, box, now.alpha, message.additive, colors, picture);
    return;
  }
  for (std::size_t row = 0; row < lines_.size(); ++row) {
    const Line& line = lines_[row];
    int x = left + (centered ? (box_width - line.width) / 2 : 0);
    for (std::size_t i = line.begin; i < line.end && i < now.letters; ++i) {
      const Letter& letter = letters_[i];
      if (const Glyph* glyph = letters->glyph(letter.code))
        draw_glyph(*glyph, letter.color, x, top + static_cast<int>(row) * letters->height(), place, box,
                   now.alpha, message.additive, colors, picture);
      x += letters->advance(letter.code);
    }
  }
}

void HudText::draw_glyph(const Glyph& glyph, int color, int x, int y, const Canvas& canvas, const Box& clip,
                         float alpha, bool additive, const uint32_t* colors, uint8_t* picture) {
  x -= glyph.left_offset, y -= glyph.top_offset;
  const int first_x = canvas.across.first_pixel(x), first_y = canvas.down.first_pixel(y);
  const int begin_x = std::max(clip.left, first_x),
            end_x = std::min(clip.right, canvas.across.first_pixel(x + glyph.width)),
            begin_y = std::max(clip.top, first_y),
            end_y = std::min(clip.bottom, canvas.down.first_pixel(y + glyph.height));
  const Ramp* shades = color == kTextColorPlain ? nullptr : &ramp(color);
  const std::size_t plane = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  const int share = static_cast<int>(alpha * 256.0f + 0.5f);
  const bool covers = share == 256 && !additive;
  for (int row = begin_y; row < end_y; ++row) {
    const int texel_row = std::min(canvas.down.texel(row, y, first_y), glyph.height - 1) * glyph.width;
    for (int column = begin_x; column < end_x; ++column) {
      const auto from = static_cast<std::size_t>(
          texel_row + std::min(canvas.across.texel(column, x, first_x), glyph.width - 1));
      const uint8_t texel = glyph.texels[from];
      if (texel == kTransparentIndex) continue;
      uint8_t* const at = picture + static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
                          static_cast<std::size_t>(column);
      const uint32_t rgb = colors[shades == nullptr ? texel : (*shades)[glyph.levels[from]]];
      for (std::size_t channel = 0; channel < 3; ++channel) {
        const int source = static_cast<int>(rgb >> (8 * channel) & 255), below = at[channel * plane];
        at[channel * plane] =
            static_cast<uint8_t>(covers     ? source
                                 : additive ? std::min(255, below + (source * share >> 8))
                                            : (source * share + below * (256 - share)) >> 8);
      }
    }
  }
}

}  // namespace comrad::doom
