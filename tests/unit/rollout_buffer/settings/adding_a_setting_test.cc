// "Adding things" of the README, done for a setting: one row in a .def file, and a program compiled with it has the setting in its
// struct, its layers, its TOML, its checks and its help.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "rollout_buffer/core/files.h"
#include "tests/support/scratch_folder.h"

namespace comrad {
namespace adding_a_setting_test {

using ::testing::HasSubstr;

constexpr const char* kRow = R"(
SETTING(double, weight_decay, 0.0, between(0, 1),
        "share of every weight that a step takes away", .old_names = {"wd"})
)";

constexpr const char* kProgram = R"(
#include <cstdio>
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/setting.h"
int main() {
  comrad::RunConfig config;
  config.environment.num_agents = 2;
  const comrad::Status set = comrad::apply_layer(config, {"command line", {{"wd", "0.25"}}});
  if (!set || config.optimisation.weight_decay != 0.25) return 1;
  std::puts(comrad::settings_to_toml(config).c_str());
  std::puts(std::string(comrad::find_setting("weight_decay")->help).c_str());
  config.optimisation.weight_decay = 2;
  std::puts(comrad::resolve_settings(config, 2).error().message.c_str());
}
)";

struct Ending {
  int status = -1;
  std::string output;
};
Ending run(const std::string& command) {
  Ending ending;
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (pipe == nullptr) return ending;
  char part[4096];
  for (size_t read; (read = fread(part, 1, sizeof part, pipe)) > 0;) ending.output.append(part, read);
  ending.status = pclose(pipe);
  return ending;
}

TEST(AddingASetting, IsOneRow) {
  const std::string source = COMRAD_SOURCE_DIR, folder = source + "/rollout_buffer/";
  const test::ScratchFolder scratch;
  const auto rows = read_file(folder + "settings/optimisation.def");
  ASSERT_TRUE(rows);
  scratch.write("with/rollout_buffer/settings/optimisation.def", *rows + kRow);
  const std::string program = (scratch / "program").string(), main = scratch.write("main.cc", kProgram);
  std::string command =
      std::string(COMRAD_CXX) + " -std=c++20 -O0 -DSPDLOG_FMT_EXTERNAL -DCOMRAD_SOURCE_DIR='\"\"' -I'" +
      (scratch / "with").string() + "' -I'" + source + "' '" + main + "' -o '" + program + "'";
  for (const char* file : {"core/check.cc", "core/files.cc", "core/text.cc", "core/toml_text.cc",
                           "settings/algorithms.cc", "settings/drawn_batch.cc", "settings/encoder_layers.cc",
                           "settings/layers.cc", "settings/other_names.cc", "settings/resolve.cc",
                           "settings/reward_weights.cc", "settings/schedule.cc", "settings/setting.cc"})
    command += " '" + folder + file + "'";
  command += " -lfmt";
  const Ending built = run(command);
  ASSERT_EQ(built.status, 0) << built.output;
  const Ending ran = run("'" + program + "'");
  ASSERT_EQ(ran.status, 0) << ran.output;
  EXPECT_THAT(ran.output, HasSubstr("weight_decay = 0.25\n"));
  EXPECT_THAT(ran.output, HasSubstr("share of every weight that a step takes away"));
  EXPECT_THAT(ran.output, HasSubstr("weight_decay is 2.0; it must be between 0 and 1"));
}

}  // namespace adding_a_setting_test
}  // namespace comrad
