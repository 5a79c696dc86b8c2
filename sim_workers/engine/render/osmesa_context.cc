#include "sim_workers/engine/render/osmesa_context.h"

#ifdef COMRAD_HAVE_OSMESA

#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

// osmesa.h requires the classic gl.h, which hides the core profile's types: the core header replaces it.
#include <GL/glcorearb.h>
#define __gl_h_
#ifndef GLAPIENTRY
#define GLAPIENTRY APIENTRY
#endif
#include <GL/osmesa.h>

namespace comrad::doom {
namespace {

constexpr int kSurfaceSize = 16;  // OSMesa insists on a buffer; the renderer draws into its own framebuffers

class OsmesaContext : public ContextProvider {
 public:
  explicit OsmesaContext(OSMesaContext context) : context_(context), surface_(kSurfaceSize * kSurfaceSize) {}
  ~OsmesaContext() override { OSMesaDestroyContext(context_); }
  OsmesaContext(const OsmesaContext&) = delete;
  OsmesaContext& operator=(const OsmesaContext&) = delete;

  void* function(const char* name) const override {
    return reinterpret_cast<void*>(OSMesaGetProcAddress(name));
  }

 protected:
  Status bind() override {
    if (!OSMesaMakeCurrent(context_, surface_.data(), GL_UNSIGNED_BYTE, kSurfaceSize, kSurfaceSize))
      return Error{ErrorCode::kUnsupported, "OSMesa cannot make its context current"};
    return {};
  }

 private:
  OSMesaContext context_;
  std::vector<uint32_t> surface_;
};

}  // namespace

Expected<std::unique_ptr<ContextProvider>> create_osmesa_context() {
  // The rasterizer's own threads cost more in hand-over than a picture of this size takes; a simulator owns
  // one core.
  setenv("LP_NUM_THREADS", "0", 0);
  const int attributes[] = {OSMESA_FORMAT,
                            OSMESA_RGBA,
                            OSMESA_PROFILE,
                            OSMESA_CORE_PROFILE,
                            OSMESA_CONTEXT_MAJOR_VERSION,
                            3,
                            OSMESA_CONTEXT_MINOR_VERSION,
                            3,
                            OSMESA_DEPTH_BITS,
                            0,
                            0};
  OSMesaContext context = OSMesaCreateContextAttribs(attributes, nullptr);
  if (context == nullptr)
    return Error{ErrorCode::kUnsupported,
                 "OSMesa gives no OpenGL 3.3 core context: install the Debian package libosmesa6 (Mesa 22)"};
  auto provider = std::make_unique<OsmesaContext>(context);
  COMRAD_TRY(provider->make_current());
  return std::unique_ptr<ContextProvider>(std::move(provider));
}

}  // namespace comrad::doom

#else

namespace comrad::doom {

Expected<std::unique_ptr<ContextProvider>> create_osmesa_context() {
  return Error{ErrorCode::kUnsupported,
               "built without OSMesa: install the Debian package libosmesa6-dev and build again, or use the "
               "provider egl"};
}

}  // namespace comrad::doom

#endif
