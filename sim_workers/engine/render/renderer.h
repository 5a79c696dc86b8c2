// Draws players' views of worlds, by a painter of our own or with OpenGL, straight into the caller's memory as planar RGB. One renderer per thread; it serves every world of its Level set. Stage:
// render.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/words.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

class ArtArchive;  // textures, flats, sprites, palette of the IWAD and PWADs (render/art_archive.h)

struct RenderOptions {
  int width = 128, height = 72;      ///< size drawn at
  double screen_aspect = 4.0 / 3.0;  ///< projection of a 160x120 screen whatever the drawn size
  double fov_degrees = 90.0;
  bool status_bar = true;  ///< classic full-width bar, bottom 32/200
  bool weapon = true;      ///< the weapon in hand
  bool crosshair = true;
  bool screen_flashes = true;
  bool hud_text = true;  ///< what scripts put into the frame
  RendererKind renderer = RendererKind::kPainter;
};

/// One view to draw: `player` of `world` into `destination` [3, height, width] u8, planar RGB.
struct ViewRequest {
  const World* world = nullptr;
  int player = 0;
  uint8_t* destination = nullptr;
};

/// A thing that a view shows, in its picture of labels.
struct ThingLabel {
  uint8_t value = 0;  ///< of its pixels
  uint32_t actor_id = 0;
  int left = 0, top = 0, right = 0, bottom = 0;  ///< its pixels lie in [left, right) x [top, bottom)
};

/// Errors of create: kUnsupported when no OpenGL can be had (with what to install), kNotFound for missing art.
class Renderer {
 public:
  static Expected<std::unique_ptr<Renderer>> create(std::shared_ptr<const ArtArchive> art,
                                                    const RenderOptions& options);
  virtual ~Renderer() = default;
  /// Loads the art of `level`; sprites are loaded when they are first seen. Call it once per level: then
  /// draw() meets nothing unknown. draw() registers a level it has not seen by itself. Unknown textures are a
  /// warning in the log and drawn as a checkerboard, unknown sprites a warning and not drawn. Errors:
  /// kNoSpace when the art of this level alone does not fit the atlas.
  virtual Status prepare(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog) = 0;
  /// Draws all views; several at once cost less than one by one. Worlds may differ in level.
  virtual void draw(std::span<const ViewRequest> views) = 0;
  /// Pixels of the view drawn last that nothing covered; a level without holes leaves none. For tests.
  virtual int undrawn_pixels() = 0;
  /// What the driver complained of since the last call (a GL error code; 0: nothing). For tests.
  virtual unsigned driver_error() = 0;
  /// How far away what a view shows is, without overlays: `depth` [rows above the status bar, width] f32, map
  /// units ahead of the eye; see-through surfaces count as solid, the weapon is left out, 0 is open sky. For
  /// measurements; it draws the view once more. Returns the rows.
  virtual int draw_depth(const World& world, int player, std::vector<float>* depth) = 0;
  /// What is seen where, as ViZDoom labels it: `labels` [rows above the status bar, width] u8. Walls and sky are 0,
  /// floors and ceilings 1, the weapon in hand 255; the things that show get their own values between, the nearer
  /// the higher (of more than 253 the farthest get 0). `things`: those, by rising value; the weapon's is the body
  /// that holds it. Costs a view more. Returns the rows.
  virtual int draw_labels(const World& world, int player, std::vector<uint8_t>* labels,
                          std::vector<ThingLabel>* things) = 0;
  /// Sets (*seen)[linedef] for each line that the view shows a part of, openings between equal sectors left out;
  /// `seen` grows to the level's number of lines. For maps of what was seen.
  virtual void mark_seen_lines(const World& world, int player, std::vector<uint8_t>* seen) = 0;
};

}  // namespace comrad::doom
