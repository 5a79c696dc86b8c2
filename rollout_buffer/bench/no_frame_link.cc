// In the place of frame_link.cc in a build with -DCOMRAD_HOSTS=OFF.
#include "rollout_buffer/bench/frame_link.h"

namespace comrad::bench {

Status check_link(const BenchedLink&) {
  return Error{ErrorCode::kUnsupported,
               "--link dds: this build of comrad plays on one host only (COMRAD_HOSTS is OFF); "
               "configure it with -DCOMRAD_HOSTS=ON and build it again"};
}
void receive(const shm::Arena&, const BenchedLink&) {}
SentFrames send(const shm::Arena&, const BenchedLink&) { return {}; }

}  // namespace comrad::bench
