#include "sim_workers/engine/render/rasterizer.h"

#include <algorithm>
#include <cstddef>
#include <string>

#include "rollout_buffer/core/check.h"

namespace comrad::doom {
namespace {

constexpr uint32_t kQuadsMax = 16384;  // indices are 16 bits wide

constexpr const char* kVertexSource = R"(#version 330 core
layout(location = 0) in vec4 position;
layout(location = 1) in vec2 texture_position;
layout(location = 2) in vec3 size_and_shade;
layout(location = 3) in int address;
out vec2 uv;
flat out vec3 surface;
flat out int origin;
void main() {
  gl_Position = position;
  uv = texture_position;
  surface = size_and_shade;
  origin = address;
}
)";

// gl_FragCoord.w is 1/depth: light falls off with it exactly as over Doom's columns and rows.
constexpr const char* kOpaqueSource = R"(#version 330 core
in vec2 uv;
flat in vec3 surface;
flat in int origin;
out uvec4 word;
void main() {
  ivec2 texel = ivec2(fract(uv) * surface.xy);
  int row = int(clamp(surface.z - min(24.0, 1280.0 * gl_FragCoord.w), 0.0, 31.0));
  word = uvec4(origin + (texel.y << 11) + texel.x + (row << 24));
}
)";

constexpr const char* kMaskedSource = R"(#version 330 core
uniform usampler2D atlas;
uniform uint layer;
in vec2 uv;
flat in vec3 surface;
flat in int origin;
out uvec4 word;
void main() {
  ivec2 texel = ivec2(fract(uv) * surface.xy);
  int address = origin + (texel.y << 11) + texel.x;
  if (texelFetch(atlas, ivec2(address & 2047, (address >> 11) & 8191), 0).r == 0u) discard;
  int row = int(clamp(surface.z - min(24.0, 1280.0 * gl_FragCoord.w), 0.0, 31.0));
  uint value = uint(address + (row << 24));
  word = uvec4(value, value & layer, 0u, 0u);
}
)";
// Measured depths; sky is drawn at an inverse of 1, nearer than anything else can be.
constexpr const char* kOpaqueDepthSource = R"(#version 330 core
in vec2 uv;
flat in vec3 surface;
flat in int origin;
out uvec4 word;
void main() { word = uvec4(floatBitsToUint(gl_FragCoord.w)); }
)";

constexpr const char* kMaskedDepthSource = R"(#version 330 core
uniform usampler2D atlas;
in vec2 uv;
flat in vec3 surface;
flat in int origin;
out uvec4 word;
void main() {
  ivec2 texel = ivec2(fract(uv) * surface.xy);
  int address = origin + (texel.y << 11) + texel.x;
  if (texelFetch(atlas, ivec2(address & 2047, (address >> 11) & 8191), 0).r == 0u) discard;
  word = uvec4(floatBitsToUint(gl_FragCoord.w));
}
)";
static_assert(kLightReach == 1280.0f && kLightNearest == 24.0f && kAtlasWidthBits == 11 &&
                  kAddressBits == 24 && kAtlasHeightMax == 8192,
              "the shaders spell these out");

}  // namespace

Expected<std::unique_ptr<Rasterizer>> Rasterizer::create(std::unique_ptr<ContextProvider> context, int width,
                                                         int rows) {
  COMRAD_TRY(context->make_current());
  COMRAD_TRY_ASSIGN(const GlFunctions gl, GlFunctions::load(*context));
  std::unique_ptr<Rasterizer> rasterizer(new Rasterizer(std::move(context), gl, width, rows));
  COMRAD_TRY(rasterizer->set_up());
  return rasterizer;
}

Expected<GLuint> Rasterizer::link(const char* fragment_source) {
  const GLuint program = gl_.CreateProgram();
  for (const auto& [kind, source] :
       {std::pair{GL_VERTEX_SHADER, kVertexSource}, {GL_FRAGMENT_SHADER, fragment_source}}) {
    const GLuint shader = gl_.CreateShader(static_cast<GLenum>(kind));
    gl_.ShaderSource(shader, 1, &source, nullptr);
    gl_.CompileShader(shader);
    GLint compiled = 0;
    gl_.GetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (!compiled) {
      char log[512] = "";
      gl_.GetShaderInfoLog(shader, sizeof log, nullptr, log);
      return Error{ErrorCode::kUnsupported, std::string("OpenGL refuses the renderer's shader: ") + log};
    }
    gl_.AttachShader(program, shader);
  }
  gl_.LinkProgram(program);
  GLint linked = 0;
  gl_.GetProgramiv(program, GL_LINK_STATUS, &linked);
  if (!linked) return Error{ErrorCode::kUnsupported, "OpenGL cannot link the renderer's shaders"};
  return program;
}

