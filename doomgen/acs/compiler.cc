#include "doomgen/acs/compiler.h"

#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "doomgen/acs/code_generator.h"
#include "doomgen/acs/object_writer.h"
#include "doomgen/acs/parser.h"
#include "doomgen/acs/source_loader.h"

namespace comrad::acs_compiler {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kFileBytesMax = 8u << 20;

/// Whether `path` lies in `folder` or below, links followed.
bool lies_below(const fs::path& path, const fs::path& folder) {
  std::error_code failed;
  const fs::path inside = fs::weakly_canonical(path, failed);
  if (failed) return false;
  const fs::path outside = fs::weakly_canonical(folder, failed);
  if (failed) return false;
  auto part = inside.begin();
  for (const fs::path& wanted : outside) {
    if (wanted.empty()) continue;  // behind a last slash
    if (part == inside.end() || *part != wanted) return false;
    ++part;
  }
  return true;
}

Expected<std::string> read_text(const fs::path& path) {
  std::error_code failed;
  if (!fs::is_regular_file(path, failed))
    return Error{ErrorCode::kNotFound, path.string() + ": there is no such file"};
  const std::uintmax_t size = fs::file_size(path, failed);
  if (failed || size > kFileBytesMax)
    return Error{ErrorCode::kBadInput, path.string() + ": larger than 8 MiB; a script is text"};
  std::ifstream file(path, std::ios::binary);
  std::string text(static_cast<std::size_t>(size), '\0');
  if (!file.read(text.data(), static_cast<std::streamsize>(size)))
    return Error{ErrorCode::kSystem, path.string() + ": cannot be read"};
  return text;
}

}  // namespace

Expected<CompiledScript> compile(std::string_view source, const std::string& path,
                                 const CompileOptions& options) {
  Diagnostics diagnostics(options.errors_max);
  std::deque<std::string> texts;
  Program program;
  SourceTokens tokens = load_source(source, path, options, program.pool, texts, diagnostics);
  program.encrypts_texts = tokens.encrypts_texts;
  if (!diagnostics.full()) parse(tokens.tokens, program, diagnostics);
  // Names are looked up even where the syntax was wrong somewhere: one run shows both kinds of errors.
  Object object;
  if (!diagnostics.full()) object = generate(program, diagnostics);
  if (diagnostics.failed()) return diagnostics.to_error();
  return CompiledScript{write_object(object), diagnostics.take_warnings()};
}

SourceReader file_reader(const std::string& root, std::vector<std::string> folders) {
  folders.insert(folders.begin(), root.empty() ? "." : root);
  return [folders = std::move(folders)](const std::string& name,
                                        const std::string& from) -> Expected<SourceFile> {
    const fs::path wanted(name);
    if (name.empty() || wanted.is_absolute() || name.find('\\') != std::string::npos)
      return Error{ErrorCode::kBadInput,
                   acs_compiler::in_quotes(name) + " is no name below the source's folder"};
    std::vector<fs::path> places = {fs::path(from).parent_path() / wanted};
    for (const std::string& folder : folders) places.push_back(fs::path(folder) / wanted);
    bool led_out = false;
    for (const fs::path& place : places) {
      std::error_code failed;
      if (!fs::exists(place, failed)) continue;
      bool allowed = false;
      for (const std::string& folder : folders) allowed = allowed || lies_below(place, folder);
      if (!allowed) {
        led_out = true;
        continue;
      }
      COMRAD_TRY_ASSIGN(std::string text, read_text(place));
      return SourceFile{place.lexically_normal().string(), std::move(text)};
    }
    if (led_out)
      return Error{ErrorCode::kBadInput, "the file " + acs_compiler::in_quotes(name) +
                                             " lies outside the folders that may be read"};
    return Error{ErrorCode::kNotFound, "the file " + acs_compiler::in_quotes(name) +
                                           " is not there; expected it beside the source"};
  };
}

Expected<CompiledScript> compile_file(const std::string& path, std::vector<std::string> folders) {
  COMRAD_TRY_ASSIGN(const std::string source, read_text(path));
  CompileOptions options;
  options.reader = file_reader(fs::path(path).parent_path().string(), std::move(folders));
  return compile(source, path, options);
}

}  // namespace comrad::acs_compiler
