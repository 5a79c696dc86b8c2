#include "sim_workers/engine/render/rasterizer.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <string>

#include "rollout_buffer/core/check.h"

namespace comrad::doom {
namespace {

constexpr uint32_t kQuadsMax = 16384;  // indices are 16 bits wide

constexpr const char* kVersion = "#version 330 core\n";
// With one of these a vertex names the layer of the framebuffer that it is drawn into, and one pass draws
// many pictures.
constexpr const char* kLayerExtensions[] = {"GL_ARB_shader_viewport_layer_array",
                                            "GL_AMD_vertex_shader_layer"};

constexpr const char* kVertexSource = R"(
layout(location = 0) in vec4 position;
layout(location = 1) in vec2 texture_position;
layout(location = 2) in vec3 size_and_shade;
layout(location = 3) in int address;
layout(location = 4) in int picture;
out vec2 uv;
flat out vec3 surface;
flat out int origin;
flat out ivec2 corner;
void main() {
  gl_Position = position;
#ifdef MANY_PICTURES
  gl_Layer = picture;
#endif
  uv = texture_position;
  surface = size_and_shade;
  origin = address;
  int place = address & 0xFFFFFF;
  corner = ivec2(place % 2112, place / 2112);
}
)";

// gl_FragCoord.w is 1/depth: light falls off with it exactly as over Doom's columns and rows.
constexpr const char* kOpaqueSource = R"(
in vec2 uv;
flat in vec3 surface;
flat in int origin;
out uvec4 word;
void main() {
  ivec2 texel = ivec2(fract(uv) * surface.xy);
  int row = int(clamp(surface.z - min(24.0, 1280.0 * gl_FragCoord.w), 0.0, 31.0));
  word = uvec4(origin + texel.y * 2112 + texel.x + (row << 24));
}
)";

constexpr const char* kMaskedSource = R"(
uniform usampler2D atlas;
uniform uint layer;
in vec2 uv;
flat in vec3 surface;
flat in int origin;
flat in ivec2 corner;
layout(location = 0) out uvec4 word;
layout(location = 1) out uvec4 blended;
void main() {
  ivec2 texel = ivec2(fract(uv) * surface.xy);
  if (texelFetch(atlas, corner + texel, 0).r == 0u) discard;
  int address = origin + texel.y * 2112 + texel.x;
  int row = int(clamp(surface.z - min(24.0, 1280.0 * gl_FragCoord.w), 0.0, 31.0));
  uint value = uint(address + (row << 24));
  word = uvec4(value);
  blended = uvec4(value & layer);
}
)";
// Measured depths; sky is drawn at an inverse of 1, nearer than anything else can be.
constexpr const char* kOpaqueDepthSource = R"(
in vec2 uv;
flat in vec3 surface;
flat in int origin;
out uvec4 word;
void main() { word = uvec4(floatBitsToUint(gl_FragCoord.w)); }
)";

constexpr const char* kMaskedDepthSource = R"(
uniform usampler2D atlas;
in vec2 uv;
flat in vec3 surface;
flat in int origin;
flat in ivec2 corner;
out uvec4 word;
void main() {
  ivec2 texel = ivec2(fract(uv) * surface.xy);
  if (texelFetch(atlas, corner + texel, 0).r == 0u) discard;
  word = uvec4(floatBitsToUint(gl_FragCoord.w));
}
)";
// What a pixel is of, which came in the shade's place.
constexpr const char* kOpaqueSubjectSource = R"(
in vec2 uv;
flat in vec3 surface;
flat in int origin;
out uvec4 word;
void main() { word = uvec4(uint(surface.z)); }
)";

