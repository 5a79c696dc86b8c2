#include "doomgen/wad/iwad_search.h"

#include <cstdlib>
#include <filesystem>

#include "rollout_buffer/core/text.h"

namespace comrad::wad {
namespace {

constexpr const char* kIwadPlaces[] = {
    "/usr/share/games/doom/freedoom2.wad", "/usr/local/share/games/doom/freedoom2.wad",
    "/usr/share/doom/freedoom2.wad", "/usr/local/share/doom/freedoom2.wad"};

}  // namespace

Expected<std::string> find_iwad(const std::string& path) {
  std::string wanted = path;
  if (const char* const named = std::getenv("COMRAD_IWAD"); wanted.empty() && named != nullptr)
    wanted = named;
  std::error_code ignored;
  if (!wanted.empty()) {
    if (std::filesystem::exists(wanted, ignored)) return wanted;
  } else {
    for (const char* const place : kIwadPlaces)
      if (std::filesystem::exists(place, ignored)) return std::string(place);
  }
  return Error{ErrorCode::kNotFound,
               "no freedoom2.wad found in " + (wanted.empty() ? joined(kIwadPlaces) : wanted) +
                   ": install the Debian package freedoom or set COMRAD_IWAD (for Python: "
                   "pip install comrad-freedoom)"};
}

}  // namespace comrad::wad
