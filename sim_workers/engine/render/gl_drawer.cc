#include "sim_workers/engine/render/gl_drawer.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "sim_workers/engine/render/egl_context.h"
#include "sim_workers/engine/render/osmesa_context.h"
#include "sim_workers/engine/render/rasterizer.h"

namespace comrad::doom {
namespace {

class GlDrawer : public ViewDrawer {
 public:
  GlDrawer(const RenderOptions& options, const Projection& projection, ArtAtlas* atlas, ColorTables* colors,
           std::unique_ptr<Rasterizer> rasterizer)
      : projection_(projection),
        atlas_(*atlas),
        colors_(*colors),
        plane_(static_cast<std::size_t>(options.width) * static_cast<std::size_t>(options.height)),
        rasterizer_(std::move(rasterizer)),
        words_(static_cast<std::size_t>(projection.width) * static_cast<std::size_t>(projection.rows)),
        layer_(words_.size()) {}

  std::size_t capacity() const override { return static_cast<std::size_t>(rasterizer_->capacity()); }

  void draw(std::span<const DrawList* const> lists) override {
    rasterizer_->make_current();
    rasterizer_->update_atlas(&atlas_);
    drawn_.assign(lists.begin(), lists.end());
    quads_.resize(std::max(quads_.size(), lists.size()));
    quad_lists_.clear();
    for (std::size_t i = 0; i < lists.size(); ++i) {
      make_quads(*lists[i], projection_, &quads_[i]);
      quad_lists_.push_back(&quads_[i]);
    }
    rasterizer_->draw(quad_lists_);
  }

  void finish(std::size_t place, int palette, Sight sight, uint8_t* destination) override {
    const DrawList& list = *drawn_[place];
    rasterizer_->read(place, words_.data());
    const PictureColors colors = colors_.select(palette, sight, std::span(list.tints).first(list.tint_count));
    convert(words_, atlas_.texels(), colors, plane_, destination);
    if (!list.has_blended) return;
    const PixelBox& box = quads_[place].blended_box;
    rasterizer_->read_layer(place, box, layer_.data());
    blend_layer(layer_, box, atlas_.texels(), colors, std::span(list.blends).first(list.blend_count),
                projection_.width, plane_, destination);
  }

  void draw_depth(const DrawList& list, float* depth) override {
    prepare_one(list);
    rasterizer_->draw_depth(quads_[0], depth);
  }

  void draw_subjects(const DrawList& list, uint32_t* subjects) override {
    prepare_one(list);
    rasterizer_->draw_subjects(quads_[0], subjects);
  }

  int undrawn_pixels() override { return static_cast<int>(std::ranges::count(words_, TexelWord{0})); }

  unsigned driver_error() override {
    rasterizer_->make_current();
    return rasterizer_->driver_error();
  }

 private:
  void prepare_one(const DrawList& list) {
    rasterizer_->make_current();
    rasterizer_->update_atlas(&atlas_);
    quads_.resize(std::max<std::size_t>(quads_.size(), 1));
    make_quads(list, projection_, &quads_[0]);
  }

  const Projection projection_;
  ArtAtlas& atlas_;
  ColorTables& colors_;
  const std::size_t plane_;  // pixels of a whole picture
  std::unique_ptr<Rasterizer> rasterizer_;
  std::vector<const DrawList*> drawn_;
  std::vector<QuadList> quads_;
  std::vector<const QuadList*> quad_lists_;
  std::vector<TexelWord> words_, layer_;
};

}  // namespace

Expected<std::unique_ptr<ViewDrawer>> create_gl_drawer(const RenderOptions& options,
                                                       const Projection& projection, ArtAtlas* atlas,
                                                       ColorTables* colors) {
  if (projection.rows < 1)
    return Error{ErrorCode::kBadInput, fmt::format("renderer {}: a picture of {}x{} has no row above the "
                                                   "status bar; draw a higher one, or use painter",
                                                   word_of(options.renderer), options.width, options.height)};
  COMRAD_TRY_ASSIGN(std::unique_ptr<ContextProvider> context,
                    options.renderer == RendererKind::kEgl ? create_egl_context() : create_osmesa_context());
  COMRAD_TRY_ASSIGN(std::unique_ptr<Rasterizer> rasterizer,
                    Rasterizer::create(std::move(context), projection.width, projection.rows));
  return std::unique_ptr<ViewDrawer>(
      std::make_unique<GlDrawer>(options, projection, atlas, colors, std::move(rasterizer)));
}

}  // namespace comrad::doom
