// What stands among a view's surfaces and has holes: sprites and gratings from far to near, then the weapon in
// hand. Stage: render.
#pragma once

#include <cstdint>
#include <utility>
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
  /// Adds the masked strips, after the surfaces'.
  void emit();

 private:
  /// A sprite, or a grating: a span with a see-through middle texture.
  struct Masked {
    const WallSpan* grating = nullptr;  ///< null for a sprite
    std::optional<uint32_t> own_span;   ///< its place among the spans
    float inverse = 0;                  ///< that decides the order
    Strip strip;                        ///< without edges that others cut into it
    float inverse_at(float x) const { return grating == nullptr ? inverse : grating->inverse.at(x); }
  };

  void collect_sprites();
  std::optional<Masked> place_sprite(const Actor& actor);
  void collect_gratings();
  void emit_masked();
  void emit_hand();
  void add(const Strip& strip, int begin, int end, const ColumnLine& top, const ColumnLine& bottom);

  ViewFrame& frame_;
  const Visibility& visibility_;
  Surfaces& surfaces_;
  std::vector<Masked> masked_;
  std::vector<std::pair<float, uint32_t>> order_;  // 1/depth and place in masked_, far to near
};

}  // namespace comrad::doom
