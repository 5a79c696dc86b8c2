#include "scenarios/spec/script_build.h"

#include "scenarios/spec/scenario_files.h"

#if defined(COMRAD_HAS_ACS_COMPILER)
#include "doomgen/acs/compiler.h"
#endif

namespace comrad::scenarios {

Expected<BuiltScript> build_script(const std::string& folder, const std::string& layout_text) {
  const std::string path = folder + "/script.acs";
  COMRAD_TRY_ASSIGN(const std::string text, read_scenario_file(path));
  BuiltScript built;
  built.source = layout_text + "\n" + text;
#if defined(COMRAD_HAS_ACS_COMPILER)
  // Two included files rather than one long text, so that messages name the line an author sees.
  const acs_compiler::SourceReader files = acs_compiler::file_reader(folder);
  acs_compiler::CompileOptions options;
  options.reader = [&](const std::string& name,
                       const std::string& from) -> Expected<acs_compiler::SourceFile> {
    if (name == "layout.acs") return acs_compiler::SourceFile{folder + "/layout.acs", layout_text};
    return files(name, from == folder + "/main" ? path : from);
  };
  COMRAD_TRY_ASSIGN(
      acs_compiler::CompiledScript compiled,
      acs_compiler::compile("#include \"layout.acs\"\n#include \"script.acs\"\n", folder + "/main", options));
  built.behavior.assign(compiled.behavior.begin(), compiled.behavior.end());
  built.warnings = std::move(compiled.warnings);
#else
  built.warnings.push_back(path + ": this build has no ACS compiler; the map has no BEHAVIOR");
#endif
  return built;
}

}  // namespace comrad::scenarios
