#include "sim_workers/engine/play/actor_catalog.h"

#include <initializer_list>
#include <string>
#include <utility>

namespace comrad::doom {
namespace {

/// `letters` shown for `tics` each, in a circle; one letter with -1 tics stands still.
std::vector<ActorType::Frame> loop(std::string_view letters, int16_t tics) {
  std::vector<ActorType::Frame> frames;
  for (char letter : letters) frames.push_back({.frame = static_cast<uint8_t>(letter - 'A'), .tics = tics});
  return frames;
}

ActorType player() {
  ActorType type;
  type.name = "Player";
  type.radius = to_fixed(16), type.height = to_fixed(56);
  type.health = 100;
  type.solid = type.shootable = type.is_player = true;
  type.sprite = "PLAY";
  type.frames = loop("A", -1);
  for (char letter : std::string_view("ABCD")) type.frames.push_back({static_cast<uint8_t>(letter - 'A'), 4});
  type.frames.back().next = kPlayerWalkFrame;
  for (char letter : std::string_view("HIJKLMN"))
    type.frames.push_back({static_cast<uint8_t>(letter - 'A'), 10});
  type.frames.back().tics = -1;
  return type;
}

ActorType health(std::string name, int32_t editor_number, std::string sprite, std::string_view letters,
                 int16_t tics, int32_t heal_amount, int32_t heal_limit) {
  ActorType type;
  type.name = std::move(name);
  type.editor_number = editor_number;
  type.pickup = true;
  type.heal_amount = heal_amount, type.heal_limit = heal_limit;
  type.sprite = std::move(sprite);
  type.frames = loop(letters, tics);
  return type;
}

/// A place in the map that nobody sees or touches.
ActorType marker(std::string name, int32_t editor_number) {
  ActorType type;
  type.name = std::move(name);
  type.editor_number = editor_number;
  type.no_gravity = type.no_blockmap = true;
  return type;
}

struct Decoration {
  const char* name;
  int32_t editor_number;
  const char* sprite;
  const char* letters;
  int16_t tics;
  int radius, height;
  bool solid, bright;
};

// Names, numbers, sizes and sprites of Doom's scenery.
constexpr Decoration kDecorations[] = {
    {"TallGreenColumn", 30, "COL1", "A", -1, 16, 52, true, false},
    {"ShortGreenColumn", 31, "COL2", "A", -1, 16, 40, true, false},
    {"TallRedColumn", 32, "COL3", "A", -1, 16, 52, true, false},
    {"ShortRedColumn", 33, "COL4", "A", -1, 16, 40, true, false},
    {"HeartColumn", 36, "COL5", "AB", 14, 16, 40, true, false},
    {"SkullColumn", 37, "COL6", "A", -1, 16, 40, true, false},
    {"TechPillar", 48, "ELEC", "A", -1, 16, 128, true, false},
    {"Column", 2028, "COLU", "A", -1, 16, 48, true, true},
    {"TechLamp", 85, "TLMP", "ABCD", 4, 16, 80, true, true},
    {"TechLamp2", 86, "TLP2", "ABCD", 4, 16, 60, true, true},
    {"Candlestick", 34, "CAND", "A", -1, 20, 14, false, true},
    {"Candelabra", 35, "CBRA", "A", -1, 16, 60, true, true},
    {"EvilEye", 41, "CEYE", "ABCB", 6, 16, 54, true, true},
    {"FloatingSkull", 42, "FSKU", "ABC", 6, 16, 26, true, true},
    {"TorchTree", 43, "TRE1", "A", -1, 16, 56, true, false},
    {"BlueTorch", 44, "TBLU", "ABCD", 4, 16, 68, true, true},
    {"GreenTorch", 45, "TGRN", "ABCD", 4, 16, 68, true, true},
    {"RedTorch", 46, "TRED", "ABCD", 4, 16, 68, true, true},
    {"Stalagtite", 47, "SMIT", "A", -1, 16, 40, true, false},
    {"BigTree", 54, "TRE2", "A", -1, 32, 108, true, false},
    {"ShortBlueTorch", 55, "SMBT", "ABCD", 4, 16, 37, true, true},
    {"ShortGreenTorch", 56, "SMGT", "ABCD", 4, 16, 37, true, true},
    {"ShortRedTorch", 57, "SMRT", "ABCD", 4, 16, 37, true, true},
    {"BurningBarrel", 70, "FCAN", "ABC", 4, 16, 32, true, true},
};

ActorType decoration(const Decoration& row) {
  ActorType type;
  type.name = row.name;
  type.editor_number = row.editor_number;
  type.radius = to_fixed(row.radius), type.height = to_fixed(row.height);
  type.solid = row.solid, type.bright = row.bright;
  type.sprite = row.sprite;
  type.frames = loop(row.letters, row.tics);
  return type;
}

}  // namespace

ActorCatalog::ActorCatalog() {
  add(player());
  for (int number : {1, 2, 3, 4}) add(marker("Player" + std::to_string(number) + "Start", number));
  for (int number : {5, 6, 7, 8}) add(marker("Player" + std::to_string(number) + "Start", 4001 + number - 5));
  add(marker("TeleportDest", 14));
  add(marker("MapSpot", 9001));
  add(health("Stimpack", 2011, "STIM", "A", -1, 10, 100));
  add(health("Medikit", 2012, "MEDI", "A", -1, 25, 100));
  ActorType bonus = health("HealthBonus", 2014, "BON1", "ABCDCB", 6, 1, 200);
  bonus.always_taken = true;
  add(std::move(bonus));
  for (const Decoration& row : kDecorations) add(decoration(row));
}

uint32_t ActorCatalog::add(ActorType type) {
  if (const std::optional<uint32_t> known = find(type.name)) {
    types_[*known] = std::move(type);
    return *known;
  }
  types_.push_back(std::move(type));
  return static_cast<uint32_t>(types_.size() - 1);
}

std::optional<uint32_t> ActorCatalog::find(std::string_view name) const {
  for (uint32_t index = 0; index < types_.size(); ++index)
    if (types_[index].name == name) return index;
  return std::nullopt;
}

std::optional<uint32_t> ActorCatalog::find_editor_number(int32_t number) const {
  if (number < 0) return std::nullopt;
  // The newest wins: a scenario's actor may take a built-in one's number.
  for (uint32_t index = static_cast<uint32_t>(types_.size()); index-- > 0;)
    if (types_[index].editor_number == number) return index;
  return std::nullopt;
}

}  // namespace comrad::doom
