// comrad-scenarios [list] | describe NAME | --gallery DIR: what scenarios there are, what each one means and what its agents
// see, for people and programs.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "rollout_buffer/core/config_file_name.h"
#include "rollout_buffer/core/process.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"
#include "scenarios/tools/description.h"
#include "scenarios/tools/gallery_flags.h"

namespace comrad {
namespace {

using Json = nlohmann::ordered_json;

int report(const Error& error) {
  std::fprintf(stderr, "comrad-scenarios: error: %s\n", error.message.c_str());
  return error.code == ErrorCode::kSystem ? 1 : 2;
}

int list(bool as_json) {
  Json all = Json::array();
  for (const std::string& name : scenarios::list_scenarios()) {
    const Expected<Json> one = scenarios::describe(name, 0);
    if (!one) return report(one.error());
    all.push_back(*one);
  }
  if (as_json) {
    std::printf("%s\n", Json{{"scenarios", all}}.dump().c_str());
    return 0;
  }
  for (const Json& one : all)
    std::printf("%-24s version %d, difficulty %d, %d agents, %s\n", one["name"].get<std::string>().c_str(),
                one["version"].get<int>(), one["difficulty"].get<int>(), one["num_agents"].get<int>(),
                one["summary"].get<std::string>().c_str());
  return 0;
}

/// comrad-trace, which has the engine, draws; it reads the same flags again.
int draw_gallery(char** argv) {
  std::error_code failure;
  const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe", failure);
  const std::string program = (own.parent_path() / "comrad-trace").string();
  execv(program.c_str(), argv);
  return report({ErrorCode::kSystem, program + " cannot be started; build it with ./comrad"});
}

int run(int argc, char** argv) {
  bool as_json = false;
  int num_agents = 0;
  std::string name, heads;
  scenarios::GalleryFlags gallery;
  CLI::App app("Lists, describes or draws the scenarios; without a word it lists them.", "comrad scenarios");
  CLI::App* list_command = app.add_subcommand("list", "every scenario, one line each");
  CLI::App* describe_command = app.add_subcommand(
      "describe",
      "all about one: heads, rewards, masks, measurements, exported variables, layout parameters");
  describe_command->add_option("name", name, "scenario: a name, or the path of a folder or a ViZDoom .cfg")
      ->required();
  describe_command->add_option("--num_agents", num_agents, "agents; 0: the scenario's default")
      ->check(CLI::Range(0, kMaxAgents));
  describe_command->add_option("--heads", heads,
                               "action heads in place of the scenario's, as MOVE_LEFT,MOVE_RIGHT;ATTACK");
  for (CLI::App* one : {&app, list_command, describe_command})
    one->add_flag("--json", as_json, "one JSON object on one line");
  app.require_subcommand(0, 1);
  app.footer(
      "--pages DIR [NAME...]: write the pages of the games with pictures and GIFs of the scripted team into "
      "DIR");
  const CLI::Option* gallery_option = scenarios::add_gallery_flags(app, gallery);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (gallery_option->count() > 0) return draw_gallery(argv);
  if (!gallery.scenarios.empty())
    return report(
        {ErrorCode::kBadInput, "'" + gallery.scenarios[0] +
                                   "' is neither list nor describe nor --gallery; did you mean `comrad " +
                                   "scenarios describe " + gallery.scenarios[0] + "`?"});
  if (!*describe_command) return list(as_json);
  // A name that no scenario has may be a folder's; "folder" lets programs continue elsewhere.
  std::string folder;
  if (const std::string here = "./" + name; !names_vizdoom_config(name) &&
                                            !scenarios::find_scenario_folder(name) &&
                                            scenarios::find_scenario_folder(here))
    name = here, folder = std::filesystem::absolute(here).lexically_normal().string();
  Expected<Json> description = scenarios::describe(name, num_agents, heads);
  if (!description) return report(description.error());
  (*description)["folder"] = folder;
  std::fputs(
      as_json ? (description->dump() + "\n").c_str() : scenarios::description_text(*description).c_str(),
      stdout);
  return 0;
}

}  // namespace
}  // namespace comrad

int main(int argc, char** argv) {
  comrad::prepare_process();
  return comrad::run(argc, argv);
}
