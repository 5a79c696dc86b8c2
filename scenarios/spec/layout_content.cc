#include "scenarios/spec/layout_content.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <string_view>

#include "doomgen/layout/wad_writer.h"
#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/udmf_reader.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/registry.h"

namespace comrad::scenarios {
namespace {

constexpr uint64_t kOneInIsForEvaluation = 10;
constexpr int kDrawsPerMapOfAll = 10;      // a sample with fewer draws a map is no evidence about "all"
constexpr double kLnOfTwenty = 2.9957323;  // 95 % confidence

/// Numbers and words in a row, parted so that no two rows read the same.
class Canonical {
 public:
  void add(int64_t value) { text_ += std::to_string(value), text_ += ' '; }
  void add(double value) { add(static_cast<int64_t>(std::llround(value * 65536))); }
  void add(const std::string& word) { text_ += word, text_ += ' '; }
  void mark(char kind) { text_ += '\n', text_ += kind, text_ += ' '; }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

template <typename Record>
const Record* record(const std::vector<Record>& records, int32_t index) {
  return index >= 0 && index < static_cast<int64_t>(records.size())
             ? &records[static_cast<std::size_t>(index)]
             : nullptr;
}

/// Lines by their places rather than by their vertices' numbers: node builders add vertices.
void add_map(const wad::UdmfMap& map, Canonical& out) {
  for (const wad::UdmfLinedef& line : map.linedefs) {
    out.mark('l');
    for (const int32_t end : {line.v1, line.v2})
      if (const wad::UdmfVertex* vertex = record(map.vertices, end)) out.add(vertex->x), out.add(vertex->y);
    for (const bool flag : {line.blocking, line.block_monsters, line.block_everything, line.two_sided,
                            line.dont_peg_top, line.dont_peg_bottom})
      out.add(int64_t{flag});
    out.add(int64_t{line.special});
    for (const int32_t argument : line.args) out.add(int64_t{argument});
    for (const int32_t index : {line.side_front, line.side_back})
      if (const wad::UdmfSidedef* side = record(map.sidedefs, index)) {
        out.mark('s');
        for (const int32_t number : {side->sector, side->offset_x, side->offset_y}) out.add(int64_t{number});
        for (const std::string* name : {&side->texture_top, &side->texture_middle, &side->texture_bottom})
          out.add(*name);
      }
  }
  for (const wad::UdmfSector& sector : map.sectors) {
    out.mark('r');
    out.add(sector.height_floor), out.add(sector.height_ceiling);
    out.add(sector.texture_floor), out.add(sector.texture_ceiling);
    for (const int32_t number : {sector.light_level, sector.special, sector.id}) out.add(int64_t{number});
  }
  for (const wad::UdmfThing& thing : map.things) {
    out.mark('t');
    out.add(thing.x), out.add(thing.y), out.add(thing.height);
    for (const int32_t number : {thing.type, thing.angle, thing.id, thing.special}) out.add(int64_t{number});
    for (const int32_t argument : thing.args) out.add(int64_t{argument});
  }
}

bool is_name(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }

std::string without_comments(std::string_view script) {
  std::string text;
  while (!script.empty()) {
    const std::size_t at = std::min(script.find("//"), script.find("/*"));
    text += script.substr(0, at);
    if (at == std::string_view::npos) break;
    const std::string_view end = script[at + 1] == '/' ? "\n" : "*/";
    script.remove_prefix(std::min(script.find(end, at + 2), script.size() - end.size()) + end.size());
    text += '\n';
  }
  return text;
}

/// Is `name` in the script as its own word? ACS ignores the case of names.
bool names(std::string_view script, std::string_view name) {
  const auto same = [](char a, char b) {
    return std::toupper(static_cast<unsigned char>(a)) == std::toupper(static_cast<unsigned char>(b));
  };
  for (auto at = script.begin();; ++at) {
    at = std::search(at, script.end(), name.begin(), name.end(), same);
    if (at == script.end()) return false;
    const auto end = at + static_cast<std::ptrdiff_t>(name.size());
    if ((at == script.begin() || !is_name(at[-1])) && (end == script.end() || !is_name(*end))) return true;
  }
}

/// The numbers of layout_script_text() that the script below them names; false where the text has none.
bool add_numbers(std::string_view source, Canonical& out) {
  if (!source.starts_with(kLayoutScriptHead)) return false;
  const std::size_t end = source.find("\n\n");
  if (end == std::string_view::npos) return false;
  const std::string script = without_comments(source.substr(end));
  std::string_view head = source.substr(0, end);
  head.remove_prefix(std::min(head.size(), head.find('\n') + 1));
  while (!head.empty()) {
    const std::string_view line = head.substr(0, head.find('\n'));
    head.remove_prefix(std::min(head.size(), line.size() + 1));
    const std::size_t name_at = line.find(' ') + 1;  // behind "#define" or "int"
    const std::string_view rest = line.substr(name_at);
    const auto name_end = std::find_if_not(rest.begin(), rest.end(), is_name);
    const std::string_view name = rest.substr(0, static_cast<std::size_t>(name_end - rest.begin()));
    if (name == "LAYOUT_SEED" || !names(script, name)) continue;
    out.mark('n');
    out.add(std::string(line));
  }
  return true;
}

}  // namespace

Expected<uint64_t> layout_content(const wad::WadFile& wad) {
  const std::vector<std::string> maps = wad.map_names();
  if (maps.empty()) return Error{ErrorCode::kNotFound, wad.path() + ": there is no map in it"};
  COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad.find_map(maps[0]));
  COMRAD_TRY_ASSIGN(const wad::UdmfMap map,
                    lumps.textmap ? wad::parse_udmf(wad.text(*lumps.textmap), wad.path() + ": TEXTMAP")
                                  : wad::read_binary_map(wad, lumps, wad.path() + ": " + maps[0]));
  Canonical content;
  add_map(map, content);
  if (!(lumps.scripts && add_numbers(wad.text(*lumps.scripts), content)) && lumps.behavior) {
    content.mark('b');
    content.add(std::string(wad.text(*lumps.behavior)));
  }
  return mix64(doomgen::content_hash(content.text()));
}

bool is_held_out_seed(uint64_t seed) {
  return std::find(std::begin(kHeldOutSeeds), std::end(kHeldOutSeeds), seed) != std::end(kHeldOutSeeds);
}

Expected<ContentSplit> ContentSplit::of(const std::string& scenario) {
  ContentSplit split;
  const Expected<LayoutRecipe> recipe = layout_recipe(scenario);
  if (!recipe) return split;
  split.has_recipe_ = true;
  for (const CurriculumStage& stage : recipe->curriculum.stages) {
    COMRAD_TRY_ASSIGN(const GeneratedLayout layout,
                      generate_layout(scenario, stage_request(recipe->curriculum, stage)));
    split.stages_.insert(layout.map_hash);
  }
  for (const uint64_t seed : kHeldOutSeeds) {
    COMRAD_TRY_ASSIGN(const GeneratedLayout layout, generate_layout(scenario, {.seed = seed}));
    split.held_out_.insert(layout.map_hash);
  }
  return split;
}

bool ContentSplit::is_for_evaluation(uint64_t content) const {
  if (!has_recipe_ || stages_.contains(content)) return false;
  return held_out_.contains(content) || content % kOneInIsForEvaluation == 0;
}

DistinctMaps distinct_maps(const std::vector<uint64_t>& contents) {
  std::map<uint64_t, int> times;
  for (const uint64_t content : contents) ++times[content];
  const auto came = [&](int often) {
    return std::count_if(times.begin(), times.end(), [&](const auto& one) { return one.second == often; });
  };
  DistinctMaps maps{.draws = static_cast<int>(contents.size()), .distinct = static_cast<int>(times.size())};
  const auto once = static_cast<double>(came(1)), twice = static_cast<double>(came(2));
  const double draws = maps.draws;
  if (once == 0 && maps.draws >= kDrawsPerMapOfAll * maps.distinct) {
    maps.kind = DistinctMaps::Kind::kAll;
    maps.count = maps.distinct;
  } else if (maps.distinct == maps.draws) {
    maps.kind = DistinctMaps::Kind::kAtLeast;
    maps.count = std::max<int64_t>(maps.distinct, std::llround(draws * (draws - 1) / (2 * kLnOfTwenty)));
  } else {
    maps.kind = DistinctMaps::Kind::kEstimate;
    maps.count = maps.distinct + std::llround((draws - 1) / draws * once * (once - 1) / (2 * (twice + 1)));
  }
  return maps;
}

std::string distinct_maps_text(const DistinctMaps& maps) {
  const std::string count = std::to_string(maps.count), draws = std::to_string(maps.draws),
                    maps_of = maps.count == 1 ? " map" : " distinct maps";
  switch (maps.kind) {
    case DistinctMaps::Kind::kAll:
      return count + maps_of + " (all there are: " + draws + " draws gave each one several times)";
    case DistinctMaps::Kind::kEstimate:
      return fmt::format("about {}{} (estimate: {} draws gave {})", count, maps_of, draws, maps.distinct);
    case DistinctMaps::Kind::kAtLeast:
      return "at least " + count + maps_of + " (95 % confidence: " + draws + " draws, all different)";
  }
  return {};
}

}  // namespace comrad::scenarios
