// Files written and read whole. Stage: loading and reports.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// What the system's last call failed with: `what` and errno's reason. kSystem.
Error system_error(const std::string& what);

/// What went wrong with a file or program, in the system's words: `what` and the reason of errno `code`. kNoSpace with
/// what to do where the disk is full, kNotFound where nothing lies there, else kSystem.
Error file_error(const std::string& what, int code);

/// The bytes of a file; nothing where it cannot be read or is empty, for an empty file is of no use to
/// callers. The caller reports what was expected.
std::optional<std::string> read_file(const std::string& path);

/// The bytes of a file that a user names and that should be short (settings): a plain file or a pipe, never more
/// than `max_bytes` of it. Errors: as file_error; kBadFormat where it is longer or a folder or device.
Expected<std::string> read_short_file(const std::string& path, std::size_t max_bytes);

/// Writes all bytes to an open file, whatever part of them one call takes; `path` names it in errors.
/// Errors: as file_error.
Status write_all(int descriptor, std::string_view bytes, const std::string& path);

/// How the name of a half-written file begins; what a process that died left may be deleted.
constexpr std::string_view kHalfWrittenMark = ".tmp-";

/// Writes a file beside its place (`.tmp-<pid>-<name>`) and renames it, so that no reader sees half of it;
/// what lay there before is untouched by a failure. Durable: on the disk when this returns, not only in its
/// cache. Errors: as file_error.
Status write_file_atomically(const std::string& path, std::string_view bytes, bool durable);

/// Paths in a folder whose names have this extension (".wad"), sorted. Errors: as file_error.
Expected<std::vector<std::string>> files_with_extension(const std::string& folder,
                                                        std::string_view extension);

/// The folder that holds scenarios/ and the other data files: $COMRAD_HOME, else <prefix>/share/comrad where this
/// program is <prefix>/libexec/comrad/<name> (it was installed), else the source folder of the build.
std::string data_dir();

}  // namespace comrad