Expected<GLuint> Rasterizer::make_framebuffer(GLenum color_format) {
  GLuint framebuffer = 0, renderbuffers[2] = {};
  gl_.GenFramebuffers(1, &framebuffer);
  gl_.BindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  gl_.GenRenderbuffers(2, renderbuffers);
  const std::pair<GLenum, GLenum> parts[2] = {{color_format, GL_COLOR_ATTACHMENT0},
                                              {GL_DEPTH_COMPONENT24, GL_DEPTH_ATTACHMENT}};
  for (int i = 0; i < 2; ++i) {
    gl_.BindRenderbuffer(GL_RENDERBUFFER, renderbuffers[i]);
    gl_.RenderbufferStorage(GL_RENDERBUFFER, parts[i].first, width_, rows_);
    gl_.FramebufferRenderbuffer(GL_FRAMEBUFFER, parts[i].second, GL_RENDERBUFFER, renderbuffers[i]);
  }
  if (gl_.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    return Error{ErrorCode::kUnsupported, "OpenGL gives no framebuffer of 32-bit integers of " +
                                              std::to_string(width_) + "x" + std::to_string(rows_)};
  return framebuffer;
}

Status Rasterizer::set_up() {
  COMRAD_TRY_ASSIGN(opaque_program_, link(kOpaqueSource));
  COMRAD_TRY_ASSIGN(masked_program_, link(kMaskedSource));

  layer_uniform_ = gl_.GetUniformLocation(masked_program_, "layer");
  COMRAD_TRY_ASSIGN(layered_framebuffer_, make_framebuffer(GL_RG32UI));
  COMRAD_TRY_ASSIGN(plain_framebuffer_, make_framebuffer(GL_R32UI));
  gl_.Viewport(0, 0, width_, rows_);

  GLuint vertex_array = 0, buffers[2] = {};
  gl_.GenVertexArrays(1, &vertex_array);
  gl_.BindVertexArray(vertex_array);
  gl_.GenBuffers(2, buffers);
  vertex_buffer_ = buffers[0];
  std::vector<uint16_t> indices;
  for (uint32_t quad = 0; quad < kQuadsMax; ++quad)
    for (const uint32_t corner : {0u, 1u, 2u, 0u, 2u, 3u})
      indices.push_back(static_cast<uint16_t>(4 * quad + corner));
  gl_.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]);
  gl_.BufferData(GL_ELEMENT_ARRAY_BUFFER, static_cast<GLsizeiptr>(indices.size() * sizeof(uint16_t)),
                 indices.data(), GL_STATIC_DRAW);
  gl_.BindBuffer(GL_ARRAY_BUFFER, vertex_buffer_);
  const auto at = [](std::size_t offset) { return reinterpret_cast<const void*>(offset); };
  gl_.VertexAttribPointer(0, 4, GL_FLOAT, GL_FALSE, sizeof(QuadVertex), at(offsetof(QuadVertex, x)));
  gl_.VertexAttribPointer(1, 2, GL_FLOAT, GL_FALSE, sizeof(QuadVertex), at(offsetof(QuadVertex, u)));
  gl_.VertexAttribPointer(2, 3, GL_FLOAT, GL_FALSE, sizeof(QuadVertex), at(offsetof(QuadVertex, width)));
  gl_.VertexAttribIPointer(3, 1, GL_INT, sizeof(QuadVertex), at(offsetof(QuadVertex, address)));
  for (GLuint attribute = 0; attribute < 4; ++attribute) gl_.EnableVertexAttribArray(attribute);

  gl_.GenTextures(1, &atlas_texture_);
  gl_.ActiveTexture(GL_TEXTURE0);
  gl_.BindTexture(GL_TEXTURE_2D, atlas_texture_);
  gl_.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  gl_.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  gl_.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
  gl_.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
  gl_.PixelStorei(GL_PACK_ALIGNMENT, 1);
  gl_.DepthFunc(GL_LEQUAL);
  if (gl_.GetError() != GL_NO_ERROR)
    return Error{ErrorCode::kUnsupported, "OpenGL reports an error while the renderer sets itself up"};
  return {};
}

void Rasterizer::update_atlas(ArtAtlas* atlas) {
  auto [top, bottom] = atlas->take_changes();
  if (top >= bottom) return;
  if (atlas->height() > atlas_height_) {
    // Doubled, so that a game that shows ever more sprites makes it anew a few times only.
    atlas_height_ = std::max(atlas_height_, 512);
    while (atlas_height_ < atlas->height()) atlas_height_ *= 2;
    atlas_height_ = std::min(atlas_height_, kAtlasHeightMax);
    gl_.TexImage2D(GL_TEXTURE_2D, 0, GL_R8UI, kAtlasWidth, atlas_height_, 0, GL_RED_INTEGER, GL_UNSIGNED_BYTE,
                   nullptr);
    top = 0, bottom = atlas->height();
  }
  gl_.TexSubImage2D(GL_TEXTURE_2D, 0, 0, top, kAtlasWidth, bottom - top, GL_RED_INTEGER, GL_UNSIGNED_BYTE,
                    atlas->texels() + static_cast<std::size_t>(top) * kAtlasWidth);
}

