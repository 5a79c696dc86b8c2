#include "sim_workers/engine/render/gl_functions.h"

namespace comrad::doom {

Expected<GlFunctions> GlFunctions::load(const ContextProvider& context) {
  GlFunctions gl;
#define COMRAD_GL_LOAD(type, name)                                \
  gl.name = reinterpret_cast<type>(context.function("gl" #name)); \
  if (gl.name == nullptr)                                         \
    return Error{ErrorCode::kUnsupported, "the OpenGL library lacks gl" #name ": OpenGL 3.3 is needed"};
  COMRAD_GL_FUNCTIONS(COMRAD_GL_LOAD)
#undef COMRAD_GL_LOAD
  return gl;
}

}  // namespace comrad::doom
