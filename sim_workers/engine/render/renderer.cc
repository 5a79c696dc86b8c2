#include "sim_workers/engine/render/renderer.h"

#include <algorithm>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/log.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/art_atlas.h"
#include "sim_workers/engine/render/context_provider.h"
#include "sim_workers/engine/render/overlay.h"
#include "sim_workers/engine/render/picture.h"
#include "sim_workers/engine/render/rasterizer.h"
#include "sim_workers/engine/render/scene.h"
#include "sim_workers/engine/render/view_builder.h"

namespace comrad::doom {
namespace {

constexpr int kSizeMax = 4096;
constexpr std::size_t kScenesKept = 64;  // levels remembered; more layouts than that come and go

class QuadRenderer : public Renderer {
 public:
  QuadRenderer(std::shared_ptr<const ArtArchive> art, const RenderOptions& options,
               std::unique_ptr<Rasterizer> rasterizer, std::optional<StatusBar> bar)
      : options_(options),
        projection_(make_projection(options)),
        atlas_(art),
        rasterizer_(std::move(rasterizer)),
        builder_(projection_, &atlas_),
        overlay_(std::move(bar), options.width, options.height, projection_.rows),
        colors_(*art),
        words_(static_cast<std::size_t>(projection_.width) * projection_.rows) {}

  Status prepare(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog) override {
    if (!scenes_.contains(level.get())) {
      COMRAD_TRY_ASSIGN(std::unique_ptr<Scene> scene, Scene::create(level, &atlas_));
      if (scenes_.size() >= kScenesKept) scenes_.clear();
      scenes_.emplace(level.get(), std::move(scene));
    }
    if (!sprites_.contains(catalog.get())) {
      COMRAD_TRY_ASSIGN(std::unique_ptr<SpriteTable> table, SpriteTable::create(catalog, &atlas_, false));
      sprites_.emplace(catalog.get(), std::move(table));
    }
    return {};
  }

  void draw(std::span<const ViewRequest> views) override {
    rasterizer_->make_current();
    for (const ViewRequest& view : views) draw_one(view);
  }

 private:
  const Scene& scene(const World& world) {
    const auto found = scenes_.find(&world.level());
    if (found != scenes_.end()) return *found->second;
    Expected<std::unique_ptr<Scene>> created = Scene::create(world.shared_level(), &atlas_);
    if (!created) {
      spdlog::error("level {}: {}; it is drawn without art", world.level().name, created.error().message);
      created = Scene::create(std::make_shared<const Level>(), &atlas_);
      COMRAD_CHECK(created.has_value(), "an empty level has a scene");
    }
    if (scenes_.size() >= kScenesKept) scenes_.clear();
    return *scenes_.emplace(&world.level(), std::move(created).value()).first->second;
  }

  const SpriteTable& sprites(const World& world) {
    const auto found = sprites_.find(&world.catalog());
    if (found != sprites_.end()) return *found->second;
    Expected<std::unique_ptr<SpriteTable>> created =
        SpriteTable::create(world.shared_catalog(), &atlas_, true);
    if (!created) {
      spdlog::error("{}; sprites are not drawn", created.error().message);
      created = SpriteTable::create(std::make_shared<const ActorCatalog>(), &atlas_, true);
      COMRAD_CHECK(created.has_value(), "the built-in actors have sprites");
    }
    return *sprites_.emplace(&world.catalog(), std::move(created).value()).first->second;
  }

  void draw_one(const ViewRequest& request) {
    const World& world = *request.world;
    const Player& player = world.player(request.player);
    const Actor& body = world.body(request.player);
    SceneView view;
    view.scene = &scene(world);
    view.sectors = world.sectors();
    view.actors = world.actors();
    view.sprites = &sprites(world);
    view.hidden_actor_id = body.id;
    view.eye_x = to_double(body.x), view.eye_y = to_double(body.y), view.eye_z = to_double(player.view_z);
    view.angle = body.angle;
    builder_.build(view, &list_);
    rasterizer_->update_atlas(atlas_);
    rasterizer_->draw(list_, words_.data());

    const int palette = options_.screen_flashes ? flash_palette(player.damage_flash, player.bonus_flash) : 0;
    const std::size_t plane = static_cast<std::size_t>(options_.width) * options_.height;
    colors_.convert(words_, atlas_.texels(), palette, plane, request.destination);
    if (options_.crosshair && world.options().crosshair)
      overlay_.draw_crosshair(player.health, request.destination);
    if (options_.status_bar)
      overlay_.draw_status_bar(status_bar_state(world, request.player), palette, colors_.lit(palette),
                               request.destination);
    overlay_.draw_boxes(world.hud(), request.player, request.destination);
  }

  RenderOptions options_;
  Projection projection_;
  ArtAtlas atlas_;
  std::unique_ptr<Rasterizer> rasterizer_;
  ViewBuilder builder_;
  Overlay overlay_;
  ColorTables colors_;
  DrawList list_;
  std::vector<TexelWord> words_;
  // Scenes and tables keep their level and catalog alive, so an address is never that of a newer one.
  std::unordered_map<const Level*, std::unique_ptr<Scene>> scenes_;
  std::unordered_map<const ActorCatalog*, std::unique_ptr<SpriteTable>> sprites_;
};

}  // namespace

Expected<std::unique_ptr<Renderer>> Renderer::create(std::shared_ptr<const ArtArchive> art,
                                                     const RenderOptions& options) {
  if (options.width < 8 || options.height < 8 || options.width > kSizeMax || options.height > kSizeMax)
    return Error{ErrorCode::kBadInput, "render size " + std::to_string(options.width) + "x" +
                                           std::to_string(options.height) +
                                           ": each side must be 8 to 4096 pixels"};
  if (!(options.fov_degrees >= 5 && options.fov_degrees <= 170) || !(options.screen_aspect > 0.1))
    return Error{ErrorCode::kBadInput,
                 "field of view must be 5 to 170 degrees and the screen aspect positive"};
  std::optional<StatusBar> bar;
  if (options.status_bar) {
    COMRAD_TRY_ASSIGN(bar, StatusBar::create(*art));
  }
  COMRAD_TRY_ASSIGN(std::unique_ptr<ContextProvider> context, ContextProvider::create(options.provider));
  const Projection projection = make_projection(options);
  COMRAD_TRY_ASSIGN(std::unique_ptr<Rasterizer> rasterizer,
                    Rasterizer::create(std::move(context), projection.width, projection.rows));
  return std::unique_ptr<Renderer>(
      std::make_unique<QuadRenderer>(std::move(art), options, std::move(rasterizer), std::move(bar)));
}

}  // namespace comrad::doom
