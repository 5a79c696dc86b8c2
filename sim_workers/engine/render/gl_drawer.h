// Views by OpenGL: what each pixel shows comes back as texel addresses, which one pass turns into colours. Stage: render.
#pragma once

#include <memory>

#include "sim_workers/engine/render/view_drawer.h"

namespace comrad::doom {

/// Draws with OSMesa, or with EGL. Errors: kUnsupported with what is missing.
Expected<std::unique_ptr<ViewDrawer>> create_gl_drawer(const RenderOptions& options,
                                                       const Projection& projection, ArtAtlas* atlas,
                                                       ColorTables* colors);

}  // namespace comrad::doom
