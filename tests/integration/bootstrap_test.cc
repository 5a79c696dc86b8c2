// The ./comrad script, on a small project of the same shape: it builds what is missing, does nothing when
// nothing changed, shows errors, and never installs when it must not.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "tests/integration/running_program.h"

namespace comrad::test {
namespace bootstrap_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

/// A source tree with this repository's ./comrad and programs of a few lines.
class SmallProject : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::copy_file(fs::path(COMRAD_SOURCE_DIR) / "comrad", home_ / "comrad");
    for (const char* part : {"rollout_buffer", "doomgen", "scenarios", "sim_workers", "policy_workers",
                             "learner", "deploy", "tests"})
      fs::create_directories(home_ / part);
    write("deploy/packages.txt", "# Tools\ncmake\n");
    write("deploy/main.c",
          "#include <stdio.h>\nint main(int n, char **v) {\n"
          "  for (int i = 1; i < n; ++i) printf(\"[%s]\", v[i]);\n  return n > 3 ? 3 : 0;\n}\n");
    write("CMakeLists.txt",
          "cmake_minimum_required(VERSION 3.25)\nproject(small C)\n"
          "set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)\n"
          "file(WRITE ${CMAKE_BINARY_DIR}/torch.argument \"${COMRAD_TORCH}\")\n"
          "add_custom_target(programs)\n"
          "foreach(name comrad comrad-newest)\n"
          "  add_executable(${name} deploy/main.c)\n  add_dependencies(programs ${name})\nendforeach()\n"
          "add_executable(comrad-rare EXCLUDE_FROM_ALL deploy/main.c)\n"
          "add_custom_target(tools DEPENDS comrad-rare programs)\n"
          "add_executable(suite tests/suite.c)\nadd_dependencies(suite tools)\n");
    write("tests/suite.c", "int main(void) { return 0; }\n");
  }

  void write(const std::string& name, const std::string& text) { std::ofstream(home_ / name) << text; }

  Ending run(const std::vector<std::string>& arguments, const Environment& environment = {}) {
    std::vector<std::string> command = {"/bin/bash", home_ / "comrad"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Environment all = {{"COMRAD_NO_INSTALL", "1"}, {"COMRAD_BUILD_DIR", home_ / "build"},
                       {"COMRAD_TORCH", ""},       {"COMRAD_DRIVER_FILE", home_ / "driver"},
                       {"COMRAD_CMAKE_ARGS", ""},  {"CI", ""}};
    for (const auto& [name, value] : environment) all[name] = value;
    return RunningProgram(command, all).wait();
  }

  ScratchFolder home_;
};

TEST_F(SmallProject, BuildsOnceThenOnlyRuns) {
  const Ending first = run({"train", "--seed", "1"});
  EXPECT_EQ(first.exit_code, 3) << first.err;  // the program's own exit code
  EXPECT_EQ(first.out, "[train][--seed][1]");
  EXPECT_THAT(first.err, HasSubstr("comrad: built in"));
  EXPECT_TRUE(fs::exists(home_ / "build/bin/comrad-newest"));  // the script has no list of programs
  EXPECT_FALSE(fs::exists(home_ / "build/bin/suite"));         // the suite is built for `test` alone

  // No tool of a build is called again.
  fs::create_directories(home_ / "called");
  for (const char* tool : {"cmake", "ninja", "make", "cc", "c++", "dpkg-query"}) {
    write(std::string("called/") + tool, "#!/bin/sh\necho called $0 >&2\nexit 1\n");
    fs::permissions(home_ / ("called/" + std::string(tool)), fs::perms::owner_all);
  }
  const Ending again = run({"version"}, {{"PATH", (home_ / "called:").string() + std::getenv("PATH")}});
  EXPECT_EQ(again.exit_code, 0);
  EXPECT_EQ(again.out, "[version]");
  EXPECT_EQ(again.err, "");

  EXPECT_EQ(run({"test"}).out, "[test]");
  EXPECT_TRUE(fs::exists(home_ / "build/bin/suite"));
  EXPECT_EQ(run({"version"}).err, "");  // building all brought the programs up to date too
}

