#include "sim_workers/engine/render/view_drawer.h"

#include "sim_workers/engine/render/painter_drawer.h"
#ifdef COMRAD_GL
#include "sim_workers/engine/render/gl_drawer.h"
#endif

namespace comrad::doom {

Expected<std::unique_ptr<ViewDrawer>> ViewDrawer::create(const RenderOptions& options,
                                                         const Projection& projection, ArtAtlas* atlas,
                                                         ColorTables* colors) {
  if (options.renderer == RendererKind::kPainter)
    return std::unique_ptr<ViewDrawer>(std::make_unique<PainterDrawer>(options, projection, atlas, colors));
#ifdef COMRAD_GL
  return create_gl_drawer(options, projection, atlas, colors);
#else
  return Error{ErrorCode::kUnsupported,
               std::string("renderer ") + word_of(options.renderer) +
                   ": this program was built without OpenGL (COMRAD_GL=OFF); use painter"};
#endif
}

}  // namespace comrad::doom
