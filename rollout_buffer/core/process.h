// What every program of COMRAD does first, and what it says with its exit code.
#pragma once

namespace comrad {

constexpr int kExitDone = 0;
constexpr int kExitFailed = 1;
constexpr int kExitBadInput = 2;  ///< starting it again cannot help
constexpr int kExitNotSaved = 3;  ///< the learner: its work is done, its last checkpoint could not be written

/// Call first in main(). Opens descriptors 0 to 2 on /dev/null where the caller closed them, so that no file of
/// ours gets their numbers; a closed pipe and a limit of file size (`ulimit -f`) become errors of write() instead
/// of a silent death.
void prepare_process();

}  // namespace comrad
