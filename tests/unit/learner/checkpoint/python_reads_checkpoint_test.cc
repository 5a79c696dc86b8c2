// Python's torch.load(path, weights_only=True) is the promised reader of checkpoints; this runs a
// real one (tests/support/test_python.h); without one the test is skipped.
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "learner/checkpoint/checkpoint.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/test_python.h"

namespace comrad::learn {
namespace python_reads_checkpoint_test {

TEST(PythonReadsCheckpoint, WithWeightsOnlyAndEveryValue) {
  const Expected<std::string> python = test::python_with("torch");
  if (!python) GTEST_SKIP() << python.error().message;

  const test::ScratchFolder folder;
  StateDict state;
  state.put("network/encoder.weight", torch::arange(12, torch::kFloat32).view({3, 4}));
  state.put("network/statistics", torch::arange(3, torch::kFloat64));
  state.put("journal/action", torch::arange(6, torch::kUInt8));
  state.put("journal/header", torch::full({2, 5}, -7, torch::kInt64));
  state.put("counters/env_frames", int64_t{1} << 40);
  state.put("schedule/learning_rate", 1e-4);
  state.put("config/toml", std::string("algo = \"ippo\"\n"));
  ASSERT_TRUE(write_checkpoint((folder / "a.pt").string(), state));
  folder.write("read.py", R"(
import sys, torch
# The safe reader of PyTorch 1.13, the first that has one, rejects Python floats; everything else is the same.
d = torch.load(sys.argv[1], weights_only=not torch.__version__.startswith("1."))
assert d["format"] == "comrad-checkpoint" and d["layout_version"] == 1, d
assert torch.equal(d["network"]["encoder.weight"], torch.arange(12, dtype=torch.float32).view(3, 4))
assert torch.equal(d["network"]["statistics"], torch.arange(3, dtype=torch.float64))
assert torch.equal(d["journal"]["action"], torch.arange(6, dtype=torch.uint8))
assert torch.equal(d["journal"]["header"], torch.full((2, 5), -7))
assert d["counters"]["env_frames"] == 1 << 40
assert d["schedule"]["learning_rate"] == 1e-4
assert d["config"]["toml"] == 'algo = "ippo"\n'
)");
  const std::string command =
      *python + " " + (folder / "read.py").string() + " " + (folder / "a.pt").string();
  EXPECT_EQ(std::system(command.c_str()), 0);
}

}  // namespace python_reads_checkpoint_test
}  // namespace comrad::learn
