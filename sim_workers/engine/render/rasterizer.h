// Draws a list of quads with OpenGL and reads back, per pixel, which texel of the atlas is seen and how
// bright: not colours but addresses, because a software rasterizer fetches texels and packs colours more
// slowly than the one pass over the finished picture that looks both up. Stage: render.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/render/context_provider.h"
#include "sim_workers/engine/render/gl_functions.h"
#include "sim_workers/engine/render/view_builder.h"

namespace comrad::doom {

/// A pixel of the result: tint << kTintShift | light row << kAddressBits | texel address. In the blended
/// layer the blend stands in the tint's place, and 0 means that nothing see-through covers the pixel.
using TexelWord = uint32_t;

class Rasterizer {
 public:
  /// Errors: kUnsupported when the context lacks what is needed.
  static Expected<std::unique_ptr<Rasterizer>> create(std::unique_ptr<ContextProvider> context, int width,
                                                      int rows);
  /// Makes the texture equal to the atlas if that changed.
  void update_atlas(ArtAtlas* atlas);
  /// Draws `list`; `words` [rows, width], top row first. `layer` of the same size is written where the list
  /// has blended quads.
  void draw(const DrawList& list, TexelWord* words, TexelWord* layer);
  /// The same list as depths [rows, width], map units; 0 where nothing but sky is.
  void draw_depth(const DrawList& list, float* depth);
  unsigned driver_error() const { return gl_.GetError(); }
  void make_current() { (void)context_->make_current(); }

 private:
  Rasterizer(std::unique_ptr<ContextProvider> context, const GlFunctions& gl, int width, int rows)
      : context_(std::move(context)), gl_(gl), width_(width), rows_(rows) {}
  Status set_up();
  Expected<GLuint> link(const char* fragment_source);
  Expected<GLuint> make_framebuffer(GLenum color_format);
  void draw_range(uint32_t begin, uint32_t end);
  void upload(const DrawList& list);
  void draw_opaque(const DrawList& list, GLuint program);

  std::unique_ptr<ContextProvider> context_;
  GlFunctions gl_;
  int width_, rows_;
  GLuint opaque_program_ = 0, masked_program_ = 0;
  GLuint opaque_depth_program_ = 0, masked_depth_program_ = 0;  // linked when they are first used
  GLuint plain_framebuffer_ = 0, layered_framebuffer_ = 0;      // one channel; two, the second is the layer
  bool layered_ = false;
  GLint layer_uniform_ = -1;
  std::vector<TexelWord> pairs_;  // of the layered framebuffer
  GLuint atlas_texture_ = 0, vertex_buffer_ = 0;
  int atlas_height_ = 0;
  std::size_t vertex_bytes_ = 0;
  bool depth_test_ = false;
};

}  // namespace comrad::doom