constexpr const char* kMaskedSubjectSource = R"(
uniform usampler2D atlas;
in vec2 uv;
flat in vec3 surface;
flat in int origin;
flat in ivec2 corner;
out uvec4 word;
void main() {
  ivec2 texel = ivec2(fract(uv) * surface.xy);
  if (texelFetch(atlas, corner + texel, 0).r == 0u) discard;
  word = uvec4(uint(surface.z));
}
)";
static_assert(kLightReach == 1280.0f && kLightNearest == 24.0f && kAtlasWidth == 2112 && kAddressBits == 24,
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
  const std::string vertex_source = vertex_header_ + kVertexSource;
  const std::string fragment = std::string(kVersion) + fragment_source;
  for (const auto& [kind, source] :
       {std::pair{GL_VERTEX_SHADER, &vertex_source}, {GL_FRAGMENT_SHADER, &fragment}}) {
    const GLuint shader = gl_.CreateShader(static_cast<GLenum>(kind));
    const char* const text = source->c_str();
    gl_.ShaderSource(shader, 1, &text, nullptr);
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

/// Looks for the extension that lets one pass draw many pictures; without it they are drawn one by one.
void Rasterizer::choose_capacity() {
  vertex_header_ = kVersion;
  GLint count = 0, layers_max = 1;
  gl_.GetIntegerv(GL_NUM_EXTENSIONS, &count);
  gl_.GetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers_max);
  const int64_t pixels = static_cast<int64_t>(width_) * rows_;
  const int64_t fitting = std::min<int64_t>({kPicturesMax, kPassPixelsMax / pixels, layers_max});
  for (const char* extension : kLayerExtensions)
    for (GLint i = 0; i < count && capacity_ == 1; ++i) {
      const GLubyte* const name = gl_.GetStringi(GL_EXTENSIONS, static_cast<GLuint>(i));
      if (name == nullptr || std::strcmp(reinterpret_cast<const char*>(name), extension) != 0) continue;
      vertex_header_ += std::string("#extension ") + extension + " : require\n#define MANY_PICTURES\n";
      while (capacity_ * 2 <= fitting) capacity_ *= 2;
      return;
    }
}

/// The smallest framebuffer that takes `pictures`, made when it is first needed.
Expected<const Rasterizer::Target*> Rasterizer::target(int pictures, bool blended) {
  std::size_t size_class = 0;
  while ((1 << size_class) < pictures) ++size_class;
  Target& target = targets_[blended ? 1 : 0][size_class];
  if (target.framebuffer != 0) return &target;
  const GLsizei layers = 1 << size_class;
  const auto attach_all = [&](GLuint framebuffer, int layer) {
    gl_.BindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    for (std::size_t i = 0; i < target.colors.size(); ++i) {
      if (target.colors[i] == 0) continue;
      const GLenum attachment = GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(i);
      if (layer < 0)
        gl_.FramebufferTexture(GL_FRAMEBUFFER, attachment, target.colors[i], 0);
      else
        gl_.FramebufferTextureLayer(GL_FRAMEBUFFER, attachment, target.colors[i], 0, layer);
    }
  };
  for (std::size_t i = 0; i < (blended ? 2u : 1u); ++i) {
    gl_.GenTextures(1, &target.colors[i]);
    gl_.BindTexture(GL_TEXTURE_2D_ARRAY, target.colors[i]);
    gl_.TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, 0);
    gl_.TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl_.TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl_.TexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_R32UI, width_, rows_, layers, 0, GL_RED_INTEGER,
                   GL_UNSIGNED_INT, nullptr);
  }
  GLuint framebuffers[kPicturesMax + 1] = {};
  gl_.GenFramebuffers(layers + 1, framebuffers);
  for (int layer = 0; layer < layers; ++layer) {
    target.readers.push_back(framebuffers[layer + 1]);
    attach_all(target.readers.back(), layer);
  }
  attach_all(framebuffers[0], -1);
  const GLenum buffers[] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
  gl_.DrawBuffers(blended ? 2 : 1, buffers);
  if (gl_.CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    return Error{
        ErrorCode::kUnsupported,
        fmt::format("OpenGL gives no framebuffer of 32-bit integers of {}x{}x{}", width_, rows_, layers)};
  target.framebuffer = framebuffers[0];
  return &target;
}

