// Texts and pictures that scripts put into the frame (acs::HudMessage): fonts, colours, places, fades,
// written by the CPU into the finished planar picture. A message without a HUD size of its own stands as on a
// screen of 160x120, whatever the size that is drawn. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/world/machine_state.h"

namespace comrad::doom {

constexpr int kTextColorCount = 26;  ///< CR_BRICK .. CR_TEAL
constexpr int kTextColorPlain = 11;  ///< CR_UNTRANSLATED: the letters' own colours

/// A letter: its picture, and how bright each texel is on a scale of its font.
struct Glyph {
  int width = 0, height = 0, left_offset = 0, top_offset = 0;
  std::vector<uint8_t> texels;      ///< palette indices, kTransparentIndex for holes
  std::vector<uint8_t> brightness;  ///< 0 the darkest texel of the font, 255 the brightest
};

class Font {
 public:
  Font() { by_letter_.fill(-1); }
  /// STCFN033 to that of `last_letter`: letters as graphics. Small letters stand in for missing capitals and
  /// the reverse.
  static Font from_graphics(const ArtArchive& archive, std::string_view prefix, int last_letter);
  /// A FON2 lump. Errors: kBadFormat.
  static Expected<Font> from_fon2(std::span<const uint8_t> lump, const ArtArchive& archive);

  const Glyph* glyph(unsigned char letter) const;
  int advance(unsigned char letter) const;  ///< of the pen, kerning included; 0 for letters of none
  int height() const { return height_; }
  bool empty() const { return glyphs_.empty(); }

 private:
  void add(int letter, Glyph glyph);
  void finish(const ArtArchive& archive);
  std::vector<Glyph> glyphs_;
  std::array<int16_t, 256> by_letter_;  // place in glyphs_; -1: none
  int height_ = 0, space_width_ = 4, kerning_ = 0;
};

class HudText {
 public:
  /// `view_rows`: rows above the status bar; `height` where there is none.
  HudText(std::shared_ptr<const ArtArchive> archive, int width, int height, int view_rows,
          double screen_aspect);

  /// Draws the messages of a player in their order. `colors`: the 256 packed colours of the present palette.
  void draw(std::span<const acs::HudMessage> messages, int player, const uint32_t* colors, uint8_t* picture);

  /// How visible a message is at its age, 0..1, and how many of its letters show.
  struct Phase {
    float alpha = 1;
    std::size_t letters = SIZE_MAX;
  };
  static Phase phase(const acs::HudMessage& message, std::size_t letter_count);

 private:
  struct Letter {
    unsigned char code = 0;
    uint8_t color = 0;
  };
  struct Line {
    std::size_t begin = 0, end = 0;  ///< into letters_
    int width = 0;
  };
  /// The screen that a message's places refer to, and which of its columns and rows lie under the pixels.
  struct Canvas {
    int hud_width = 0, hud_height = 0;  ///< of acs::HudMessage, as is
    bool covers_bar = false;
    int width = 0, height = 0;
    float scale_x = 1, scale_y = 1, left = 0;  ///< pixels a unit, and those left of the screen
    std::vector<int> columns, rows;            ///< [pixel]
  };
  struct Box {
    int left = 0, top = 0, right = 0, bottom = 0;  ///< pixels
  };
  const Font& font(std::string_view name);
  const Glyph* graphic(const std::string& name);
  const std::array<uint8_t, 256>& ramp(int color);
  const Canvas& canvas(const acs::HudMessage& message);
  Box clip(const acs::HudMessage& message, const Canvas& canvas) const;
  void spell(const acs::HudMessage& message);
  void wrap(const Font& font, int width);
  void draw_text(const acs::HudMessage& message, const uint32_t* colors, uint8_t* picture);
  void draw_glyph(const Glyph& glyph, int color, int x, int y, const Canvas& canvas, const Box& clip,
                  float alpha, bool additive, const uint32_t* colors, uint8_t* picture);

  std::shared_ptr<const ArtArchive> archive_;
  int width_, height_, view_rows_;
  double screen_aspect_;
  std::unordered_map<std::string, Font> fonts_;
  std::unordered_map<std::string, Glyph> graphics_;
  std::array<std::array<uint8_t, 256>, kTextColorCount> ramps_{};  // [color][brightness] palette index
  std::array<bool, kTextColorCount> ramp_made_{};
  std::vector<Letter> letters_;
  std::vector<Canvas> canvases_;
  std::vector<Line> lines_;
};

}  // namespace comrad::doom
