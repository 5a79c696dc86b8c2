#include "sim_workers/engine/render/renderer.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/log.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/art_atlas.h"
#include "sim_workers/engine/render/context_provider.h"
#include "sim_workers/engine/render/hud_text.h"
#include "sim_workers/engine/render/labels.h"
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
        text_(art, options.width, options.height, projection_.rows, options.screen_aspect),
        colors_(art),
        words_(static_cast<std::size_t>(projection_.width) * static_cast<std::size_t>(projection_.rows)),
        layer_(words_.size()) {}

  Status prepare(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog) override {
    if (!scenes_.contains(level.get())) {
      COMRAD_TRY(add_scene(level));
    }
    (void)sprites(std::move(catalog));
    return {};
  }

  void draw(std::span<const ViewRequest> views) override {
    rasterizer_->make_current();
    const auto capacity = static_cast<std::size_t>(rasterizer_->capacity());
    for (std::size_t begin = 0; begin < views.size(); begin += capacity)
      draw_pass(views.subspan(begin, std::min(capacity, views.size() - begin)));
  }

  int undrawn_pixels() const override {
    return static_cast<int>(std::count(words_.begin(), words_.end(), TexelWord{0}));
  }

  unsigned driver_error() override {
    rasterizer_->make_current();
    return rasterizer_->driver_error();
  }

  int draw_depth(const World& world, int player, std::vector<float>* depth) override {
    rasterizer_->make_current();
    SceneView view = view_of(world, player);
    view.hand = {};
    lists_.resize(std::max<std::size_t>(lists_.size(), 1));
    builder_.build(view, &lists_[0]);
    rasterizer_->update_atlas(&atlas_);
    depth->resize(words_.size());
    rasterizer_->draw_depth(lists_[0], depth->data());
    return projection_.rows;
  }

  int draw_labels(const World& world, int player, std::vector<uint8_t>* labels,
                  std::vector<ThingLabel>* things) override {
    rasterizer_->make_current();
    const SceneView view = view_of(world, player);
    lists_.resize(std::max<std::size_t>(lists_.size(), 1));
    builder_.build(view, &lists_[0]);
    rasterizer_->update_atlas(&atlas_);
    layer_.resize(words_.size());
    rasterizer_->draw_subjects(lists_[0], layer_.data());
    label_subjects(lists_[0], layer_, projection_.width, world.actors(), view.hidden_actor_id, labels,
                   things);
    return projection_.rows;
  }

  void mark_seen_lines(const World& world, int player, std::vector<uint8_t>* seen) override {
    const SceneView view = view_of(world, player);
    lists_.resize(std::max<std::size_t>(lists_.size(), 1));
    builder_.look(view, &lists_[0]);
    seen->resize(std::max(seen->size(), view.scene->lines.size()));
    const Visibility& visibility = builder_.visibility();
    for (const uint32_t span : visibility.partial_spans()) (*seen)[visibility.spans()[span].line] = 1;
    for (const ViewColumn& column : visibility.columns())
      if (column.span) (*seen)[visibility.spans()[*column.span].line] = 1;
  }

 private:
  /// Makes the scene of a level. Where the atlas is full everything in it is forgotten, and loaded again as
  /// it is needed.
  Status add_scene(std::shared_ptr<const Level> level) {
    if (scenes_.size() >= kScenesKept) scenes_.clear();
    Expected<std::unique_ptr<Scene>> made = Scene::create(level, &atlas_);
    if (!made && made.error().code == ErrorCode::kNoSpace) {
      forget_art();
      made = Scene::create(level, &atlas_);
    }
    if (!made) return made.error();
    scenes_.emplace(level.get(), std::move(made).value());
    return {};
  }

  void forget_art() {
    scenes_.clear(), sprites_.clear();
    atlas_.clear();
    ++times_art_forgotten_;
  }

  const Scene& scene(const World& world) {
    const auto found = scenes_.find(&world.level());
    if (found != scenes_.end()) return *found->second;
    if (const Status added = add_scene(world.shared_level()); !added) {
      spdlog::error("level {}: {}; it is drawn without art", world.level().name, added.error().message);
      auto empty = Scene::create(std::make_shared<const Level>(), &atlas_);
      COMRAD_CHECK(empty.has_value(), "an empty level has a scene");
      scenes_.emplace(&world.level(), std::move(empty).value());
    }
    return *scenes_.at(&world.level());
  }

  SpriteTable& sprites(std::shared_ptr<const ActorCatalog> catalog) {
    const auto found = sprites_.find(catalog.get());
    if (found != sprites_.end()) return *found->second;
    if (sprites_.size() >= kScenesKept) sprites_.clear();
    const ActorCatalog* key = catalog.get();
    return *sprites_.emplace(key, std::make_unique<SpriteTable>(std::move(catalog), &atlas_)).first->second;
  }

  SceneView view_of(const World& world, int player) {
    SceneView view;
    view.scene = &scene(world);
    view.sectors = view.scene->level().sectors.empty() ? std::span<const Sector>{} : world.sectors();
    view.sides = world.sides(), view.lines = world.lines();
    view.actors = &world.actors();
    view.polyobjects = world.state().movers.polyobjects;
    view.sprites = &sprites(world.shared_catalog());
    place_eye(world, player, &view);
    return view;
  }

  /// As many views as one pass of the rasterizer takes.
  void draw_pass(std::span<const ViewRequest> views) {
    lists_.resize(std::max(lists_.size(), views.size()));
    bool atlas_full = false;
    const int art_at_start = times_art_forgotten_;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const SceneView view = view_of(*views[i].world, views[i].player);
      if (i > 0 && times_art_forgotten_ != art_at_start) {
        // The levels of these views do not fit the atlas together, and the lists so far point into the
        // old one.
        for (std::size_t alone = 0; alone < views.size(); ++alone) draw_pass(views.subspan(alone, 1));
        return;
      }
      builder_.build(view, &lists_[i]);
      atlas_full |= view.sprites->atlas_full();
    }
    rasterizer_->update_atlas(&atlas_);
    for (const bool blended : {false, true}) {
      drawn_together_.clear(), requests_.clear();
      for (std::size_t i = 0; i < views.size(); ++i)
        if (lists_[i].has_blended == blended)
          drawn_together_.push_back(&lists_[i]), requests_.push_back(views[i]);
      if (drawn_together_.empty()) continue;
      rasterizer_->draw(drawn_together_);
      for (std::size_t i = 0; i < requests_.size(); ++i) finish(requests_[i], i);
    }
    if (atlas_full) forget_art();
  }

  /// Colours of the picture that was drawn at a place of drawn_together_, and what lies over the view.
  void finish(const ViewRequest& request, std::size_t place) {
    const DrawList& list = *drawn_together_[place];
    const World& world = *request.world;
    const Player& player = world.player(request.player);
    rasterizer_->read(place, words_.data());
    const int palette = options_.screen_flashes ? screen_palette(player) : 0;
    const std::size_t plane =
        static_cast<std::size_t>(options_.width) * static_cast<std::size_t>(options_.height);
    const PictureColors colors =
        colors_.select(palette, player_sight(player), std::span(list.tints).first(list.tint_count));
    convert(words_, atlas_.texels(), colors, plane, request.destination);
    if (list.has_blended) {
      rasterizer_->read_layer(place, list.blended_box, layer_.data());
      blend_layer(layer_, list.blended_box, atlas_.texels(), colors,
                  std::span(list.blends).first(list.blend_count), options_.width, plane, request.destination);
    }
    const uint32_t* lit = colors_.lit(palette);
    if (options_.crosshair && world.options().crosshair)
      overlay_.draw_crosshair(player.health, palette, lit, request.destination);
    if (options_.status_bar)
      overlay_.draw_status_bar(status_bar_state(world, request.player), palette, lit, request.destination);
    if (options_.hud_text)
      text_.draw(world.state().scripts.hud_messages, request.player, lit, request.destination);
  }

  /// The player's eyes, or those of what its camera is; its weapon where the eyes are its own.
  void place_eye(const World& world, int player_index, SceneView* view) {
    const Player& player = world.player(player_index);
    const Actor& body = world.body(player_index);
    const Actor* camera = player.camera_id == 0 ? nullptr : world.find_actor(player.camera_id);
    const Actor& eye = camera == nullptr ? body : *camera;
    view->hidden_actor_id = eye.id;
    view->eye_x = to_double(eye.x), view->eye_y = to_double(eye.y);
    view->eye_z = eye.player_index >= 0 ? to_double(world.player(eye.player_index).view_z)
                                        : to_double(eye.z) + to_double(eye.height) / 2;
    view->angle = eye.angle, view->pitch = eye.pitch;
    view->extra_light = player.extra_light;
    if (!options_.weapon || eye.id != body.id) return;
    const ActorCatalog& catalog = world.catalog();
    std::size_t count = 0;
    for (const WeaponSprite& held : player.weapon_sprites) {
      if (held.state >= catalog.state_count()) continue;
      const State& state = catalog.state(held.state);
      if (state.sprite == 0) continue;
      hand_[count++] = {.sprite = state.sprite,
                        .frame = state.frame,
                        .bright = state.bright,
                        .x = to_float(held.x),
                        .y = to_float(held.y)};
    }
    view->hand = std::span(hand_).first(count);
    if (power_shows(player, PowerKind::kInvisibility))
      view->hand_style = RenderStyle::kFuzzy;
    else
      view->hand_style = body.render_style, view->hand_alpha = body.alpha;
  }

  RenderOptions options_;
  Projection projection_;
  ArtAtlas atlas_;
  int times_art_forgotten_ = 0;
  std::unique_ptr<Rasterizer> rasterizer_;
  ViewBuilder builder_;
  Overlay overlay_;
  HudText text_;
  ColorTables colors_;
  std::vector<DrawList> lists_;
  std::vector<const DrawList*> drawn_together_;
  std::vector<ViewRequest> requests_;  // [place in drawn_together_]
  std::vector<TexelWord> words_, layer_;
  std::array<HandSprite, 2> hand_;
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