TEST_F(SmallProject, BuildsRareProgramsWhenACommandNeedsThem) {
  ASSERT_EQ(run({"version"}).exit_code, 0);
  EXPECT_EQ(run({"scenarios", "list"}).err, "");
  EXPECT_FALSE(fs::exists(home_ / "build/bin/comrad-rare"));
  EXPECT_THAT(run({"scenarios", "--gallery"}).err, HasSubstr("comrad: building tools"));
  EXPECT_TRUE(fs::exists(home_ / "build/bin/comrad-rare"));
  for (const char* command : {"bench", "tune", "trace", "acs", "version"})
    EXPECT_EQ(run({command}).err, "") << command;
}

TEST_F(SmallProject, ContinuousIntegrationSharesTheBuildAndAllowsNoWarning) {
  const Environment ci = {{"CI", "true"}};
  ASSERT_EQ(run({"version"}).exit_code, 0);
  EXPECT_EQ(run({"version"}, ci).err, "") << "the same objects";
  write("deploy/main.c", "#warning something is odd\nint main(void) { return 0; }\n");
  EXPECT_EQ(run({"version"}).exit_code, 0) << "a user may continue";
  for (int attempt = 0; attempt < 2; ++attempt) {
    const Ending refused = run({"version"}, ci);
    EXPECT_EQ(refused.exit_code, 1);
    EXPECT_THAT(refused.err, AllOf(HasSubstr("something is odd"), HasSubstr("the compiler warned")));
  }
  write("deploy/main.c", "int main(void) { return 0; }\n");
  EXPECT_EQ(run({"version"}, ci).exit_code, 0);
  EXPECT_EQ(run({"version"}).err, "");
}

TEST_F(SmallProject, ASecondUserRunsTheFinishedBuildOrGetsAnInstruction) {
  if (geteuid() != 0 || !fs::exists("/usr/bin/setpriv"))
    GTEST_SKIP() << "only root can become another user (with util-linux's setpriv)";
  const auto as_nobody = [&](const std::vector<std::string>& words) {
    std::vector<std::string> command = {"/usr/bin/setpriv", "--reuid",   "65534",         "--regid", "65534",
                                        "--clear-groups",   "/bin/bash", home_ / "comrad"};
    command.insert(command.end(), words.begin(), words.end());
    const std::string build = home_ / "build";
    return RunningProgram(command, {{"COMRAD_NO_INSTALL", "1"},
                                    {"COMRAD_BUILD_DIR", build},
                                    {"COMRAD_TORCH", ""},
                                    {"COMRAD_DRIVER_FILE", home_ / "driver"},
                                    {"CI", ""}})
        .wait();
  };
  // A commit, whose owner git does not trust for another user, is a part of the stamp.
  const std::string home = home_.string();
  ASSERT_EQ(
      RunningProgram(
          {"/bin/bash", "-c",
           "cd '" + home +
               "' && git init -q && git add comrad && git -c user.name=a -c user.email=a@b commit -qm a"})
          .wait()
          .exit_code,
      0);
  fs::permissions(home, fs::perms(0755));
  ASSERT_EQ(run({"version"}).exit_code, 0);
  const Ending theirs = as_nobody({"version"});
  EXPECT_EQ(theirs.exit_code, 0) << theirs.err;
  EXPECT_EQ(theirs.out, "[version]");
  EXPECT_EQ(theirs.err, "");

  write("deploy/main.c", "int main(void) { return 0; }\n");
  const Ending stale = as_nobody({"version"});
  EXPECT_EQ(stale.exit_code, 1);
  EXPECT_THAT(stale.err, AllOf(HasSubstr("belongs to root"), HasSubstr("COMRAD_BUILD_DIR")));
}

TEST_F(SmallProject, RebuildsWhenASourceChangedOrWent) {
  ASSERT_EQ(run({"version"}).exit_code, 0);
  write("deploy/main.c", "#include <stdio.h>\nint main(void) { puts(\"new\"); return 0; }\n");
  EXPECT_EQ(run({"version"}).out, "new\n");
  write("deploy/extra.c", "int extra;\n");
  EXPECT_THAT(run({"version"}).err, HasSubstr("building"));
  fs::remove(home_ / "deploy/extra.c");
  EXPECT_THAT(run({"version"}).err, HasSubstr("building"));
  EXPECT_THAT(run({"version"}, {{"COMRAD_CMAKE_ARGS", "-DSOMETHING=1"}}).err, HasSubstr("building"));
}

