// Texts and pictures that scripts put into the frame (acs::HudMessage): fonts, colours, places, fades,
// written by the CPU into the finished planar picture. A message without a HUD size is placed as on a
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

constexpr int kTextColorCount = 22;  ///< CR_BRICK .. CR_CYAN; later ones are the letters' own, as in ViZDoom
constexpr int kTextColorPlain = 11;  ///< CR_UNTRANSLATED: the letters' own colours
constexpr int kTextLevels = 257;     ///< of brightness: 0 the darkest texel of a font, the last the brightest

/// A letter: its picture, and how bright each texel is on a scale of its font.
struct Glyph {
  int width = 0, height = 0, left_offset = 0, top_offset = 0;
  std::vector<uint8_t> texels;   ///< palette indices, kTransparentIndex for holes
  std::vector<uint16_t> levels;  ///< below kTextLevels
};

class Font {
 public:
  Font() { by_letter_.fill(-1); }
  /// STCFN033 to that of `last_letter`: letters as graphics. Small letters replace missing capitals and
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
  /// From a screen's units to pixels, across or down.
  struct Axis {
    double begin = 0, pixels_per_unit = 1;
    int64_t step = 0;  ///< units a pixel, 16.16; each picture is scaled by itself, from its corner
    std::vector<int>
        units;  ///< [pixel], instead of steps: a screen made smaller by taking the nearest pixels
    /// The first pixel that shows this unit or a later one.
    int first_pixel(int unit) const;
    /// Of a picture that begins at `unit` and at pixel `first`.
    int texel(int pixel, int unit, int first) const {
      return units.empty() ? static_cast<int>((pixel - first) * step >> 16)
                           : units[static_cast<std::size_t>(pixel)] - unit;
    }
  };
  /// The screen that a message's places refer to.
  struct Canvas {
    int hud_width = 0, hud_height = 0;  ///< of acs::HudMessage; 0: a unit a pixel
    bool covers_bar = false;
    int width = 0, height = 0;
    Axis across, down;
  };
  struct Box {
    int left = 0, top = 0, right = 0, bottom = 0;  ///< pixels
  };
  const Font& font(std::string_view name);
  const Glyph* graphic(const std::string& name);
  using Ramp = std::array<uint8_t, kTextLevels>;  ///< [level] palette index
  const Ramp& ramp(int color);
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
  std::array<Ramp, kTextColorCount> ramps_{};
  std::array<bool, kTextColorCount> ramp_made_{};
  std::vector<Letter> letters_;
  std::vector<Canvas> canvases_;
  std::vector<Line> lines_;
};

}  // namespace comrad::doom
