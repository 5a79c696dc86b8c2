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

/// A pixel of the result: light row << kAddressBits | texel address.
using TexelWord = uint32_t;

class Rasterizer {
 public:
  /// Errors: kUnsupported when the context lacks what is needed.
  static Expected<std::unique_ptr<Rasterizer>> create(std::unique_ptr<ContextProvider> context, int width,
                                                      int rows);
  /// Makes the texture equal to the atlas if that changed.
  void update_atlas(const ArtAtlas& atlas);
  /// Draws `list`; `words` [rows, width], top row first.
  void draw(const DrawList& list, TexelWord* words);
  void make_current() { (void)context_->make_current(); }

 private:
  Rasterizer(std::unique_ptr<ContextProvider> context, const GlFunctions& gl, int width, int rows)
      : context_(std::move(context)), gl_(gl), width_(width), rows_(rows) {}
  Status set_up();
  Expected<GLuint> link(const char* fragment_source);
  void draw_range(uint32_t begin, uint32_t end);

  std::unique_ptr<ContextProvider> context_;
  GlFunctions gl_;
  int width_, rows_;
  GLuint opaque_program_ = 0, masked_program_ = 0;
  GLuint atlas_texture_ = 0, vertex_buffer_ = 0;
  int atlas_height_ = 0;
  uint32_t atlas_version_ = 0;
  std::size_t vertex_bytes_ = 0;
  bool depth_test_ = false;
};

}  // namespace comrad::doom
