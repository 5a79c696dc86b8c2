// Draws a list of quads with OpenGL and reads back, per pixel, which texel of the atlas is seen and how
// bright: not colours but addresses, because a software rasterizer fetches texels and packs colours more
// slowly than the one pass over the finished picture that looks both up. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/render/art_atlas.h"
#include "sim_workers/engine/render/context_provider.h"
#include "sim_workers/engine/render/gl_functions.h"
#include "sim_workers/engine/render/strip_quads.h"

namespace comrad::doom {

/// A pixel of the result: tint << kTintShift | light row << kAddressBits | texel address. In the blended
/// layer the blend is in the tint's place, and 0 means that nothing see-through covers the pixel.
using TexelWord = uint32_t;

class Rasterizer {
 public:
  /// Errors: kUnsupported when the context lacks what is needed.
  static Expected<std::unique_ptr<Rasterizer>> create(std::unique_ptr<ContextProvider> context, int width,
                                                      int rows);
  /// How many pictures one pass draws at most.
  int capacity() const { return capacity_; }
  /// Makes the texture equal to the atlas if that changed.
  void update_atlas(ArtAtlas* atlas);
  /// Draws pictures, all with blended quads or all without.
  void draw(std::span<const QuadList* const> lists);
  /// The picture at a place of the last draw(): `words` [rows, width], top row first.
  void read(std::size_t place, TexelWord* words);
  /// A box of its layer of blended texels: `layer` [bottom - top, right - left].
  void read_layer(std::size_t place, const PixelBox& box, TexelWord* layer);
  /// One picture as depths [rows, width], map units; 0 where nothing but sky is.
  void draw_depth(const QuadList& list, float* depth);
  /// What each pixel of one picture is of: `subjects` [rows, width], as Subject counts; walls where nothing is.
  void draw_subjects(const QuadList& list, uint32_t* subjects);
  unsigned driver_error() const { return gl_.GetError(); }
  void make_current() { (void)context_->make_current(); }

 private:
  static constexpr int kPicturesMax = 16;
  static constexpr int64_t kPassPixelsMax = int64_t{1} << 20;
  /// A framebuffer with a layer per picture, and one per layer to read it with.
  struct Target {
    GLuint framebuffer = 0;
    std::array<GLuint, 2> colors{};  ///< texel words; blended ones
    std::vector<GLuint> readers;
  };

  Rasterizer(std::unique_ptr<ContextProvider> context, const GlFunctions& gl, int width, int rows)
      : context_(std::move(context)), gl_(gl), width_(width), rows_(rows) {}
  Status set_up();
  void choose_capacity();
  Expected<GLuint> link(const char* fragment_source);
  Expected<const Target*> target(int pictures, bool blended);
  void queue(std::size_t list, uint32_t begin, uint32_t end);
  void draw_queued();
  void upload(std::span<const QuadList* const> lists);
  void draw_opaque(std::span<const QuadList* const> lists, GLuint program);
  void draw_measured(const QuadList& list, GLuint opaque_program, GLuint masked_program, void* words);
  void draw_masked(std::span<const QuadList* const> lists, bool layered);

  std::unique_ptr<ContextProvider> context_;
  GlFunctions gl_;
  int width_, rows_;
  int capacity_ = 1;
  std::string vertex_header_;
  GLuint opaque_program_ = 0, masked_program_ = 0;
  GLuint opaque_depth_program_ = 0, masked_depth_program_ = 0;  // linked when they are first used
  GLuint opaque_subject_program_ = 0, masked_subject_program_ = 0;
  QuadList shaded_by_subject_;
  GLint layer_uniform_ = -1;
  std::array<std::array<Target, 5>, 2> targets_;  // [blended, log2 of the pictures]
  const Target* drawn_ = nullptr;
  GLuint atlas_texture_ = 0;
  int atlas_height_ = 0;
  std::vector<QuadVertex> vertices_;  // of all lists
  std::vector<GLint> bases_of_lists_;
  std::vector<GLsizei> counts_;  // queued stretches
  std::vector<const void*> offsets_;
  std::vector<GLint> bases_;
  std::vector<std::size_t> next_runs_;  // [list]
};

}  // namespace comrad::doom
