// comrad-acs FILE.acs -o FILE.o: compiles one script and writes it as a BEHAVIOR lump.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "doomgen/acs/compiler.h"
#include "rollout_buffer/core/process.h"

int main(int argc, char** argv) {
  comrad::prepare_process();
  CLI::App app("Compiles an ACS source into a BEHAVIOR lump.", "comrad-acs");
  std::string source, output;
  std::vector<std::string> folders;
  app.add_option("source", source, "the script")->required();
  app.add_option("-o,--output", output, "where the lump goes (default: the source's name with .o)");
  app.add_option("-i,--include", folders, "folders where #include and #import look behind the source's own");
  CLI11_PARSE(app, argc, argv);

  if (output.empty()) {
    const std::size_t dot = source.rfind('.');
    output = (dot == std::string::npos ? source : source.substr(0, dot)) + ".o";
  }
  if (output == source) {
    std::fprintf(stderr, "comrad-acs: error: the lump would overwrite %s; give another name with -o\n",
                 source.c_str());
    return 1;
  }
  const auto script = comrad::acs_compiler::compile_file(source, folders);
  if (!script) {
    std::fprintf(stderr, "%s\n", script.error().message.c_str());
    return 1;
  }
  for (const std::string& warning : script->warnings) std::fprintf(stderr, "%s (warning)\n", warning.c_str());
  std::ofstream file(output, std::ios::binary | std::ios::trunc);
  file.write(reinterpret_cast<const char*>(script->behavior.data()),
             static_cast<std::streamsize>(script->behavior.size()));
  file.close();
  if (!file) {
    std::fprintf(stderr, "comrad-acs: error: %s cannot be written\n", output.c_str());
    return 1;
  }
  return 0;
}
