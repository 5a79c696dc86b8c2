#include <spdlog/fmt/fmt.h>

#include "doomgen/layout/udmf_writer.h"

namespace comrad::doomgen {
namespace {

/// One block of key = value lines.
class Block {
 public:
  Block(std::string& out, const char* name) : out_(out) { out_ += name, out_ += "\n{\n"; }
  ~Block() { out_ += "}\n\n"; }
  Block(const Block&) = delete;
  Block& operator=(const Block&) = delete;

  void number(const char* key, int64_t value) { line(key, std::to_string(value)); }
  void coordinate(const char* key, int64_t value) { line(key, fmt::format("{}.000", value)); }
  void number_unless(const char* key, int64_t value, int64_t default_value) {
    if (value != default_value) number(key, value);
  }
  void text(const char* key, const std::string& value) {
    if (!value.empty()) line(key, "\"" + value + "\"");  // names are checked: no quotes inside
  }
  void flag(const char* key, bool value = true) {
    if (value) line(key, "true");
  }
  void args(const std::array<int32_t, 5>& values) {
    for (std::size_t i = 0; i < values.size(); ++i)
      number_unless((fmt::format("arg{}", i)).c_str(), values[i], 0);
  }
  void extra(const ExtraFields& fields) {
    for (const auto& [key, value] : fields) line(key.c_str(), value);  // checked by validate_map()
  }

 private:
  void line(const char* key, const std::string& value) {
    out_ += key, out_ += " = ", out_ += value, out_ += ";\n";
  }
  std::string& out_;
};

}  // namespace

std::string write_udmf(const MapData& map) {
  std::string out = "namespace = \"zdoom\";\n\n";
  for (const ThingData& thing : map.things) {
    Block block(out, "thing");
    block.number_unless("id", thing.id, 0);
    block.coordinate("x", thing.position.x);
    block.coordinate("y", thing.position.y);
    if (thing.height != 0) block.coordinate("height", thing.height);
    block.number_unless("angle", thing.angle_degrees, 0);
    block.number("type", thing.editor_number);
    block.number_unless("special", thing.special, 0);
    block.args(thing.args);
    for (int skill = 0; skill < 5; ++skill)
      block.flag((fmt::format("skill{}", skill + 1)).c_str(), (thing.skills >> skill & 1) != 0);
    block.flag("single", thing.single);
    block.flag("coop", thing.coop);
    block.flag("dm", thing.deathmatch);
    block.flag("ambush", thing.ambush);
    block.flag("dormant", thing.dormant);
    block.extra(thing.extra);
  }
  for (const Point& vertex : map.vertices) {
    Block block(out, "vertex");
    block.coordinate("x", vertex.x);
    block.coordinate("y", vertex.y);
  }
  for (const LinedefData& line : map.linedefs) {
    Block block(out, "linedef");
    block.number_unless("id", line.id, 0);
    block.number("v1", line.start);
    block.number("v2", line.end);
    block.number("sidefront", line.front);
    if (line.back) block.number("sideback", *line.back);
    block.flag("blocking", line.blocking);
    block.flag("twosided", line.back.has_value());
    block.number_unless("special", line.special, 0);
    block.args(line.args);
    block.flag("blockmonsters", line.block_monsters);
    block.flag("blockeverything", line.block_everything);
    block.flag("dontpegtop", line.upper_unpegged);
    block.flag("dontpegbottom", line.lower_unpegged);
    block.flag("secret", line.secret);
    block.flag("blocksound", line.block_sound);
    block.flag("dontdraw", line.hidden);
    block.flag("mapped", line.mapped);
    block.flag("repeatspecial", line.repeatable);
    block.flag("playeruse", line.player_use);
    block.flag("playercross", line.player_cross);
    block.flag("playerpush", line.player_push);
    block.flag("impact", line.impact);
    block.extra(line.extra);
  }
  for (const SidedefData& side : map.sidedefs) {
    Block block(out, "sidedef");
    block.number("sector", side.sector);
    block.text("texturetop", side.top);
    block.text("texturebottom", side.bottom);
    block.text("texturemiddle", side.middle);
    block.number_unless("offsetx", side.offset_x, 0);
    block.number_unless("offsety", side.offset_y, 0);
  }
  for (const SectorData& sector : map.sectors) {
    Block block(out, "sector");
    block.number_unless("heightfloor", sector.floor_height, 0);
    block.number_unless("heightceiling", sector.ceiling_height, 0);
    block.text("texturefloor", sector.floor_texture);
    block.text("textureceiling", sector.ceiling_texture);
    block.number_unless("lightlevel", sector.light, 160);
    block.number_unless("special", sector.special, 0);
    block.number_unless("id", sector.tag, 0);
    block.extra(sector.extra);
  }
  return out;
}

}  // namespace comrad::doomgen
