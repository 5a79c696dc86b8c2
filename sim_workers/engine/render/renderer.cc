#include "sim_workers/engine/render/renderer.h"

#include <spdlog/fmt/fmt.h>

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
#include "sim_workers/engine/render/hud_text.h"
#include "sim_workers/engine/render/labels.h"
#include "sim_workers/engine/render/overlay.h"
#include "sim_workers/engine/render/picture.h"
#include "sim_workers/engine/render/scene.h"
#include "sim_workers/engine/render/view_builder.h"
#include "sim_workers/engine/render/view_drawer.h"

namespace comrad::doom {
namespace {

constexpr int kSizeMax = 4096;
constexpr std::size_t kScenesKept = 64;  // levels remembered; more layouts than that come and go

class StripRenderer : public Renderer {
 public:
  StripRenderer(std::shared_ptr<const ArtArchive> art, const RenderOptions& options,
                std::optional<StatusBar> bar)
      : options_(options),
        projection_(make_projection(options)),
        atlas_(art),
        builder_(projection_, &atlas_),
        overlay_(std::move(bar), options.width, options.height, projection_.rows),
        text_(art, options.width, options.height, projection_.rows, options.screen_aspect),
        colors_(art) {}

  Status set_up() {
    COMRAD_TRY_ASSIGN(drawer_, ViewDrawer::create(options_, projection_, &atlas_, &colors_));
    return {};
  }

  Status prepare(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog) override {
    if (!scenes_.contains(level.get())) {
      COMRAD_TRY(add_scene(level));
    }
    (void)sprites(std::move(catalog));
    return {};
  }

  void draw(std::span<const ViewRequest> views) override {
    const std::size_t capacity = drawer_->capacity();
    for (std::size_t begin = 0; begin < views.size(); begin += capacity)
      draw_pass(views.subspan(begin, std::min(capacity, views.size() - begin)));
  }

  int undrawn_pixels() override { return drawer_->undrawn_pixels(); }
  unsigned driver_error() override { return drawer_->driver_error(); }

  int draw_depth(const World& world, int player, std::vector<float>* depth) override {
    SceneView view = view_of(world, player);
    view.hand = {};
    depth->resize(pixels());
    drawer_->draw_depth(build_one(view), depth->data());
    return projection_.rows;
  }

  int draw_labels(const World& world, int player, std::vector<uint8_t>* labels,
                  std::vector<ThingLabel>* things) override {
    const SceneView view = view_of(world, player);
    subjects_.resize(pixels());
    const DrawList& list = build_one(view);
    drawer_->draw_subjects(list, subjects_.data());
    label_subjects(list, subjects_, projection_.width, world.actors(), view.hidden_actor_id, labels, things);
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

  std::size_t pixels() const {
    return static_cast<std::size_t>(projection_.width) * static_cast<std::size_t>(projection_.rows);
  }

  const DrawList& build_one(const SceneView& view) {
    lists_.resize(std::max<std::size_t>(lists_.size(), 1));
    builder_.build(view, &lists_[0]);
    return lists_[0];
  }

  /// As many views as the drawer takes at once.
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
    for (const bool blended : {false, true}) {
      drawn_together_.clear(), requests_.clear();
      for (std::size_t i = 0; i < views.size(); ++i)
        if (lists_[i].has_blended == blended)
          drawn_together_.push_back(&lists_[i]), requests_.push_back(views[i]);
      if (drawn_together_.empty()) continue;
      drawer_->draw(drawn_together_);
      for (std::size_t i = 0; i < requests_.size(); ++i) finish(requests_[i], i);
    }
    if (atlas_full) forget_art();
  }

  /// Colours of the picture that was drawn at a place of drawn_together_, and what lies over the view.
  void finish(const ViewRequest& request, std::size_t place) {
    const World& world = *request.world;
    const Player& player = world.player(request.player);
    const int palette = options_.screen_flashes ? screen_palette(player) : 0;
    drawer_->finish(place, palette, player_sight(player), request.destination);
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
  ViewBuilder builder_;
  Overlay overlay_;
  HudText text_;
  ColorTables colors_;
  std::unique_ptr<ViewDrawer> drawer_;
  std::vector<DrawList> lists_;
  std::vector<const DrawList*> drawn_together_;
  std::vector<ViewRequest> requests_;  // [place in drawn_together_]
  std::vector<uint32_t> subjects_;
  std::array<HandSprite, 2> hand_;
  // Scenes and tables keep their level and catalog alive, so an address is never that of a newer one.
  std::unordered_map<const Level*, std::unique_ptr<Scene>> scenes_;
  std::unordered_map<const ActorCatalog*, std::unique_ptr<SpriteTable>> sprites_;
};

}  // namespace

Expected<std::unique_ptr<Renderer>> Renderer::create(std::shared_ptr<const ArtArchive> art,
                                                     const RenderOptions& options) {
  if (options.width < 1 || options.height < 1 || options.width > kSizeMax || options.height > kSizeMax)
    return Error{ErrorCode::kBadInput, fmt::format("render size {}x{}: each side must be 1 to 4096 pixels",
                                                   options.width, options.height)};
  if (!(options.fov_degrees >= 5 && options.fov_degrees <= 170) || !(options.screen_aspect > 0.1))
    return Error{ErrorCode::kBadInput,
                 "field of view must be 5 to 170 degrees and the screen aspect positive"};
  std::optional<StatusBar> bar;
  if (options.status_bar) {
    COMRAD_TRY_ASSIGN(bar, StatusBar::create(*art));
  }
  auto renderer = std::make_unique<StripRenderer>(std::move(art), options, std::move(bar));
  COMRAD_TRY(renderer->set_up());
  return std::unique_ptr<Renderer>(std::move(renderer));
}

}  // namespace comrad::doom