TEST_F(SmallProject, ShowsTheErrorOfABuildThatFails) {
  write("deploy/main.c", "int main(void) { return missing_name; }\n");
  const Ending broken = run({"version"});
  EXPECT_EQ(broken.exit_code, 1);
  EXPECT_EQ(broken.out, "");
  EXPECT_THAT(broken.err, AllOf(HasSubstr("missing_name"), HasSubstr("build.log")));
  write("CMakeLists.txt", "this is no cmake\n");
  const Ending unconfigured = run({"version"});
  EXPECT_EQ(unconfigured.exit_code, 1);
  EXPECT_THAT(unconfigured.err, HasSubstr("could not configure"));
}

TEST_F(SmallProject, NamesMissingPackagesAndInstallsNoneWithNoInstall) {
  if (!fs::exists("/usr/bin/dpkg-query")) GTEST_SKIP() << "packages are checked on Debian alone";
  write("deploy/packages.txt", "cmake\nno-such-package-anywhere\n");
  const Ending ending = run({"version"});
  EXPECT_EQ(ending.exit_code, 1);
  EXPECT_THAT(ending.err, AllOf(HasSubstr("apt-get install --no-install-recommends no-such-package-anywhere"),
                                Not(HasSubstr("cmake"))));
}

/// How apt-get is asked: another program may hold its lock for a while on a machine that has just started.
const std::string kInstall = "install -q -y -o DPkg::Lock::Timeout=300 --no-install-recommends ";

/// apt-get, dpkg-query and python3 that record their arguments.
class SmallProjectWithTools : public SmallProject {
 protected:
  void SetUp() override {
    SmallProject::SetUp();
    fs::create_directories(home_ / "bin");
    tool("dpkg-query", "echo 'cmake=installed ninja-build=not-installed clang=not-installed '");
    tool("apt-get", "echo \"$@\" >>'" + asked_for("apt") + "'; [ \"$1\" != install ] || [ ! -e '" +
                        (home_ / "full").string() + "' ]");
    tool("sudo", "exec \"$@\"");
    // `-m venv FOLDER` puts this same program there, `-m pip install ... NAME` fails for the names in `offline`.
    tool("python3",
         "echo \"$@\" >>'" + asked_for("python") +
             "'\n[ \"$2\" != venv ] || { mkdir -p \"$3/bin\" && cp \"$0\" \"$3/bin/python\"; exit; }\n"
             "for last; do :; done\n! grep -qsx \"$last\" '" +
             (home_ / "offline").string() + "'");
    write("tests/suite.c", "int main(void) { return 0; }\n");
    write("deploy/main.c",
          "#include <stdio.h>\n#include <stdlib.h>\n"
          "int main(void) { const char *p = getenv(\"COMRAD_TEST_PYTHON\"); puts(p && *p ? p : \"none\"); "
          "return "
          "0; }\n");
  }
  void tool(const std::string& name, const std::string& script) {
    write("bin/" + name, "#!/bin/sh\n" + script + "\n");
    fs::permissions(home_ / ("bin/" + name), fs::perms::owner_all);
  }
  std::string asked_for(const std::string& what) const { return (home_ / (what + ".asked")).string(); }
  Ending run_with_tools(const std::vector<std::string>& arguments, Environment more = {}) {
    more.insert({{"COMRAD_NO_INSTALL", ""},
                 {"COMRAD_TEST_PYTHON", ""},
                 {"PATH", (home_ / "bin:").string() + std::getenv("PATH")}});
    return run(arguments, more);
  }
  /// The tool's arguments since the last call.
  std::string take_asked_for(const std::string& what) {
    const std::string text = fs::exists(asked_for(what)) ? read_text(asked_for(what)) : "";
    fs::remove(asked_for(what));
    return text;
  }
  const std::string test_python_ = home_ / "build/test-python/bin/python";
};

