// What a view comes to: textured quads in drawing order, as the rasterizer takes them. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace comrad::doom {

/// A corner of a quad, as the vertex shader takes it.
struct QuadVertex {
  float x, y, z, w;     ///< clip coordinates
  float u, v;           ///< in repeats of the texture
  float width, height;  ///< of the texture, texels
  float shade;          ///< light row at infinite distance; see light_shade()
  int32_t address;      ///< of the texture in the atlas; above it the tint, or the blend
  int32_t picture =
      0;  ///< what it is of (DrawList::subject), until the rasterizer writes which picture it is in
};

/// Pixels [left, right) x [top, bottom).
struct PixelBox {
  int left = 0, top = 0, right = 0, bottom = 0;
};

constexpr int kTintsMax = 8, kBlendsMax = 8;

/// What a quad is of: these, and from kFirstActor on the actors by their place in the world's list.
enum Subject : int32_t { kWallSubject, kPlaneSubject, kWeaponSubject, kFirstActor };

/// How the texels of a see-through surface join the picture behind it.
struct Blend {
  enum class Kind : uint8_t { kMix, kAdd, kSubtract, kDarken } kind = Kind::kMix;
  uint8_t alpha = 255;
  bool operator==(const Blend&) const = default;
};

/// Quads in drawing order; four vertices each. Ranges count quads.
struct DrawList {
  std::vector<QuadVertex> vertices;
  uint32_t opaque_end = 0;  ///< [0, opaque_end): sky, walls, floors, ceilings, in painter's order
  /// [opaque_end, masked_end): sprites and gratings from far to near, then the weapon; transparent texels
  uint32_t masked_end = 0;
  /// The masked range in stretches that are all opaque or all blended. A blended texel goes to a layer of its
  /// own, an opaque one takes the layer away: the nearest see-through surface of a pixel counts.
  struct Run {
    uint32_t end = 0;
    bool blended = false;
  };
  std::vector<Run> masked_runs;
  bool has_blended = false;
  PixelBox blended_box;                             ///< pixels that blended quads may cover
  int32_t picture = 0;                              ///< which of the pictures of one pass this is
  std::array<uint32_t, kTintsMax> tints{0xFFFFFF};  ///< 0xRRGGBB by number; 0 is white
  uint32_t tint_count = 1;
  std::array<Blend, kBlendsMax> blends{};
  uint32_t blend_count = 0;
  int32_t subject = kWallSubject;  ///< of the quads that are added now

  uint32_t quad_count() const { return static_cast<uint32_t>(vertices.size() / 4); }
  void clear() {
    vertices.clear(), masked_runs.clear();
    opaque_end = masked_end = 0;
    has_blended = false;
    blended_box = {};
    tint_count = 1, blend_count = 0;
    subject = kWallSubject;
  }
};

/// Light row at infinite distance for a sector light of 0..255; a surface `depth` units away shows row
/// shade - min(24, kLightReach / depth), between 0 and 31. Fitted to frames of the reference engine.
inline float light_shade(int light) { return 64.0f - static_cast<float>(light + 12) * 0.25f; }
constexpr float kLightReach = 1280.0f;
constexpr float kLightNearest = 24.0f;

}  // namespace comrad::doom
