// One picture while it is built: what is looked at, from where, into which list, and what the world's sectors
// and sides are at this moment. Visibility, surfaces and sprites share it. Stage: render.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "sim_workers/engine/render/draw_list.h"
#include "sim_workers/engine/render/projection.h"
#include "sim_workers/engine/render/scene.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// A picture held before the eye: the weapon in hand or its flash.
struct HandSprite {
  uint32_t sprite = 0;
  uint8_t frame = 0;
  bool bright = false;
  float x = 0, y = 0;  ///< Doom's place of a weapon on a screen of 320x200; y = 32 is raised
};

/// What one picture shows, apart from the scene's fixed parts.
struct SceneView {
  const Scene* scene = nullptr;
  std::span<const Sector> sectors;
  std::span<const SideState> sides;  ///< empty: as the level has them
  std::span<const LineState> lines;  ///< the same
  const StableList<Actor>* actors = nullptr;
  std::span<const Polyobject> polyobjects;
  SpriteTable* sprites = nullptr;
  uint32_t hidden_actor_id = 0;  ///< the viewer's own body
  double eye_x = 0, eye_y = 0, eye_z = 0;
  Angle angle = 0, pitch = 0;  ///< pitch: positive down
  int extra_light = 0;         ///< of a weapon's flash, 0..2
  std::span<const HandSprite> hand;
  RenderStyle hand_style = RenderStyle::kNormal;
  float hand_alpha = 1;
};

/// A sector as this picture shows it.
struct SectorNow {
  float floor = 0, ceiling = 0;
  float shade = 0, floor_shade = 0, ceiling_shade = 0;
  uint8_t tint = 0;  ///< into DrawList::tints
  const ScenePlane* floor_plane = nullptr;
  const ScenePlane* ceiling_plane = nullptr;
  uint64_t stamp = 0;
};

constexpr float kTwoPi = 6.28318530717958647692f;

inline bool same_placement(const FlatPlacement& a, const FlatPlacement& b) {
  return a.offset_x == b.offset_x && a.offset_y == b.offset_y && a.scale_x == b.scale_x &&
         a.scale_y == b.scale_y && a.rotation_degrees == b.rotation_degrees;
}

class ViewFrame {
 public:
  ViewFrame(const Projection& view_projection, ArtAtlas* art_atlas)
      : projection(view_projection), atlas(art_atlas) {}
  /// The next picture.
  void begin(const SceneView& next, DrawList* into);

  const SectorNow& sector(uint32_t index);
  /// The side with the textures that play has given it.
  const SceneSide& side_now(const SceneSide& side) {
    return side.sidedef >= view->sides.size() || !view->sides[side.sidedef].retextured ? side : changed(side);
  }
  /// side_now() of this side comes soon: each world has its sides for itself, and they lie far from any cache.
  void will_ask(const SceneSide& side) const {
    if (side.sidedef < view->sides.size()) __builtin_prefetch(&view->sides[side.sidedef].retextured);
  }
  /// How something of that style looks under a tint; nothing where it does not show at all. Where there are too many blends,
  /// the nearest.
  std::optional<Paint> paint(RenderStyle style, float alpha, uint8_t tint);
  /// Whether floors (or ceilings) of two sectors join without a border.
  bool same_plane_look(uint32_t one, uint32_t other, bool floor);
  /// Whether no border at all shows between them.
  bool same_look(uint32_t one, uint32_t other);
  float wall_shade(const SectorNow& now, const SceneSide& side) const;
  float rows() const { return static_cast<float>(projection.rows); }
  /// A row is center_y + row_factor(height) / depth.
  float row_factor(float height) const { return projection.focal_y * (eye_z - height); }

  const Projection projection;
  ArtAtlas* const atlas;
  const SceneView* view = nullptr;
  const Scene* scene = nullptr;
  DrawList* list = nullptr;
  float cosine = 1, sine = 0, eye_x = 0, eye_y = 0, eye_z = 0;
  float center_y = 0;  ///< of the projection, moved by the pitch
  uint64_t stamp = 0;  ///< number of the picture; what bears another is of an older one

 private:
  uint8_t tint(uint32_t color);
  const SceneSide& changed(const SceneSide& side);

  std::vector<SectorNow> sectors_;
  std::deque<ScenePlane> changed_planes_;  // textures that scripts set, of this picture
  std::deque<SceneSide> changed_sides_;
  std::vector<std::pair<uint64_t, const SceneSide*>> side_changes_;  // [sidedef] stamp and what it is now
};

}  // namespace comrad::doom
