// What stands among a view's surfaces and has holes: sprites and gratings from far to near, then the weapon in
// hand. Stage: render.
#pragma once

#include <cstdint>
#include <vector>

#include "sim_workers/engine/render/surfaces.h"

namespace comrad::doom {

/// Which of a sprite's eight sides faces an eye that looks along `to_thing` (from the eye to the thing).
inline int sprite_side(Angle to_thing, Angle thing_angle) {
  return static_cast<int>((to_thing - thing_angle + kAngle180 + kAngle45 / 2) >> 29);
}

class Sprites {
 public:
  Sprites(ViewFrame* frame, const Visibility* visibility, Surfaces* surfaces)
      : frame_(*frame), visibility_(*visibility), surfaces_(*surfaces) {}
  /// Adds the masked quads, after the surfaces'.
  void emit();

 private:
  /// A sprite, or a grating: a span with a see-through middle texture.
  struct Masked {
    const WallSpan* grating = nullptr;  ///< null for a sprite
    std::optional<uint32_t> own_span;   ///< its place among the spans
    Paint paint;
    float inverse = 0;
    int column_begin = 0, column_end = 0;
    // Of a sprite.
    float x_left = 0, x_right = 0, y_top = 0, y_bottom = 0, shade = 0;
    AtlasRegion region;
    int32_t mark = 0, subject = 0;
    bool mirrored = false;
    float inverse_at(int column) const {
      return grating == nullptr ? inverse : grating->inverse_at(centre_of(column));
    }
  };

  void collect_sprites();
  std::optional<Masked> place_sprite(const Actor& actor);
  void collect_gratings();
  void emit_masked();
  void emit_sprite(const Masked& sprite, float run_left, float run_right, const Surfaces::Clip& clip);
  void emit_grating(const Masked& grating, float run_left, float run_right, const Surfaces::Clip& clip);
  void emit_hand();
  void begin_masked(bool blended);
  void cover_blended(float left, float top, float right, float bottom);

  ViewFrame& frame_;
  const Visibility& visibility_;
  Surfaces& surfaces_;
  std::vector<Masked> masked_;
};

}  // namespace comrad::doom
