// Which recorded pictures belong to the installed IWAD: releases of Freedoom differ in their art.
#pragma once

#include <string>

#include "sim_workers/engine/render/art_archive.h"

namespace comrad::doom::test {

/// "freedoom_0.13.0/", the folder below tests/golden/render (and its vizdoom) for this art, by Freedoom's own lump.
inline std::string folder_of_art(const ArtArchive& art) {
  const std::span<const uint8_t> bytes = art.bytes("FREEDOOM");
  const std::string version(bytes.begin(), bytes.end());
  return "freedoom_" + version.substr(0, version.find_first_of("-\n")) + "/";
}

}  // namespace comrad::doom::test
