// OpenGL through OSMesa: Mesa's software rasterizer in the calling thread, without window system or GPU.
// Stage: render.
#pragma once

#include <memory>

#include "sim_workers/engine/render/context_provider.h"

namespace comrad::doom {

/// Errors: kUnsupported when OSMesa gives no OpenGL 3.3 core context.
Expected<std::unique_ptr<ContextProvider>> create_osmesa_context();

}  // namespace comrad::doom
