#include "sim_workers/engine/render/context_provider.h"

namespace comrad::doom {

thread_local const ContextProvider* ContextProvider::current_ = nullptr;

}  // namespace comrad::doom
