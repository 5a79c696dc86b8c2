// Turns ACS source, the script language of Hexen as ZDoom extended it, into a BEHAVIOR lump that our engine
// and ZDoom 2.8 run. Stage: before the flow begins, when a scenario's map is made.
//
//   source --lexer--> tokens --source_loader (#include, #import)--> parser --> syntax tree
//          --code_generator--> object --object_writer--> BEHAVIOR
//
// The same source gives the same bytes on every machine. Nothing in a source can make the compiler read a
// file except through the caller's reader.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::acs_compiler {

/// What #include or #import brought: the text, and the path that messages and further includes name.
struct SourceFile {
  std::string path;
  std::string text;
};

/// Finds the file that #include or #import names. `name` is as written; `from` is the path of the file that
/// includes it. Errors: those of the reader; the compiler puts file, line and column in front.
using SourceReader = std::function<Expected<SourceFile>(const std::string& name, const std::string& from)>;

struct CompileOptions {
  SourceReader reader;          ///< empty: #include and #import of anything but the built-in names fail
  std::size_t errors_max = 20;  ///< after so many errors the compiler gives up
  std::size_t source_bytes_max = 8u << 20;  ///< of all files together
};

struct CompiledScript {
  std::vector<uint8_t> behavior;      ///< the lump
  std::vector<std::string> warnings;  ///< file:line:column: text
};

/// Compiles one source.
///
///   source   text; `path` names it in messages and is handed to the reader as `from`
///
/// Errors: kBadFormat, one line for each error found: `file:line:column: what was found; expected what`.
/// Threads: any; no shared state.
/// Source: zdoom.org wiki, "ACS" and "ACS object file formats"; doomgen/ACS.md lists what differs.
Expected<CompiledScript> compile(std::string_view source, const std::string& path,
                                 const CompileOptions& options = {});

/// A reader for files on disk: beside the including file first, then in `folders` in order. Absolute names,
/// and names that lead out of all of these folders through `..` or links, are refused.
///
///   root   folder of the main source; files below it and below `folders` may be read, nothing else
SourceReader file_reader(const std::string& root, std::vector<std::string> folders = {});

/// Reads and compiles a file with a file_reader of its folder and `folders`.
/// Errors: as compile(), and kNotFound, kSystem where a file cannot be read.
Expected<CompiledScript> compile_file(const std::string& path, std::vector<std::string> folders = {});

}  // namespace comrad::acs_compiler
