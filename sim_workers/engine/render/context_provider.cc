#include "sim_workers/engine/render/context_provider.h"

#include <string>

#include "sim_workers/engine/render/egl_context.h"
#include "sim_workers/engine/render/osmesa_context.h"

namespace comrad::doom {

thread_local const ContextProvider* ContextProvider::current_ = nullptr;

Expected<std::unique_ptr<ContextProvider>> ContextProvider::create(std::string_view name) {
  if (name == "osmesa") return create_osmesa_context();
  if (name == "egl") return create_egl_context();
  if (name == "auto") {
    Expected<std::unique_ptr<ContextProvider>> first = create_osmesa_context();
    if (first) return first;
    Expected<std::unique_ptr<ContextProvider>> second = create_egl_context();
    if (second) return second;
    return Error{ErrorCode::kUnsupported, first.error().message + "; " + second.error().message};
  }
  return Error{ErrorCode::kBadInput,
               "unknown context provider '" + std::string(name) + "': known are osmesa, egl and auto"};
}

}  // namespace comrad::doom