Status Rasterizer::set_up() {
  choose_capacity();
  COMRAD_TRY_ASSIGN(opaque_program_, link(kOpaqueSource));
  COMRAD_TRY_ASSIGN(masked_program_, link(kMaskedSource));
  layer_uniform_ = gl_.GetUniformLocation(masked_program_, "layer");
  COMRAD_TRY(target(1, false));
  COMRAD_TRY(target(capacity_, true));
  gl_.Viewport(0, 0, width_, rows_);

  GLuint vertex_array = 0, buffers[2] = {};
  gl_.GenVertexArrays(1, &vertex_array);
  gl_.BindVertexArray(vertex_array);
  gl_.GenBuffers(2, buffers);
  std::vector<uint16_t> indices;
  for (uint32_t quad = 0; quad < kQuadsMax; ++quad)
    for (const uint32_t corner : {0u, 1u, 2u, 0u, 2u, 3u})
      indices.push_back(static_cast<uint16_t>(4 * quad + corner));
  gl_.BindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]);
  gl_.BufferData(GL_ELEMENT_ARRAY_BUFFER, static_cast<GLsizeiptr>(indices.size() * sizeof(uint16_t)),
                 indices.data(), GL_STATIC_DRAW);
  gl_.BindBuffer(GL_ARRAY_BUFFER, buffers[0]);
  const auto at = [](std::size_t offset) { return reinterpret_cast<const void*>(offset); };
  gl_.VertexAttribPointer(0, 4, GL_FLOAT, GL_FALSE, sizeof(QuadVertex), at(offsetof(QuadVertex, x)));
  gl_.VertexAttribPointer(1, 2, GL_FLOAT, GL_FALSE, sizeof(QuadVertex), at(offsetof(QuadVertex, u)));
  gl_.VertexAttribPointer(2, 3, GL_FLOAT, GL_FALSE, sizeof(QuadVertex), at(offsetof(QuadVertex, width)));
  gl_.VertexAttribIPointer(3, 1, GL_INT, sizeof(QuadVertex), at(offsetof(QuadVertex, address)));
  gl_.VertexAttribIPointer(4, 1, GL_INT, sizeof(QuadVertex), at(offsetof(QuadVertex, picture)));
  for (GLuint attribute = 0; attribute < 5; ++attribute) gl_.EnableVertexAttribArray(attribute);

  gl_.GenTextures(1, &atlas_texture_);
  gl_.ActiveTexture(GL_TEXTURE0);
  gl_.BindTexture(GL_TEXTURE_2D, atlas_texture_);
  gl_.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  gl_.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  gl_.TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAX_LEVEL, 0);
  gl_.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
  gl_.PixelStorei(GL_PACK_ALIGNMENT, 1);
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

/// Quads [begin, end) of a list, waiting for draw_queued().
void Rasterizer::queue(std::size_t list, uint32_t begin, uint32_t end) {
  end = std::min(end, kQuadsMax);
  if (begin >= end) return;
  counts_.push_back(static_cast<GLsizei>(6 * (end - begin)));
  offsets_.push_back(reinterpret_cast<const void*>(std::size_t{begin} * 6 * sizeof(uint16_t)));
  bases_.push_back(bases_of_lists_[list]);
}

void Rasterizer::draw_queued() {
  if (counts_.empty()) return;
  gl_.MultiDrawElementsBaseVertex(GL_TRIANGLES, counts_.data(), GL_UNSIGNED_SHORT, offsets_.data(),
                                  static_cast<GLsizei>(counts_.size()), bases_.data());
  counts_.clear(), offsets_.clear(), bases_.clear();
}

void Rasterizer::upload(std::span<const QuadList* const> lists) {
  bases_of_lists_.clear();
  std::size_t total = 0;
  const auto used = [](const QuadList& list) {
    return std::min<std::size_t>(list.vertices.size(), std::size_t{4} * kQuadsMax);
  };
  for (const QuadList* list : lists) {
    bases_of_lists_.push_back(static_cast<GLint>(total));
    total += used(*list);
  }
  vertices_.resize(total);
  for (std::size_t i = 0; i < lists.size(); ++i) {
    const auto begin = vertices_.begin() + bases_of_lists_[i];
    const auto end = std::copy_n(lists[i]->vertices.begin(), used(*lists[i]), begin);
    std::for_each(begin, end, [&](QuadVertex& vertex) { vertex.picture = static_cast<int32_t>(i); });
  }
  gl_.BufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(total * sizeof(QuadVertex)), vertices_.data(),
                 GL_STREAM_DRAW);
}

/// Walls, floors, sky.
void Rasterizer::draw_opaque(std::span<const QuadList* const> lists, GLuint program) {
  gl_.UseProgram(program);
  for (std::size_t i = 0; i < lists.size(); ++i) queue(i, 0, lists[i]->opaque_end);
  draw_queued();
}

/// Sprites and gratings: the lists' stretches of the same kind together.
void Rasterizer::draw_masked(std::span<const QuadList* const> lists, bool layered) {
  gl_.UseProgram(masked_program_);
  next_runs_.assign(lists.size(), 0);
  for (bool blended = false, any = true; any; blended = !blended) {
    any = false;
    for (std::size_t i = 0; i < lists.size(); ++i) {
      const std::vector<QuadList::Run>& runs = lists[i]->masked_runs;
      std::size_t& next = next_runs_[i];
      if (next == runs.size()) continue;
      any = true;
      if (runs[next].blended != blended) continue;
      queue(i, next == 0 ? lists[i]->opaque_end : runs[next - 1].end, runs[next].end);
      ++next;
    }
    if (counts_.empty()) continue;
    if (layered) {
      const GLboolean opaque = blended ? GL_FALSE : GL_TRUE;
      gl_.ColorMaski(0, opaque, opaque, opaque, opaque);
      gl_.Uniform1ui(layer_uniform_, blended ? 0xFFFFFFFFu : 0u);
    }
    draw_queued();
  }
}