TEST_F(SmallProjectWithTools, InstallsWhatIsMissingWithAptGet) {
  write("deploy/packages.txt",
        "cmake  program cmake\nninja-build\nlibosmesa6-dev  library OSMesa  # draws\n");
  write("full", "no space left");
  const Ending failed = run_with_tools({"version"});
  EXPECT_EQ(failed.exit_code, 1);
  EXPECT_THAT(failed.err, HasSubstr("could not be installed"));
  fs::remove(home_ / "full");
  take_asked_for("apt");
  const Ending installed = run_with_tools({"version"});
  EXPECT_EQ(installed.exit_code, 0) << installed.err;
  EXPECT_THAT(installed.err, HasSubstr("installing 2 Debian packages"));
  EXPECT_EQ(take_asked_for("apt"), "update -q\n" + kInstall + "ninja-build libosmesa6-dev\n");
  EXPECT_EQ(take_asked_for("python"), "") << "that is for `test` alone";
}

TEST_F(SmallProjectWithTools, ListsWhatItLooksForWhereThereIsNoDpkg) {
  write("deploy/packages.txt", "cmake  program cmake, 3.25\nlibzip-dev  pkg-config module libzip\n");
  const fs::path programs = home_ / "programs";
  fs::create_directories(programs);
  for (const fs::directory_entry& entry : fs::directory_iterator("/usr/bin"))
    if (!entry.path().filename().string().starts_with("dpkg"))
      fs::create_symlink(entry.path(), programs / entry.path().filename());
  const Environment elsewhere = {{"PATH", programs.string()}, {"COMRAD_NO_INSTALL", ""}};
  const Ending first = run({"version"}, elsewhere);
  EXPECT_EQ(first.exit_code, 0) << first.err;
  EXPECT_THAT(first.err, AllOf(HasSubstr("comrad:   program cmake, 3.25 (cmake)\n"),
                               HasSubstr("comrad:   pkg-config module libzip (libzip-dev)\n"),
                               Not(HasSubstr("installing"))));
  write("deploy/main.c", "int main(void) { return 0; }\n");
  const Ending again = run({"version"}, elsewhere);
  EXPECT_THAT(again.err, AllOf(HasSubstr("built in"), Not(HasSubstr("libzip")))) << "once it was built";
}

TEST_F(SmallProjectWithTools, InstallsWhatTheTestsNeedOnce) {
  write("deploy/packages_test.txt", "# fuzzers\ncmake\nclang\n");
  write("deploy/requirements_test.txt", "numpy==1  # comparisons\ntorch==2\n");
  const Ending first = run_with_tools({"test"});
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_EQ(first.out, test_python_ + "\n") << "the tests hear of it";
  EXPECT_THAT(first.err, AllOf(HasSubstr("installing 1 Debian packages of deploy/packages_test.txt: clang"),
                               HasSubstr("installing 2 Python packages"), HasSubstr("numpy==1 torch==2")));
  EXPECT_EQ(take_asked_for("apt"), "update -q\n" + kInstall + "clang\n");
  EXPECT_THAT(take_asked_for("python"),
              AllOf(HasSubstr("-m venv " + (home_ / "build/test-python").string() + "\n"),
                    HasSubstr(" numpy==1\n"), HasSubstr(" torch==2\n")));

  const Ending again = run_with_tools({"test"});
  EXPECT_EQ(again.out, test_python_ + "\n");
  EXPECT_EQ(again.err, "");
  EXPECT_EQ(take_asked_for("apt") + take_asked_for("python"), "");

  write("deploy/requirements_test.txt", "numpy==2\n");
  EXPECT_EQ(run_with_tools({"test", "--help"}).exit_code, 0);
  EXPECT_EQ(take_asked_for("python"), "") << "help installs nothing";
  EXPECT_EQ(run_with_tools({"test"}, {{"COMRAD_TEST_PYTHON", "/my/python"}}).out, "/my/python\n");
  EXPECT_THAT(take_asked_for("python"), Not(HasSubstr("pip"))) << "a Python of one's own is left as it is";
  write("deploy/requirements_test.txt", "numpy==3\n");
  EXPECT_EQ(run_with_tools({"test"}).exit_code, 0);
  EXPECT_THAT(take_asked_for("python"), HasSubstr(" numpy==3\n")) << "a list that changed is read again";
}

