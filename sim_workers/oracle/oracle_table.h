// The oracles of this build; the table is written by CMake from the folders that have an oracle.cc.
#pragma once

#include <memory>
#include <span>

#include "sim_workers/oracle/oracle.h"

namespace comrad::sim {

struct OracleEntry {
  const char* scenario;
  Expected<std::unique_ptr<Oracle>> (*make)(const DoomGame& game);
};

std::span<const OracleEntry> oracle_table();

}  // namespace comrad::sim
