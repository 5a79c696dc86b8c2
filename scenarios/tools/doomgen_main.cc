// comrad-doomgen NAME --seed N -o FILE: draws one layout of a scenario and writes it as a WAD.
#include <CLI/CLI.hpp>

#include <cstdio>
#include <string>
#include <vector>

#include "doomgen/layout/wad_writer.h"
#include "scenarios/spec/registry.h"

namespace comrad {
namespace {

int report(const Error& error) {
  std::fprintf(stderr, "comrad-doomgen: %s\n", error.message.c_str());
  return error.code == ErrorCode::kBadInput || error.code == ErrorCode::kNotFound ? 2 : 1;
}

std::string parameter_help() {
  std::string text;
  for (const std::string& name : scenarios::layout_recipes()) {
    text += "Layout parameters of " + name + " (--set name=value):\n";
    const auto parameters = scenarios::layout_parameters(name);
    for (const scenarios::LayoutParameter& p : *parameters)
      text += "  " + std::string(p.name) + " = " + std::to_string(p.default_value) + ": " + p.help + "\n";
  }
  return text;
}

int run(int argc, char** argv) {
  std::string name, path;
  std::vector<std::string> settings;
  scenarios::LayoutRequest request;
  CLI::App app("Draws one layout of a scenario and writes it as a WAD.", "comrad-doomgen");
  app.add_option("name", name, "scenario whose map is drawn")->required();
  app.add_option("--seed", request.seed, "seed of the layout")->capture_default_str();
  app.add_option("-o,--out", path, "file to write")->required();
  app.add_option("--num_agents", request.num_agents, "agents that must find a start; 0: the recipe's number")
      ->check(CLI::Range(0, 8));
  app.add_option("--set", settings, "a layout parameter as name=value; may be repeated");
  app.footer(parameter_help());
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  for (const std::string& setting : settings) {
    const std::size_t equals = setting.find('=');
    if (equals == std::string::npos)
      return report({ErrorCode::kBadInput, "--set " + setting + ": write name=value"});
    request.parameters.emplace_back(setting.substr(0, equals), setting.substr(equals + 1));
  }
  const Expected<scenarios::GeneratedLayout> layout = scenarios::generate_layout(name, request);
  if (!layout) return report(layout.error());
  if (const Status written = doomgen::write_file(path, layout->wad); !written) return report(written.error());
  std::printf("%s: %s, seed %llu, attempt %d, %zu bytes, hash %016llx\n", path.c_str(), name.c_str(),
              static_cast<unsigned long long>(request.seed), layout->info.attempt, layout->wad.size(),
              static_cast<unsigned long long>(layout->content_hash));
  return 0;
}

}  // namespace
}  // namespace comrad

int main(int argc, char** argv) { return comrad::run(argc, argv); }