TEST_F(SmallProjectWithTools, ConfiguresAgainOnceThePythonOfTheTestsIsThere) {
  write("deploy/requirements_test.txt", "numpy==1\n");
  write("CMakeLists.txt",
        read_text(home_ / "CMakeLists.txt") +
            "file(APPEND ${CMAKE_BINARY_DIR}/python.argument \"[$ENV{COMRAD_TEST_PYTHON}]\")\n");
  ASSERT_EQ(run_with_tools({"test", "-N"}).exit_code, 0);  // builds, and installs nothing
  EXPECT_EQ(read_text(home_ / "build/python.argument"), "[]");
  ASSERT_EQ(run_with_tools({"test"}).exit_code, 0);
  EXPECT_EQ(read_text(home_ / "build/python.argument"), "[][" + test_python_ + "]");
}

TEST_F(SmallProjectWithTools, InstallsWhatASearchNeedsForASweepThatSearches) {
  write("deploy/requirements_search.txt", "optuna==1\n");
  write("plain.toml", "name = \"plain\"\n[axes]\nseed = [1]\n");
  write("pbt.toml", "[search]\nmethod = \"pbt\"\n");
  write("tpe.toml", "[search]\n  method = \"tpe\"\n");
  const std::string plain = home_ / "plain.toml", pbt = home_ / "pbt.toml", tpe = home_ / "tpe.toml";
  for (const std::vector<std::string>& words : {std::vector<std::string>{"sweep"},
                                                {"sweep", "status", "plain"},
                                                {"sweep", plain},
                                                {"sweep", pbt},
                                                {"train", tpe}})
    EXPECT_EQ(run_with_tools(words).exit_code, 0);
  EXPECT_EQ(run_with_tools({"sweep", tpe}, {{"COMRAD_SEARCH_PYTHON", "/my/python"}}).exit_code, 0);
  EXPECT_EQ(take_asked_for("python"), "");
  EXPECT_EQ(run_with_tools({"sweep", "--dry_run", tpe}).exit_code, 0);
  EXPECT_THAT(take_asked_for("python"),
              AllOf(HasSubstr("-m venv " + (home_ / "build/search-python").string() + "\n"),
                    HasSubstr(" optuna==1\n")));
  EXPECT_EQ(run_with_tools({"sweep", tpe}).err, "");
  EXPECT_EQ(take_asked_for("python"), "") << "once";
}

TEST_F(SmallProjectWithTools, InstallsWhatTheSiteNeedsForTheSite) {
  write("deploy/requirements_docs.txt", "mkdocs-material==1\n");
  EXPECT_EQ(run_with_tools({"docs", "--help"}).exit_code, 0);
  EXPECT_EQ(run_with_tools({"docs", "--serve"}, {{"COMRAD_DOCS_PYTHON", "/my/python"}}).exit_code, 0);
  EXPECT_EQ(take_asked_for("python"), "");
  EXPECT_EQ(run_with_tools({"docs", "--serve"}).exit_code, 0);
  EXPECT_THAT(take_asked_for("python"),
              AllOf(HasSubstr("-m venv " + (home_ / "build/docs-python").string() + "\n"),
                    HasSubstr(" mkdocs-material==1\n")));
  EXPECT_EQ(run_with_tools({"docs", "--serve"}).err, "");
  EXPECT_EQ(take_asked_for("python"), "") << "once";
}

