#include "scenarios/spec/script_build.h"

#include <spdlog/fmt/fmt.h>

#include "scenarios/spec/scenario_files.h"

#if defined(COMRAD_HAS_ACS_COMPILER)
#include "doomgen/acs/compiler.h"
#endif

namespace comrad::scenarios {

namespace {

std::string declaration(const ScenarioExport& one) {
  return fmt::format("global int {}:{};", one.user, one.name);
}

/// The declarations, each in the line of scenario.toml that requests it.
[[maybe_unused]] std::string at_their_lines(const std::vector<ScenarioExport>& exports) {
  std::string text;
  int line = 1;
  for (const ScenarioExport& one : exports) {
    for (; line < one.line; ++line) text += '\n';
    text += declaration(one);
  }
  return text + "\n";
}

}  // namespace

Expected<BuiltScript> build_script(const ScenarioSpec& spec, const std::string& layout_text,
                                   const std::vector<std::string>& more) {
  const std::string folder = spec.folder, path = folder + "/script.acs";
  std::vector<std::string> files{"script.acs"};
  files.insert(files.end(), more.begin(), more.end());
  BuiltScript built;
  // Behind the empty line that ends the layout's numbers: exports are the same in all of a scenario's maps.
  built.source = layout_text + "\n";
  for (const ScenarioExport& one : spec.exports)
    built.source += declaration(one) + (one.meaning.empty() ? "" : "  // " + one.meaning) + "\n";
  std::string main = "#include \"layout.acs\"\n#include \"exports.acs\"\n";
  for (const std::string& file : files) {
    COMRAD_TRY_ASSIGN(const std::string text, read_scenario_file(folder + "/" + file));
    built.source += text;
    main += "#include \"" + file + "\"\n";
  }
#if defined(COMRAD_HAS_ACS_COMPILER)
  // Included files rather than one long text, so that messages name the line an author sees.
  const acs_compiler::SourceReader reader = acs_compiler::file_reader(folder);
  acs_compiler::CompileOptions options;
  options.reader = [&](const std::string& name,
                       const std::string& from) -> Expected<acs_compiler::SourceFile> {
    if (name == "layout.acs") return acs_compiler::SourceFile{folder + "/layout.acs", layout_text};
    if (name == "exports.acs")
      return acs_compiler::SourceFile{folder + "/scenario.toml", at_their_lines(spec.exports)};
    return reader(name, from == folder + "/main" ? path : from);
  };
  COMRAD_TRY_ASSIGN(acs_compiler::CompiledScript compiled,
                    acs_compiler::compile(main, folder + "/main", options));
  built.behavior.assign(compiled.behavior.begin(), compiled.behavior.end());
  built.warnings = std::move(compiled.warnings);
#else
  built.warnings.push_back(path + ": this build has no ACS compiler; the map has no BEHAVIOR");
#endif
  return built;
}

}  // namespace comrad::scenarios
