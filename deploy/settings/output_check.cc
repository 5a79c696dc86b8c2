#include "deploy/settings/output_check.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {

namespace fs = std::filesystem;

Error bad_value(const std::string& flag, const std::string& value, const std::string& what) {
  return Error{ErrorCode::kBadInput, "--" + flag + "=" + value + ": " + what};
}

Status check_output_folder(const std::string& flag, const std::string& value, const std::string& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error))
    return bad_value(flag, value, folder + " is no folder; make it first");
  if (access(folder.c_str(), W_OK | X_OK) != 0)
    return bad_value(flag, value, folder + " cannot be written to; choose another place");
  return {};
}

Expected<std::string> check_new_folder(const std::string& flag, const std::string& value,
                                       const std::string& why_not) {
  std::error_code error;
  fs::path path = fs::absolute(value, error).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  const bool is_there = fs::exists(path, error);
  COMRAD_TRY(check_output_folder(flag, value, (is_there ? path : path.parent_path()).string()));
  if (is_there && !fs::is_empty(path, error))
    return bad_value(flag, value, "the folder holds files already" + why_not);
  return path.string();
}

Expected<std::string> check_output_file(const std::string& flag, const std::string& value,
                                        const std::vector<std::string>& extensions) {
  std::error_code error;
  const fs::path path = fs::absolute(value, error).lexically_normal();
  const std::string name = lower_case(path.filename().string());
  if (std::ranges::none_of(extensions, [&](const std::string& end) { return name.ends_with(end); }))
    return bad_value(flag, value, "the name must end in one of " + joined(extensions));
  if (fs::is_directory(path, error)) return bad_value(flag, value, "a folder of that name is there");
  COMRAD_TRY(check_output_folder(flag, value, path.parent_path().string()));
  return path.string();
}

}  // namespace comrad::deploy