TEST_F(SmallProjectWithTools, InstallsWhatPlotsNeedForPlotsAndTests) {
  write("deploy/packages_report.txt", "clang\n");
  EXPECT_EQ(run_with_tools({"plot", "--help"}).exit_code, 0);
  EXPECT_EQ(take_asked_for("apt"), "") << "help installs nothing";
  write("full", "no network");
  const Ending without = run_with_tools({"plot", "RUN"});
  EXPECT_EQ(without.exit_code, 0) << "the program names what it misses: " << without.err;
  EXPECT_THAT(without.err, HasSubstr("apt-get install --no-install-recommends clang"));
  fs::remove(home_ / "full");
  take_asked_for("apt");
  EXPECT_THAT(run_with_tools({"plot", "RUN"}).err, HasSubstr("deploy/packages_report.txt: clang"));
  EXPECT_EQ(take_asked_for("apt"), "update -q\n" + kInstall + "clang\n");
  EXPECT_EQ(run_with_tools({"plot", "RUN"}).err, "");
  EXPECT_EQ(take_asked_for("apt"), "") << "once";
  EXPECT_EQ(run_with_tools({"train"}).err, "");
  EXPECT_EQ(take_asked_for("apt"), "") << "nothing else needs it";
  run_with_tools({"test"});
  EXPECT_THAT(take_asked_for("apt"), HasSubstr(kInstall + "clang\n"));
}

TEST_F(SmallProjectWithTools, ContinuesWhereTheTestsNeedWhatIsNotAvailable) {
  write("deploy/packages_test.txt", "clang\n");
  write("deploy/requirements_test.txt", "numpy==1\ntorch==2\n");
  write("full", "no network");
  write("offline", "torch==2\n");
  const Ending ending = run_with_tools({"test"});
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_EQ(ending.out, "none\n") << "the tests look for what is there themselves";
  EXPECT_THAT(ending.err, AllOf(HasSubstr("apt-get install --no-install-recommends clang"),
                                HasSubstr("pip could not install torch==2 ("), HasSubstr("are skipped")));
  fs::remove(home_ / "full");
  fs::remove(home_ / "offline");
  take_asked_for("apt");
  EXPECT_THAT(run_with_tools({"test"}).err, HasSubstr("installing 2 Python packages")) << "it tries again";
  EXPECT_THAT(take_asked_for("apt"), HasSubstr(kInstall + "clang"));
}

TEST_F(SmallProjectWithTools, InstallsNothingForTheTestsWithNoInstall) {
  write("deploy/packages_test.txt", "clang\n");
  write("deploy/requirements_test.txt", "numpy==1\n");
  const Ending ending = run_with_tools({"test"}, {{"COMRAD_NO_INSTALL", "1"}});
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
  EXPECT_EQ(ending.out, "none\n");
  EXPECT_THAT(ending.err, Not(HasSubstr("installing")));
  EXPECT_EQ(take_asked_for("apt"), "");
  EXPECT_THAT(take_asked_for("python"), Not(HasSubstr("pip")));
}

/// Which libtorch it builds with, on a host that seems to have an NVIDIA driver.
class SmallProjectWithDriver : public SmallProjectWithTools {
 protected:
  void SetUp() override {
    SmallProjectWithTools::SetUp();
    write("deploy/packages.txt", "cmake\nlibtorch-dev\n");
    write("deploy/packages_torch.txt", "clang\n");
    write("deploy/torch.txt",
          "# newest first\ntorch==9.1 more-x 580 13.0 30 50\ntorch==8.0 - 525 12.8 20 40\n");
    driver("580.65.06");
  }
  void driver(const std::string& version) {
    write("driver", "NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  " + version +
                        "  Release Build  (root@host)\nGCC version:  gcc 12.2.0\n");
  }
  /// CMake's last argument: a folder with a PyTorch; empty: Debian's.
  std::string cmake_argument() const { return read_text(home_ / "build/torch.argument"); }
  const std::string folder_ = home_ / "build/torch";
};

