#include "policy_workers/device/cpu_tuning.h"

#include <dlfcn.h>
#include <malloc.h>

#include "policy_workers/device/torch_ops.h"

namespace comrad::device {

void tune_allocator() {
  // glibc gives large blocks back to the kernel on every free; each forward pass then pays a page fault per 4
  // KiB of every activation again. Kept blocks made a pass over 128 rows about a third faster.
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, (1 << 30) + ((1 << 30) - 1));
  mallopt(M_TOP_PAD, 64 << 20);
}

void set_operator_threads(int thread_count) {
  // at::set_num_threads() would also make the pool of libtorch's operators for telephones anew, which nothing here uses:
  // each of its threads then waits awake for 20 ms. Operators ask OpenMP.
  static const auto set_openmp_threads =
      reinterpret_cast<void (*)(int)>(dlsym(RTLD_DEFAULT, "omp_set_num_threads"));
  // libtorch sets a thread's number at its first question, and would do so later.
  (void)at::get_num_threads();
  if (set_openmp_threads != nullptr) set_openmp_threads(thread_count);
  if (at::get_num_threads() != thread_count) at::set_num_threads(thread_count);
}

void set_math_threads(int thread_count) {
  set_operator_threads(thread_count);
  // OpenBLAS built on its own threads ignores OpenMP's limits; its waiting threads take whole cores from those that
  // compute. Built on OpenMP it would follow by itself; other libraries have no such function.
  static const auto set_blas_threads =
      reinterpret_cast<void (*)(int)>(dlsym(RTLD_DEFAULT, "openblas_set_num_threads"));
  if (set_blas_threads != nullptr) set_blas_threads(thread_count);
}

void tune_math(int thread_count) {
  at::globalContext().setFlushDenormal(true);  // threads that are yet to begin take it over
  at::set_num_threads(thread_count);           // of them, too
  set_math_threads(thread_count);
}

OneMathThread::OneMathThread() : before_(at::get_num_threads()) { set_math_threads(1); }
OneMathThread::~OneMathThread() { set_math_threads(before_); }

}  // namespace comrad::device