void Rasterizer::draw_range(uint32_t begin, uint32_t end) {
  end = std::min(end, kQuadsMax);
  if (begin >= end) return;
  gl_.DrawElements(GL_TRIANGLES, static_cast<GLsizei>(6 * (end - begin)), GL_UNSIGNED_SHORT,
                   reinterpret_cast<const void*>(std::size_t{begin} * 6 * sizeof(uint16_t)));
}

void Rasterizer::upload(const DrawList& list) {
  const std::size_t bytes =
      std::min<std::size_t>(list.vertices.size(), std::size_t{4} * kQuadsMax) * sizeof(QuadVertex);
  gl_.BufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(bytes), list.vertices.data(), GL_STREAM_DRAW);
}

/// Walls, floors, sky; the depth test stays on where the list needs it.
void Rasterizer::draw_opaque(const DrawList& list, GLuint program) {
  gl_.UseProgram(program);
  draw_range(0, list.painted_end);
  if (!list.needs_depth) return;
  const float far = 1.0f;
  gl_.Enable(GL_DEPTH_TEST);
  gl_.DepthMask(GL_TRUE);
  gl_.ClearBufferfv(GL_DEPTH, 0, &far);
  draw_range(list.painted_end, list.solid_end);
  gl_.DepthMask(GL_FALSE);
  draw_range(list.solid_end, list.plane_end);
  gl_.DepthMask(GL_TRUE);
}

void Rasterizer::draw_depth(const DrawList& list, float* depth) {
  if (opaque_depth_program_ == 0) {
    const Expected<GLuint> opaque = link(kOpaqueDepthSource), masked = link(kMaskedDepthSource);
    COMRAD_CHECK(opaque && masked, "OpenGL compiles the depth shaders as it does the others");
    opaque_depth_program_ = *opaque, masked_depth_program_ = *masked;
  }
  upload(list);
  layered_ = false;
  gl_.BindFramebuffer(GL_FRAMEBUFFER, plain_framebuffer_);
  const GLuint nothing[4] = {};
  gl_.ClearBufferuiv(GL_COLOR, 0, nothing);
  draw_opaque(list, opaque_depth_program_);
  gl_.UseProgram(masked_depth_program_);
  draw_range(list.plane_end, list.masked_end);
  if (list.needs_depth) gl_.Disable(GL_DEPTH_TEST);
  gl_.ReadPixels(0, 0, width_, rows_, GL_RED_INTEGER, GL_UNSIGNED_INT, depth);
  const std::size_t pixels = static_cast<std::size_t>(width_) * static_cast<std::size_t>(rows_);
  for (std::size_t i = 0; i < pixels; ++i)
    depth[i] = depth[i] > 0 && depth[i] < 0.999f ? 1.0f / depth[i] : 0.0f;
}

void Rasterizer::draw(const DrawList& list, TexelWord* words, TexelWord* layer) {
  upload(list);
  if (layered_ != list.has_blended) {
    layered_ = list.has_blended;
    gl_.BindFramebuffer(GL_FRAMEBUFFER, layered_ ? layered_framebuffer_ : plain_framebuffer_);
  }
  const GLuint nothing[4] = {};
  gl_.ClearBufferuiv(GL_COLOR, 0, nothing);
  if (layered_) gl_.ColorMask(GL_TRUE, GL_FALSE, GL_FALSE, GL_FALSE);
  draw_opaque(list, opaque_program_);
  if (list.masked_end > list.plane_end) gl_.UseProgram(masked_program_);
  uint32_t begin = list.plane_end;
  for (const DrawList::Run& run : list.masked_runs) {
    if (layered_) {
      gl_.ColorMask(run.blended ? GL_FALSE : GL_TRUE, GL_TRUE, GL_FALSE, GL_FALSE);
      gl_.Uniform1ui(layer_uniform_, run.blended ? 0xFFFFFFFFu : 0u);
    }
    draw_range(begin, run.end);
    begin = run.end;
  }
  if (list.needs_depth) gl_.Disable(GL_DEPTH_TEST);
  if (!layered_) {
    gl_.ReadPixels(0, 0, width_, rows_, GL_RED_INTEGER, GL_UNSIGNED_INT, words);
    return;
  }
  gl_.ColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  const std::size_t pixels = static_cast<std::size_t>(width_) * static_cast<std::size_t>(rows_);
  pairs_.resize(2 * pixels);
  gl_.ReadPixels(0, 0, width_, rows_, GL_RG_INTEGER, GL_UNSIGNED_INT, pairs_.data());
  for (std::size_t i = 0; i < pixels; ++i) words[i] = pairs_[2 * i], layer[i] = pairs_[2 * i + 1];
}

}  // namespace comrad::doom
