// Scripts in the manner of public ones, and every function with its numbers of arguments: both compile here and, where
// COMRAD_ACC names the community's compiler, there.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "doomgen/acs/compiler.h"
#include "tests/support/scratch_folder.h"

namespace comrad::acs_compiler {
namespace corpus_test {

const std::string kCorpus = COMRAD_SOURCE_DIR "/tests/unit/doomgen/acs/corpus";

std::vector<std::string> corpus() {
  std::vector<std::string> paths;
  for (const auto& entry : std::filesystem::directory_iterator(kCorpus))
    if (entry.path().extension() == ".acs") paths.push_back(entry.path().string());
  std::sort(paths.begin(), paths.end());
  return paths;
}

struct FunctionRow {
  std::string name;
  int args_min = 0, args_max = 0;
  bool has_value = false;
};

std::vector<FunctionRow> functions() {
  std::vector<FunctionRow> rows;
  std::ifstream file(kCorpus + "/functions.txt");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with('#')) continue;
    FunctionRow row;
    std::string value;
    std::istringstream words(line);
    EXPECT_TRUE(words >> row.name >> row.args_min >> row.args_max >> value) << line;
    row.has_value = value == "value";
    rows.push_back(row);
  }
  return rows;
}

std::string call(const FunctionRow& row, int arg_count) {
  std::string text = row.name + "(";
  for (int i = 0; i < arg_count; ++i) text += i == 0 ? "1" : ", 1";
  return text + ")";
}

/// A script that calls every function with the fewest and with the most arguments.
std::string all_functions() {
  std::string source = "#include \"zcommon.acs\"\nint x;\nscript 1 OPEN\n{\n";
  for (const FunctionRow& row : functions())
    for (const int arg_count : {row.args_min, row.args_max})
      source += (row.has_value ? "  x = " : "  ") + call(row, arg_count) + ";\n";
  return source + "}\n";
}

bool compiles(const std::string& statement) {
  return compile("int x; script 1 OPEN { " + statement + "; }", "test.acs").has_value();
}

TEST(AcsCorpus, Compiles) {
  ASSERT_GE(corpus().size(), 16u);
  for (const std::string& path : corpus()) {
    const Expected<CompiledScript> script = compile_file(path);
    EXPECT_TRUE(script.has_value()) << (script ? "" : script.error().message);
  }
}

TEST(AcsCorpus, FunctionsTakeTheirNumbersOfArguments) {
  ASSERT_GE(functions().size(), 228u);
  const Expected<CompiledScript> script = compile(all_functions(), "all_functions.acs");
  EXPECT_TRUE(script.has_value()) << (script ? "" : script.error().message);
  for (const FunctionRow& row : functions()) {
    EXPECT_FALSE(compiles(call(row, row.args_max + 1))) << row.name;
    EXPECT_TRUE(row.args_min == 0 || !compiles(call(row, row.args_min - 1))) << row.name;
    EXPECT_EQ(compiles("x = " + call(row, row.args_max)), row.has_value) << row.name;
  }
}

TEST(AcsCorpus, CompilesWithTheCommunitysCompiler) {
  const char* const compiler = std::getenv("COMRAD_ACC");
  if (compiler == nullptr) {  // no GTEST_SKIP: the other cases of this entry count
    std::puts("skipped: set COMRAD_ACC to the community's compiler to compile the corpus with it");
    return;
  }
  const comrad::test::ScratchFolder folder;
  std::vector<std::string> paths = corpus();
  paths.push_back(folder.write("all.acs", all_functions()));
  const std::string output = (folder / "out.o").string(), errors = (folder / "errors.txt").string();
  for (const std::string& path : paths) {
    const std::string command =
        std::string(compiler) + " -i " + kCorpus + " " + path + " " + output + " > " + errors + " 2>&1";
    std::error_code ignored;
    std::filesystem::remove(output, ignored);
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
    EXPECT_TRUE(std::filesystem::exists(output)) << command;
  }
}

}  // namespace corpus_test
}  // namespace comrad::acs_compiler
