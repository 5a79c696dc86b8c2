// Places that maps and scripts name: starts, spots, cameras and whatever else nobody sees. Types that this
// engine gives no life are here so that maps with them load in silence.
#include <spdlog/fmt/fmt.h>

#include <string>
#include <utility>

#include "sim_workers/engine/actors/builtin_tables.h"

namespace comrad::doom {
namespace {

using enum ActorFlag;

struct Marker {
  const char* name;
  int32_t first, last;  ///< editor numbers; those after the first get them into their names
};

void add_marker(ActorCatalog* catalog, std::string name, int32_t number, int32_t spawn_id = 0) {
  ActorType type = start_type(*catalog, "Actor", name, number, spawn_id);
  type.render_style = RenderStyle::kNone;
  set_flags(&type, {kNoGravity, kNoBlockmap, kNoSector, kDontSplash});
  add_type(catalog, std::move(type), "Spawn: gone");
}

}  // namespace

void add_markers(ActorCatalog* catalog) {
  for (int32_t player = 1; player <= 8; ++player)
    add_marker(catalog, fmt::format("Player{}Start", player), player <= 4 ? player : 3996 + player);
  const Marker markers[] = {
      {"DeathmatchStart", 11, 11},
      {"TeleportDest", 14, 14},
      {"MapSpot", 9001, 9001},
      {"PatrolPoint", 9024, 9024},
      {"PatrolSpecial", 9047, 9047},
      {"SecurityCamera", 9025, 9025},
      {"Spark", 9026, 9026},
      {"RedParticleFountain", 9027, 9027},
      {"GreenParticleFountain", 9028, 9028},
      {"BlueParticleFountain", 9029, 9029},
      {"YellowParticleFountain", 9030, 9030},
      {"PurpleParticleFountain", 9031, 9031},
      {"BlackParticleFountain", 9032, 9032},
      {"WhiteParticleFountain", 9033, 9033},
      {"FS_Mapspot", 5004, 5004},
      {"SectorFlagSetter", 9041, 9041},
      {"MapMarker", 9040, 9040},
      {"UpperStackLookOnly", 9077, 9077},
      {"LowerStackLookOnly", 9078, 9078},
      {"SkyViewpoint", 9080, 9080},
      {"SkyPicker", 9081, 9081},
      {"SectorSilencer", 9082, 9082},
      {"SkyCamCompat", 9083, 9083},
      {"SecretTrigger", 9046, 9046},
      {"WaterZone", 9045, 9045},
      {"InterpolationPoint", 9070, 9070},
      {"PathFollower", 9071, 9071},
      {"MovingCamera", 9072, 9072},
      {"AimingCamera", 9073, 9073},
      {"ActorMover", 9074, 9074},
      {"InterpolationSpecial", 9075, 9075},
      {"Decal", 9200, 9200},
      {"PolyObjectAnchor", 9300, 9300},
      {"PolyObjectSpawn", 9301, 9303},
      {"VertexHeight", 1504, 1505},
      {"LineSlope", 9500, 9503},
      {"SlopeCopy", 9510, 9511},
      {"SecActEyesBelowC", 9983, 9983},
      {"SecActEyesAboveC", 9982, 9982},
      {"SecActHitFakeFloor", 9989, 9989},
      {"SecActEyesSurface", 9992, 9992},
      {"SecActEyesDive", 9993, 9993},
      {"SecActUseWall", 9994, 9994},
      {"SecActUse", 9995, 9995},
      {"SecActHitCeil", 9996, 9996},
      {"SecActExit", 9997, 9997},
      {"SecActEnter", 9998, 9998},
      {"SecActHitFloor", 9999, 9999},
      {"SoundSequence", 1400, 1411},
      {"SoundEnvironment", 9048, 9048},
      {"AmbientSound", 14001, 14065},
      {"VavoomLight", 1502, 1503},
      {"DoomBuilderCamera", 32000, 32000},
  };
  for (const Marker& row : markers)
    for (int32_t number = row.first; number <= row.last; ++number)
      add_marker(catalog, row.name + (number == row.first ? std::string() : std::to_string(number)), number);

  ActorType spot = start_type(*catalog, "MapSpot", "MapSpotGravity", 9013);
  set_flags(&spot, {kNoGravity, kNoBlockmap, kNoSector}, false);
  add_type(catalog, std::move(spot), "");

  for (const char* name : {"PatrolPoint", "PatrolSpecial"}) {
    ActorType& patrol = catalog->edit(type_index(*catalog, name));
    patrol.radius = patrol.height = to_fixed(8), patrol.mass = 10;
    patrol.flags.set(kNoSector, false);
  }

  struct Bridge {
    const char* name;
    int32_t number, spawn_id;
    int radius, height;
    ActorType::Bridge kind = ActorType::Bridge::kOfItsType;
  };
  const Bridge bridges[] = {{"InvisibleBridge", 9990, 0, 32, 4},
                            {"CustomBridge", 9991, 0, 32, 4, ActorType::Bridge::kCustom},
                            {"ZBridge", 118, 21, 36, 4, ActorType::Bridge::kNone},
                            {"InvisibleBridge32", 5061, 0, 32, 8},
                            {"InvisibleBridge16", 5064, 0, 16, 8},
                            {"InvisibleBridge8", 5065, 0, 8, 8}};
  for (const Bridge& row : bridges) {
    ActorType type = start_type(*catalog, "Actor", row.name, row.number, row.spawn_id);
    type.radius = to_fixed(row.radius), type.height = to_fixed(row.height);
    type.bridge = row.kind;
    type.render_style = RenderStyle::kNone;
    set_flags(&type, {kSolid, kNoGravity});
    add_type(catalog, std::move(type), "");
  }
}

}  // namespace comrad::doom