TEST_F(SmallProjectWithDriver, GetsTheCudaPyTorchOnceAndReportsBeforehandHowLargeItIs) {
  const Ending first = run_with_tools({"version"});
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_EQ(cmake_argument(), folder_);
  const std::string size =
      "torch==9.1 with CUDA 13.0 from PyPI in " + folder_ + ": about 30 MB to download, 50 MB on the disk";
  EXPECT_THAT(first.err,
              AllOf(HasSubstr(size), HasSubstr("PyTorch installed"), HasSubstr("that PyTorch has no CUDA")))
      << "the tool that plays pip installs none";
  EXPECT_LT(first.err.find(size), first.err.find("PyTorch installed"));
  EXPECT_EQ(take_asked_for("apt"), "update -q\n" + kInstall + "clang\n") << "no libtorch-dev";
  EXPECT_THAT(take_asked_for("python"),
              AllOf(HasSubstr("-m venv " + folder_ + "\n"), HasSubstr(" torch==9.1 more-x\n"),
                    Not(HasSubstr("--no-index"))));
  const Ending again = run_with_tools({"version"});
  EXPECT_EQ(again.exit_code, 0);
  EXPECT_EQ(again.err, "");
  write("deploy/main.c", "int main(void) { return 0; }\n");
  EXPECT_THAT(run_with_tools({"version"}).err, AllOf(HasSubstr("built in"), Not(HasSubstr("PyPI"))));
  EXPECT_EQ(take_asked_for("python"), "") << "a build that follows finds it there";
}

TEST_F(SmallProjectWithDriver, ChoosesByDriverAndByCOMRAD_TORCH) {
  const auto chosen = [&](const std::string& word) {
    const Ending ending = run_with_tools({"version"}, {{"COMRAD_TORCH", word}});
    EXPECT_EQ(ending.exit_code, 0) << ending.err;
    return ending.err;
  };
  driver("570.133.20");
  EXPECT_THAT(chosen("auto"), HasSubstr("torch==8.0 with CUDA 12.8"));
  EXPECT_EQ(cmake_argument(), folder_);
  driver("470.256.02");
  EXPECT_THAT(chosen("auto"),
              AllOf(HasSubstr("torch==8.0 requires an NVIDIA driver of version 525, this one has 470.256.02"),
                    HasSubstr("COMRAD_TORCH=FOLDER")));
  EXPECT_EQ(cmake_argument(), "");
  driver("580.65.06");
  chosen("debian");
  EXPECT_EQ(cmake_argument(), "");
  EXPECT_THAT(take_asked_for("apt"), HasSubstr("libtorch-dev"));
  fs::remove(home_ / "driver");
  EXPECT_THAT(chosen("pip"), HasSubstr("torch==9.1 with CUDA 13.0"))
      << "requested by name it needs no driver";
  EXPECT_EQ(cmake_argument(), folder_);
  EXPECT_THAT(chosen("auto"), HasSubstr("building programs"));
  EXPECT_EQ(cmake_argument(), "") << "no driver";
  write("driver", "no version at all\n");
  EXPECT_EQ(chosen("auto"), "");
}

TEST_F(SmallProjectWithDriver, OfflineHostsNameAFolder) {
  fs::create_directories(home_ / "carried");
  write("carried/torch-7.5.0+cu128-cp311-cp311-linux_x86_64.whl", "");
  write("carried/nvidia_cuda_crt-13.0.88-py3-none-linux_x86_64.whl", "");
  write("carried/nvidia_cuda_cccl-13.0.85-py3-none-linux_x86_64.whl", "");
  const Ending wheels = run_with_tools({"version"}, {{"COMRAD_TORCH", (home_ / "carried").string()}});
  EXPECT_EQ(wheels.exit_code, 0) << wheels.err;
  EXPECT_EQ(cmake_argument(), folder_);
  EXPECT_THAT(take_asked_for("python"),
              HasSubstr("--no-index --find-links " + (home_ / "carried").string() +
                        " --quiet torch==7.5.0+cu128 nvidia-cuda-crt nvidia-cuda-cccl\n"));
  fs::create_directories(home_ / "mine/lib");
  EXPECT_EQ(run_with_tools({"version"}, {{"COMRAD_TORCH", (home_ / "mine").string()}}).exit_code, 0);
  EXPECT_EQ(cmake_argument(), (home_ / "mine").string()) << "one that is installed is CMake's to look into";
  EXPECT_EQ(take_asked_for("python"), "");
}

