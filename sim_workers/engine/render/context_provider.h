// Where an OpenGL 3.3 core context without a window comes from: OSMesa (osmesa_context.h), or EGL without a
// surface (egl_context.h) for Mesa versions that dropped OSMesa. Stage: render.
#pragma once

#include <memory>

#include "rollout_buffer/core/expected.h"

namespace comrad::doom {

class ContextProvider {
 public:
  virtual ~ContextProvider() {
    if (current_ == this) current_ = nullptr;
  }
  /// Makes the context current in the calling thread; cheap when it is already.
  Status make_current() {
    if (current_ == this) return {};
    COMRAD_TRY(bind());
    current_ = this;
    return {};
  }
  /// Address of a GL function, null where the library has none.
  virtual void* function(const char* name) const = 0;

 protected:
  virtual Status bind() = 0;
  static void forget_current() { current_ = nullptr; }

 private:
  // Of the thread, whatever the provider: contexts of both may take turns.
  static thread_local const ContextProvider* current_;
};

}  // namespace comrad::doom