void Rasterizer::draw(std::span<const QuadList* const> lists) {
  const bool layered = !lists.empty() && lists.front()->has_blended;
  COMRAD_CHECK(lists.size() <= static_cast<std::size_t>(capacity_), "as many pictures as a pass takes");
  const Expected<const Target*> found = target(static_cast<int>(lists.size()), layered);
  COMRAD_CHECK(found.has_value(), "smaller and larger framebuffers could be had");
  drawn_ = *found;
  upload(lists);
  gl_.BindFramebuffer(GL_FRAMEBUFFER, drawn_->framebuffer);
  const GLuint nothing[4] = {};
  gl_.ClearBufferuiv(GL_COLOR, 0, nothing);
  if (layered) {
    gl_.ClearBufferuiv(GL_COLOR, 1, nothing);
    gl_.ColorMaski(1, GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  }
  draw_opaque(lists, opaque_program_);
  if (layered) gl_.ColorMaski(1, GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  draw_masked(lists, layered);
  if (layered) gl_.ColorMaski(0, GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

void Rasterizer::read(std::size_t place, TexelWord* words) {
  gl_.BindFramebuffer(GL_READ_FRAMEBUFFER, drawn_->readers[place]);
  if (drawn_->colors[1] != 0) gl_.ReadBuffer(GL_COLOR_ATTACHMENT0);
  gl_.ReadPixels(0, 0, width_, rows_, GL_RED_INTEGER, GL_UNSIGNED_INT, words);
}

void Rasterizer::read_layer(std::size_t place, const PixelBox& box, TexelWord* layer) {
  gl_.BindFramebuffer(GL_READ_FRAMEBUFFER, drawn_->readers[place]);
  gl_.ReadBuffer(GL_COLOR_ATTACHMENT1);
  gl_.ReadPixels(box.left, box.top, box.right - box.left, box.bottom - box.top, GL_RED_INTEGER,
                 GL_UNSIGNED_INT, layer);
}

/// One picture by shaders that measure: 32 bits a pixel.
void Rasterizer::draw_measured(const QuadList& list, GLuint opaque_program, GLuint masked_program,
                               void* words) {
  const QuadList* const lists[] = {&list};
  const Expected<const Target*> found = target(1, false);
  COMRAD_CHECK(found.has_value(), "made in set_up()");
  drawn_ = *found;
  upload(lists);
  gl_.BindFramebuffer(GL_FRAMEBUFFER, drawn_->framebuffer);
  const GLuint nothing[4] = {};
  gl_.ClearBufferuiv(GL_COLOR, 0, nothing);
  draw_opaque(lists, opaque_program);
  gl_.UseProgram(masked_program);
  queue(0, list.opaque_end, list.quad_count());
  draw_queued();
  gl_.BindFramebuffer(GL_READ_FRAMEBUFFER, drawn_->readers[0]);
  gl_.ReadPixels(0, 0, width_, rows_, GL_RED_INTEGER, GL_UNSIGNED_INT, words);
}

void Rasterizer::draw_depth(const QuadList& list, float* depth) {
  if (opaque_depth_program_ == 0) {
    const Expected<GLuint> opaque = link(kOpaqueDepthSource), masked = link(kMaskedDepthSource);
    COMRAD_CHECK(opaque && masked, "OpenGL compiles the depth shaders as it does the others");
    opaque_depth_program_ = *opaque, masked_depth_program_ = *masked;
  }
  draw_measured(list, opaque_depth_program_, masked_depth_program_, depth);
  const std::size_t pixels = static_cast<std::size_t>(width_) * static_cast<std::size_t>(rows_);
  for (std::size_t i = 0; i < pixels; ++i)
    depth[i] = depth[i] > 0 && depth[i] < 0.999f ? 1.0f / depth[i] : 0.0f;
}

void Rasterizer::draw_subjects(const QuadList& list, uint32_t* subjects) {
  if (opaque_subject_program_ == 0) {
    const Expected<GLuint> opaque = link(kOpaqueSubjectSource), masked = link(kMaskedSubjectSource);
    COMRAD_CHECK(opaque && masked, "OpenGL compiles the subject shaders as it does the others");
    opaque_subject_program_ = *opaque, masked_subject_program_ = *masked;
  }
  shaded_by_subject_ = list;  // what measures no light reads the subject in its place
  for (QuadVertex& vertex : shaded_by_subject_.vertices) vertex.shade = static_cast<float>(vertex.picture);
  draw_measured(shaded_by_subject_, opaque_subject_program_, masked_subject_program_, subjects);
}

}  // namespace comrad::doom
