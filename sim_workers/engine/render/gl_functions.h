// The two dozen OpenGL functions the renderer calls, looked up through the context provider. Stage: render.
#pragma once

#include <GL/glcorearb.h>

#include "sim_workers/engine/render/context_provider.h"

namespace comrad::doom {

// One line per function: type of the pointer, name without the gl prefix.
#define COMRAD_GL_FUNCTIONS(X)                                         \
  X(PFNGLACTIVETEXTUREPROC, ActiveTexture)                             \
  X(PFNGLATTACHSHADERPROC, AttachShader)                               \
  X(PFNGLBINDBUFFERPROC, BindBuffer)                                   \
  X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer)                         \
  X(PFNGLBINDTEXTUREPROC, BindTexture)                                 \
  X(PFNGLBINDVERTEXARRAYPROC, BindVertexArray)                         \
  X(PFNGLBUFFERDATAPROC, BufferData)                                   \
  X(PFNGLCHECKFRAMEBUFFERSTATUSPROC, CheckFramebufferStatus)           \
  X(PFNGLCLEARBUFFERUIVPROC, ClearBufferuiv)                           \
  X(PFNGLCOLORMASKIPROC, ColorMaski)                                   \
  X(PFNGLCOMPILESHADERPROC, CompileShader)                             \
  X(PFNGLCREATEPROGRAMPROC, CreateProgram)                             \
  X(PFNGLCREATESHADERPROC, CreateShader)                               \
  X(PFNGLDRAWBUFFERSPROC, DrawBuffers)                                 \
  X(PFNGLENABLEVERTEXATTRIBARRAYPROC, EnableVertexAttribArray)         \
  X(PFNGLFRAMEBUFFERTEXTUREPROC, FramebufferTexture)                   \
  X(PFNGLFRAMEBUFFERTEXTURELAYERPROC, FramebufferTextureLayer)         \
  X(PFNGLGENBUFFERSPROC, GenBuffers)                                   \
  X(PFNGLGENFRAMEBUFFERSPROC, GenFramebuffers)                         \
  X(PFNGLGENTEXTURESPROC, GenTextures)                                 \
  X(PFNGLGENVERTEXARRAYSPROC, GenVertexArrays)                         \
  X(PFNGLGETERRORPROC, GetError)                                       \
  X(PFNGLGETINTEGERVPROC, GetIntegerv)                                 \
  X(PFNGLGETPROGRAMINFOLOGPROC, GetProgramInfoLog)                     \
  X(PFNGLGETPROGRAMIVPROC, GetProgramiv)                               \
  X(PFNGLGETSHADERINFOLOGPROC, GetShaderInfoLog)                       \
  X(PFNGLGETSHADERIVPROC, GetShaderiv)                                 \
  X(PFNGLGETSTRINGIPROC, GetStringi)                                   \
  X(PFNGLGETUNIFORMLOCATIONPROC, GetUniformLocation)                   \
  X(PFNGLLINKPROGRAMPROC, LinkProgram)                                 \
  X(PFNGLMULTIDRAWELEMENTSBASEVERTEXPROC, MultiDrawElementsBaseVertex) \
  X(PFNGLPIXELSTOREIPROC, PixelStorei)                                 \
  X(PFNGLREADBUFFERPROC, ReadBuffer)                                   \
  X(PFNGLREADPIXELSPROC, ReadPixels)                                   \
  X(PFNGLSHADERSOURCEPROC, ShaderSource)                               \
  X(PFNGLTEXIMAGE2DPROC, TexImage2D)                                   \
  X(PFNGLTEXIMAGE3DPROC, TexImage3D)                                   \
  X(PFNGLTEXPARAMETERIPROC, TexParameteri)                             \
  X(PFNGLTEXSUBIMAGE2DPROC, TexSubImage2D)                             \
  X(PFNGLUNIFORM1UIPROC, Uniform1ui)                                   \
  X(PFNGLUSEPROGRAMPROC, UseProgram)                                   \
  X(PFNGLVERTEXATTRIBIPOINTERPROC, VertexAttribIPointer)               \
  X(PFNGLVERTEXATTRIBPOINTERPROC, VertexAttribPointer)                 \
  X(PFNGLVIEWPORTPROC, Viewport)

struct GlFunctions {
#define COMRAD_GL_MEMBER(type, name) type name = nullptr;
  COMRAD_GL_FUNCTIONS(COMRAD_GL_MEMBER)
#undef COMRAD_GL_MEMBER

  /// Errors: kUnsupported naming the first function that is missing.
  static Expected<GlFunctions> load(const ContextProvider& context);
};

}  // namespace comrad::doom
