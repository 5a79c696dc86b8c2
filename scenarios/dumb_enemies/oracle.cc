// The scripted hunters of Dumb Enemies: those of Smart Enemies, all after the same demon.
#include "sim_workers/oracle/oracle.h"

namespace comrad::sim {

std::unique_ptr<Oracle> make_hunters(const DoomGame& game,
                                     bool together);  // scenarios/smart_enemies/oracle.cc

Expected<std::unique_ptr<Oracle>> make_dumb_enemies_oracle(const DoomGame& game) {
  return make_hunters(game, true);
}

}  // namespace comrad::sim
