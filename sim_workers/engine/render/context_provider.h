// Where an OpenGL 3.3 core context without a window comes from. OSMesa is the first provider
// (osmesa_context.h); EGL without a surface is to be the second, for Mesa versions that dropped OSMesa.
// Stage: render.
#pragma once

#include <memory>
#include <string_view>

#include "rollout_buffer/core/expected.h"

namespace comrad::doom {

class ContextProvider {
 public:
  /// Makes a context by provider name. Errors: kBadInput for an unknown name, kUnsupported when none can be
  /// had.
  static Expected<std::unique_ptr<ContextProvider>> create(std::string_view name);
  virtual ~ContextProvider() = default;
  /// Makes the context current in the calling thread; cheap when it is already.
  virtual Status make_current() = 0;
  /// Address of a GL function, null where the library has none.
  virtual void* function(const char* name) const = 0;
};

}  // namespace comrad::doom
