#include "sim_workers/engine/render/egl_context.h"

#include <dlfcn.h>

#include <cstdint>
#include <cstdlib>
#include <mutex>
#include <string>

namespace comrad::doom {
namespace {

// The dozen names of EGL that this file needs; its headers are not needed.
using EglDisplay = void*;
using EglConfig = void*;
using EglContextHandle = void*;
using EglSurface = void*;
constexpr unsigned kPlatformSurfaceless = 0x31DD;  // EGL_PLATFORM_SURFACELESS_MESA
constexpr unsigned kOpenGlApi = 0x30A2;
constexpr int32_t kNone = 0x3038, kSurfaceType = 0x3033, kRenderableType = 0x3040, kOpenGlBit = 0x0008;
constexpr int32_t kContextMajor = 0x3098, kContextMinor = 0x30FB, kContextProfile = 0x30FD, kCoreProfile = 1;

struct Egl {
  void* (*get_proc_address)(const char*) = nullptr;
  EglDisplay (*get_platform_display)(unsigned, void*, const intptr_t*) = nullptr;
  unsigned (*initialize)(EglDisplay, int32_t*, int32_t*) = nullptr;
  unsigned (*bind_api)(unsigned) = nullptr;
  unsigned (*choose_config)(EglDisplay, const int32_t*, EglConfig*, int32_t, int32_t*) = nullptr;
  EglContextHandle (*create_context)(EglDisplay, EglConfig, EglContextHandle, const int32_t*) = nullptr;
  unsigned (*destroy_context)(EglDisplay, EglContextHandle) = nullptr;
  unsigned (*make_current)(EglDisplay, EglSurface, EglSurface, EglContextHandle) = nullptr;
  EglDisplay display = nullptr;
  std::string failure;
};

constexpr const char* kWhatToInstall = "install the Debian packages libegl1 and libgl1-mesa-dri";

/// The library and its display, which live as long as the process does.
const Egl& egl() {
  static Egl loaded;
  static std::once_flag once;
  std::call_once(once, [] {
    void* library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
      loaded.failure = std::string("no libEGL.so.1 here: ") + kWhatToInstall;
      return;
    }
    bool complete = true;
    const auto find = [&](const char* name, auto* function) {
      *function = reinterpret_cast<std::remove_reference_t<decltype(*function)>>(dlsym(library, name));
      complete = complete && *function != nullptr;
    };
    find("eglGetProcAddress", &loaded.get_proc_address);
    find("eglGetPlatformDisplay", &loaded.get_platform_display);
    find("eglInitialize", &loaded.initialize);
    find("eglBindAPI", &loaded.bind_api);
    find("eglChooseConfig", &loaded.choose_config);
    find("eglCreateContext", &loaded.create_context);
    find("eglDestroyContext", &loaded.destroy_context);
    find("eglMakeCurrent", &loaded.make_current);
    if (!complete) {
      loaded.failure = std::string("libEGL is older than 1.5: ") + kWhatToInstall;
      return;
    }
    setenv("LP_NUM_THREADS", "0", 0);  // as for OSMesa: a simulator owns one core
    EglDisplay display = loaded.get_platform_display(kPlatformSurfaceless, nullptr, nullptr);
    if (display == nullptr || !loaded.initialize(display, nullptr, nullptr)) {
      loaded.failure = std::string("EGL has no surfaceless platform here: ") + kWhatToInstall;
      return;
    }
    loaded.display = display;
  });
  return loaded;
}

class EglContext : public ContextProvider {
 public:
  explicit EglContext(EglContextHandle context) : context_(context) {}
  ~EglContext() override {
    egl().make_current(egl().display, nullptr, nullptr, nullptr);
    egl().destroy_context(egl().display, context_);
    forget_current();
  }
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  void* function(const char* name) const override { return egl().get_proc_address(name); }

 protected:
  Status bind() override {
    if (!egl().bind_api(kOpenGlApi) || !egl().make_current(egl().display, nullptr, nullptr, context_))
      return Error{ErrorCode::kUnsupported, "EGL cannot make its context current"};
    return {};
  }

 private:
  EglContextHandle context_;
};

}  // namespace

Expected<std::unique_ptr<ContextProvider>> create_egl_context() {
  const Egl& library = egl();
  if (library.display == nullptr) return Error{ErrorCode::kUnsupported, library.failure};
  const int32_t wanted[] = {kRenderableType, kOpenGlBit, kSurfaceType, 0, kNone};
  EglConfig config = nullptr;
  int32_t count = 0;
  const int32_t attributes[] = {kContextMajor, 3, kContextMinor, 3, kContextProfile, kCoreProfile, kNone};
  EglContextHandle context = nullptr;
  if (library.bind_api(kOpenGlApi) && library.choose_config(library.display, wanted, &config, 1, &count) &&
      count > 0)
    context = library.create_context(library.display, config, nullptr, attributes);
  if (context == nullptr)
    return Error{ErrorCode::kUnsupported,
                 std::string("EGL gives no OpenGL 3.3 core context: ") + kWhatToInstall};
  auto provider = std::make_unique<EglContext>(context);
  COMRAD_TRY(provider->make_current());
  return std::unique_ptr<ContextProvider>(std::move(provider));
}

}  // namespace comrad::doom
