// OpenGL through EGL without a surface: a GPU's driver, or Mesa's software rasterizer where there is none.
// The library is loaded when it is requested, so that nothing links it. Stage: render.
#pragma once

#include <memory>

#include "sim_workers/engine/render/context_provider.h"

namespace comrad::doom {

/// Errors: kUnsupported with what is missing: libEGL, the surfaceless platform, or OpenGL 3.3 core.
Expected<std::unique_ptr<ContextProvider>> create_egl_context();

}  // namespace comrad::doom
