// What every program of COMRAD does first, and the meaning of its exit code.
#pragma once

#include <signal.h>

#include <initializer_list>

#include "rollout_buffer/core/expected.h"

namespace comrad {

constexpr int kExitDone = 0;
constexpr int kExitFailed = 1;
constexpr int kExitBadInput = 2;  ///< starting it again cannot help
constexpr int kExitNotSaved = 3;  ///< the learner: its work is done, its last checkpoint could not be written

/// The exit code that an error stands for: kExitBadInput where what the program was given cannot be used (bad input
/// or format, something that is not there or that this build cannot do), kExitNotSaved, else kExitFailed.
int exit_code(const Error& error);

/// Call first in main(). Opens descriptors 0 to 2 on /dev/null where the caller closed them, so that no file of
/// ours gets their numbers; a closed pipe and a limit of file size (`ulimit -f`) become errors of write() instead
/// of a silent death.
void prepare_process();

/// Those of `signals` that this process does not ignore: what was ignored when it was started (nohup, a shell's background
/// job) stays ignored.
sigset_t heard_of(std::initializer_list<int> signals);

/// Leaves most of the cores and the disks to all others: a tenth of another process's share, for this process and those that
/// it starts from now on, so that it gets on beside any load. A lower priority stays.
void yield_to_others();
/// How much longer than usual a thing may take: 1, or more in a process that leaves cores to others (by
/// yield_to_others(), nice(1) or chrt(1)).
double patience();

}  // namespace comrad
