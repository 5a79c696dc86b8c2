// What the arena must know of the run's network. The network itself reports it (comrad-policy-worker --describe), so that no
// bound on its size is in a lower layer. Stage: start-up.
#pragma once

#include <cstdint>

namespace comrad {

struct NetworkSize {
  int64_t weights_bytes = 0;          ///< parameters and input statistics, as the learner publishes them
  int64_t parameter_bytes = 0;        ///< of these, the parameters, f32; they come first
  int32_t recurrent_state_count = 0;  ///< floats of recurrent state per agent; 0 without a core
};

}  // namespace comrad