TEST_F(SmallProjectWithDriver, RefusesOtherWordsAndFoldersThatAreNotThere) {
  for (const char* word : {"cuda", "torch==2.0", "Pip"}) {
    const Ending refused = run_with_tools({"version"}, {{"COMRAD_TORCH", word}});
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.err, HasSubstr("COMRAD_TORCH=" + std::string(word) +
                                       ": it may be auto, debian, pip, or a folder"));
  }
  const Ending missing = run_with_tools({"version"}, {{"COMRAD_TORCH", "/no/such/folder"}});
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_THAT(missing.err, HasSubstr("there is no folder /no/such/folder"));
  EXPECT_FALSE(fs::exists(home_ / "build"));
}

TEST_F(SmallProjectWithDriver, ReportsWhatToDoWhereThePyTorchIsNotAvailable) {
  write("offline", "more-x\n");
  const Ending offline = run_with_tools({"version"});
  EXPECT_EQ(offline.exit_code, 1);
  EXPECT_THAT(offline.err, AllOf(HasSubstr("pip could not install torch==9.1 more-x from PyPI"),
                                 HasSubstr("COMRAD_TORCH=FOLDER"), HasSubstr("COMRAD_TORCH=debian")));
  EXPECT_FALSE(fs::exists(folder_)) << "half an environment is no use";
  fs::remove(home_ / "offline");
  tool("df", "echo Avail; echo 79M");
  EXPECT_THAT(run_with_tools({"version"}).err,
              HasSubstr("has 79 MB free; the PyTorch and its download take 80"));
  EXPECT_FALSE(fs::exists(folder_));
  fs::remove(home_ / "bin/df");

  take_asked_for("python");
  write("deploy/packages.txt", "cmake\n");
  const Ending told = run_with_tools({"version"}, {{"COMRAD_NO_INSTALL", "1"}});
  EXPECT_EQ(told.exit_code, 0) << told.err;
  EXPECT_THAT(told.err, HasSubstr("COMRAD_NO_INSTALL is set: networks will run on the CPU"));
  EXPECT_EQ(cmake_argument(), "");
  const Ending asked = run_with_tools({"version"}, {{"COMRAD_NO_INSTALL", "1"}, {"COMRAD_TORCH", "pip"}});
  EXPECT_EQ(asked.exit_code, 1);
  EXPECT_THAT(asked.err, AllOf(HasSubstr("COMRAD_NO_INSTALL is set"), HasSubstr("COMRAD_TORCH=FOLDER")));
  EXPECT_EQ(take_asked_for("python"), "");
}

TEST_F(SmallProject, OneBesideABuildUsesTheProgramsThatAreThere) {
  ASSERT_EQ(run({"version"}).exit_code, 0);
  write("deploy/main.c", "int main(void) { return 7; }\n");
  const std::string lock = home_ / "build/.comrad-lock";
  RunningProgram builder({"/usr/bin/flock", "--no-fork", lock, "/bin/sleep", "1000"});
  ASSERT_TRUE(wait_until([&] {
    return RunningProgram({"/usr/bin/flock", "-n", lock, "/bin/true"}).wait().exit_code != 0;
  }));
  const Ending beside = run({"version"});
  EXPECT_EQ(beside.exit_code, 0) << "the old program";
  EXPECT_EQ(beside.out, "[version]");
  EXPECT_THAT(beside.err, HasSubstr("another ./comrad is building"));
  builder.signal(SIGTERM);
  builder.wait();
  EXPECT_EQ(run({"version"}).exit_code, 7);
}

TEST_F(SmallProject, TwoAtOnceWaitForEachOther) {
  const std::vector<std::string> command = {"/bin/bash", home_ / "comrad", "version"};
  const Environment environment = {{"COMRAD_NO_INSTALL", "1"},
                                   {"COMRAD_BUILD_DIR", home_ / "build"},
                                   {"COMRAD_TORCH", "debian"},
                                   {"CI", ""}};
  RunningProgram one(command, environment), two(command, environment);
  const Ending first = one.wait(), second = two.wait();
  EXPECT_EQ(first.out, "[version]") << first.err;
  EXPECT_EQ(second.out, "[version]") << second.err;
  const auto builds = [](const Ending& ending) { return ending.err.find("built in") != std::string::npos; };
  EXPECT_NE(builds(first), builds(second)) << first.err << second.err;
}

}  // namespace bootstrap_test
}  // namespace comrad::test
