// comrad-doomgen NAME --seed N -o FILE: draws one layout of a scenario and writes it as a WAD; --pool draws
// many. comrad-doomgen show FILE|NAME: a map from above. comrad-doomgen check FOLDER: is a pool whole?
#include <spdlog/fmt/fmt.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "doomgen/layout/map_picture.h"
#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"
#include "scenarios/spec/layout_pool.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/wad_maps.h"

namespace comrad {
namespace {

int report(const Error& error) {
  std::fprintf(stderr, "comrad-doomgen: %s\n", error.message.c_str());
  return error.code == ErrorCode::kSystem || error.code == ErrorCode::kNoSpace ? 1 : 2;
}

std::string parameter_help() {
  std::string text;
  for (const std::string& name : scenarios::layout_recipes()) {
    text += "Layout parameters of " + name + " (--name value, or --set name=value):\n";
    const auto parameters = scenarios::layout_parameters(name);
    for (const scenarios::LayoutParameter& p : *parameters)
      text += fmt::format("  {} = {}: {}\n", p.name, p.default_value, p.help);
  }
  return text +
         "A map from above: comrad doomgen show FILE.wad|NAME [-o PICTURE.png]\n"
         "Is a pool whole, and what is in it: comrad doomgen check FOLDER\n"
         "A pool of the maps of one WAD: comrad doomgen split FILE.wad -o FOLDER\n";
}

/// A file, or the default layout of a scenario of that name or folder.
Expected<wad::WadFile> wad_of(const std::string& path) {
  if (std::filesystem::is_regular_file(path) || path.ends_with(".wad")) return wad::WadFile::open(path);
  COMRAD_TRY_ASSIGN(const scenarios::GeneratedLayout layout, scenarios::generate_layout(path, {}));
  return wad::WadFile::from_bytes({layout.wad.begin(), layout.wad.end()}, path);
}

Expected<wad::UdmfMap> read_map(const std::string& path, std::string name) {
  COMRAD_TRY_ASSIGN(const wad::WadFile wad, wad_of(path));
  if (name.empty()) {
    const std::vector<std::string> names = wad.map_names();
    if (names.empty()) return Error{ErrorCode::kNotFound, path + ": there is no map in it"};
    name = names[0];
  }
  COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad.find_map(name));
  if (!lumps.textmap) return wad::read_binary_map(wad, lumps, path + ": " + name);
  return wad::parse_udmf(wad.text(*lumps.textmap), path + ": TEXTMAP of " + name);
}

Status draw_picture(const std::string& path, const std::string& name, const std::string& out, int side) {
  COMRAD_TRY_ASSIGN(const wad::UdmfMap map, read_map(path, name));
  COMRAD_TRY_ASSIGN(const doomgen::Picture picture, doomgen::draw_map(map, side));
  COMRAD_TRY_ASSIGN(const std::string png, doomgen::encode_indexed_png(picture));
  COMRAD_TRY(write_file_atomically(out, png, /*durable=*/true));
  std::printf("%s: %dx%d pixels, %zu sectors, %zu lines, %zu things\n", out.c_str(), picture.width,
              picture.height, map.sectors.size(), map.linedefs.size(), map.things.size());
  for (const doomgen::ThingKind& kind : doomgen::thing_kinds())
    if (const auto count = std::ranges::count_if(
            map.things,
            [&](const wad::UdmfThing& thing) { return &doomgen::kind_of_thing(thing.type) == &kind; });
        count > 0)
      std::printf("  %s: %zd %s\n", kind.colour_name, count, kind.name);
  return {};
}

int show(int argc, char** argv) {
  std::string path, out, name;
  int side = 1024;
  std::string legend =
      "Draws a map from above as a PNG. Floors: darkest lowest, brown where closed. Lines: white walls, grey "
      "two-sided, yellow two-sided and blocking. Things:";
  for (const doomgen::ThingKind& kind : doomgen::thing_kinds())
    legend += std::string(&kind == &doomgen::thing_kinds().front() ? " " : "; ") + kind.colour_name + " " +
              kind.name;
  CLI::App app(legend + ".", "comrad-doomgen show");
  app.add_option("file", path, "WAD to look at, or a scenario, whose default layout is drawn")->required();
  app.add_option("-o,--out", out, "PNG file to write; the WAD's or scenario's name with .png by default");
  app.add_option("--map", name, "map in the WAD; its first one by default");
  app.add_option("--size", side, "pixels of the longer side")->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (out.empty()) out = std::filesystem::path(path).replace_extension(".png").string();
  const Status drawn = draw_picture(path, name, out, side);
  return drawn ? 0 : report(drawn.error());
}

/// ", 190 distinct maps"; empty where the registry does not report it.
std::string distinct_words(const std::vector<scenarios::PoolEntry>& entries) {
  std::set<uint64_t> maps;
  for (const scenarios::PoolEntry& entry : entries) maps.insert(entry.map_hash);
  if (maps.contains(0)) return {};
  return fmt::format(", {}{}", maps.size(), (maps.size() == 1 ? " distinct map" : " distinct maps"));
}

Status check_folder(const std::string& folder, const scenarios::PoolUse& use, bool toml) {
  COMRAD_TRY_ASSIGN(const LayoutList list, scenarios::check_pool(folder, use));
  if (toml) {
    std::fputs(layout_list_text(list).c_str(), stdout);
    return {};
  }
  COMRAD_TRY_ASSIGN(const std::vector<scenarios::PoolEntry> entries, scenarios::read_pool(folder));
  for (const scenarios::PoolEntry& entry : entries) {
    std::string choices;
    for (const auto& [axis, choice] : entry.axis_choices) choices += " " + axis + "(" + choice + ")";
    std::printf("%s  seed %llu  %s%s%s\n", entry.id.c_str(), static_cast<unsigned long long>(entry.info.seed),
                entry.split.empty() ? "no split" : entry.split.c_str(),
                entry.stage.empty() ? "" : ("  " + entry.stage).c_str(), choices.c_str());
  }
  std::printf("%s: %zu layouts, all there and whole%s\n", folder.c_str(), entries.size(),
              distinct_words(entries).c_str());
  return {};
}

int check(int argc, char** argv) {
  std::string folder, purpose = "eval";
  bool toml = false;
  scenarios::PoolUse use;
  CLI::App app("Reads every layout of a pool: files, hashes, maps, starts.", "comrad-doomgen check");
  app.add_option("folder", folder, "the pool")->required();
  app.add_option("--scenario", use.scenario, "scenario whose maps they must be");
  app.add_option("--num_agents", use.num_agents, "agents that must find a start")->check(CLI::Range(0, 8));
  app.add_option("--for", purpose, "train: refuse layouts for evaluation")
      ->check(CLI::IsMember({"train", "eval"}))
      ->capture_default_str();
  app.add_flag("--toml", toml, "print what a run reads (layouts/pool.toml) and nothing else");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  use.for_training = purpose == "train";
  const Status checked = check_folder(folder, use, toml);
  return checked ? 0 : report(checked.error());
}

int split(int argc, char** argv) {
  std::string path, folder;
  CLI::App app("Makes a pool of the maps of one WAD, a file for each.", "comrad-doomgen split");
  app.add_option("file", path, "WAD with the maps")->required();
  app.add_option("-o,--out", folder, "folder of the pool")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const auto pool = scenarios::split_wad(path, folder);
  if (!pool) return report(pool.error());
  std::printf("%s: %zu maps of %s, listed in %s\n", folder.c_str(), pool->size(), path.c_str(),
              scenarios::kPoolRegistryName);
  return 0;
}

/// "--name value" and "--name=value", which the parser does not know, are layout parameters.
Status take_parameters(const std::vector<std::string>& words, scenarios::LayoutRequest& request) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (!word.starts_with("--"))
      return Error{ErrorCode::kBadInput, "'" + word + "' is not understood; parameters are --name value"};
    const std::size_t equals = word.find('=');
    if (equals != std::string::npos) {
      request.parameters.emplace_back(word.substr(2, equals - 2), word.substr(equals + 1));
    } else {
      if (i + 1 == words.size()) return Error{ErrorCode::kBadInput, word + " needs a value"};
      request.parameters.emplace_back(word.substr(2), words[++i]);
    }
  }
  return {};
}

int make_one(const std::string& name, const scenarios::LayoutRequest& request, const std::string& path) {
  const Expected<scenarios::GeneratedLayout> layout = scenarios::generate_layout(name, request);
  if (!layout) return report(layout.error());
  for (const std::string& warning : layout->warnings)
    std::fprintf(stderr, "comrad-doomgen: %s\n", warning.c_str());
  for (const std::string& refusal : layout->refusals)
    std::fprintf(stderr, "comrad-doomgen: refused, trying the next: %s\n", refusal.c_str());
  if (const Status written = write_file_atomically(path, layout->wad, /*durable=*/true); !written)
    return report(written.error());
  std::printf("%s: %s, seed %llu, attempt %d, %zu bytes, hash %016llx, map %016llx\n", path.c_str(),
              name.c_str(), static_cast<unsigned long long>(request.seed), layout->info.attempt,
              layout->wad.size(), static_cast<unsigned long long>(layout->content_hash),
              static_cast<unsigned long long>(layout->map_hash));
  return 0;
}

int make_many(const std::string& name, const scenarios::PoolRequest& request, const std::string& folder) {
  int retries = 0;
  scenarios::PoolTally tally;
  const auto pool = scenarios::make_pool(
      name, request, folder, [&](const scenarios::PoolEntry& entry) { retries += entry.retries; }, &tally);
  if (!pool) return report(pool.error());
  std::printf("%s: %zu layouts of %s%s, %d retries, listed in %s", folder.c_str(), pool->size(), name.c_str(),
              distinct_words(*pool).c_str(), retries, scenarios::kPoolRegistryName);
  if (tally.draws > 0)
    std::printf("; %d drawn, of which %d are for %s and %d were there already", tally.draws, tally.other_pool,
                request.kind == scenarios::PoolKind::kEval ? "training" : "evaluation", tally.repeated);
  std::printf("\n");
  return 0;
}

int count_distinct(const std::string& name, const scenarios::PoolRequest& request, int draws) {
  const auto maps = scenarios::count_distinct_maps(name, request, draws);
  if (!maps) return report(maps.error());
  std::printf("%s: %s\n", name.c_str(), scenarios::distinct_maps_text(*maps).c_str());
  return 0;
}

/// "name=value,value,..." as an axis.
Expected<scenarios::GridRequest::Axis> parse_axis(const std::string& text) {
  const auto bad = [&] {
    return Error{ErrorCode::kBadInput, "--grid " + text + ": write name=value,value,... with whole numbers"};
  };
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0) return bad();
  scenarios::GridRequest::Axis axis{text.substr(0, equals)};
  const char *at = text.data() + equals + 1, *end = text.data() + text.size();
  while (at < end) {
    int64_t value = 0;
    const auto [stop, failure] = std::from_chars(at, end, value);
    if (failure != std::errc() || (stop != end && (*stop != ',' || stop + 1 == end))) return bad();
    axis.options.push_back({{axis.name, value}});
    at = stop + 1;
  }
  if (axis.options.empty()) return bad();
  return axis;
}

int make_grid(const std::string& name, const std::vector<std::string>& axes, scenarios::GridRequest request,
              const std::string& folder) {
  for (const std::string& text : axes) {
    if (text == "axes") continue;
    const auto axis = parse_axis(text);
    if (!axis) return report(axis.error());
    request.axes.push_back(*axis);
  }
  request.left_out = [](int64_t place, const Error& why) {
    std::fprintf(stderr, "comrad-doomgen: place %lld is left out: %s\n", static_cast<long long>(place),
                 why.message.c_str());
  };
  const auto pool = scenarios::make_grid_pool(name, request, folder);
  if (!pool) return report(pool.error());
  std::printf("%s: %zu layouts of %s%s, listed in %s\n", folder.c_str(), pool->size(), name.c_str(),
              distinct_words(*pool).c_str(), scenarios::kPoolRegistryName);
  return 0;
}

int run(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "show") return show(argc - 1, argv + 1);
  if (argc > 1 && std::string(argv[1]) == "check") return check(argc - 1, argv + 1);
  if (argc > 1 && std::string(argv[1]) == "split") return split(argc - 1, argv + 1);
  std::string name, path, pool, format = "udmf";
  std::vector<std::string> settings;
  scenarios::PoolRequest many;
  scenarios::LayoutRequest& request = many.layout;
  CLI::App app("Draws layouts of a scenario and writes them as WADs.", "comrad-doomgen");
  app.add_option("name,--scenario", name, "scenario whose map is drawn: a name, or the path of a folder")
      ->required();
  app.add_option("--seed", request.seed, "seed of the layout")->capture_default_str();
  app.add_option("-o,--out", path, "file to write; with --pool and --grid the folder");
  app.add_option("--num_agents", request.num_agents, "agents that must find a start; 0: the recipe's number")
      ->check(CLI::Range(0, 8));
  app.add_option("--set", settings, "a layout parameter as name=value; may be repeated");
  app.add_option("--format", format, "map format")
      ->check(CLI::IsMember({"udmf", "hexen"}))
      ->capture_default_str();
  app.add_flag("--nodes", request.nodes, "build nodes with zdbsp");
  CLI::Option* pool_option =
      app.add_option(
             "--pool", pool,
             "draw a pool of distinct layouts for training or evaluation, which never share a map, or the "
             "stages of the scenario's curriculum")
          ->check(CLI::IsMember({"train", "eval", "curriculum"}));
  app.add_option("--count", many.count, "layouts of the pool")->capture_default_str()->needs(pool_option);
  app.add_flag("--vary,!--no-vary", many.vary,
               "layouts of the pool draw an option of each of the recipe's axes and have all of its variety "
               "(default)");
  CLI::Option* as_option =
      app.add_option("--as", request.as,
                     "the scenario of your own that the map is for (its name): the map and its script "
                     "stay, and your scenario.toml, with wad = the file, defines what is paid")
          ->excludes(pool_option);
  int draws = 0;
  app.add_option(
         "--distinct", draws,
         "write nothing, but draw so many layouts as a pool does and say how many distinct maps there "
         "are: all of them, an estimate, or a number that is at least there")
      ->excludes(pool_option)
      ->check(CLI::Range(2, 100'000));
  std::vector<std::string> axes;
  scenarios::GridRequest grid;
  CLI::Option* grid_option =
      app.add_option(
             "--grid", axes,
             "draw a product: name=value,value,... for each axis (seed is one too), or the word axes for "
             "all of the recipe's; may be repeated, the last axis turns fastest")
          ->excludes(pool_option)
          ->excludes(as_option)
          ->allow_extra_args(false);
  app.add_option("--start", grid.start, "first place of the grid that is drawn")
      ->capture_default_str()
      ->needs(grid_option);
  app.add_option("--limit", grid.limit, "layouts of the grid at most")
      ->capture_default_str()
      ->needs(grid_option);
  std::string purpose;
  app.add_option("--for", purpose, "train: leave out layouts of the grid that belong to evaluation")
      ->check(CLI::IsMember({"train"}))
      ->needs(grid_option);
  app.allow_extras();
  app.footer(parameter_help());
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  for (const std::string& setting : settings) {
    const std::size_t equals = setting.find('=');
    if (equals == std::string::npos)
      return report({ErrorCode::kBadInput, "--set " + setting + ": write name=value"});
    request.parameters.emplace_back(setting.substr(0, equals), setting.substr(equals + 1));
  }
  if (const Status taken = take_parameters(app.remaining(), request); !taken) return report(taken.error());
  if (*as_option && (request.as.empty() || request.as.find('/') != std::string::npos))
    return report(
        {ErrorCode::kBadInput, "--as '" + request.as + "': give the scenario's name, which is its folder's"});
  request.format = format == "hexen" ? scenarios::MapFormat::kHexen : scenarios::MapFormat::kUdmf;
  if (draws > 0) return count_distinct(name, many, draws);
  if (path.empty()) return report({ErrorCode::kBadInput, "say where to write with -o"});
  if (!axes.empty()) {
    grid.layout = request;
    grid.for_training = purpose == "train";
    return make_grid(name, axes, grid, path);
  }
  if (pool.empty()) return make_one(name, request, path);
  if (pool == "curriculum" && !request.parameters.empty())
    return report({ErrorCode::kBadInput, "--pool curriculum: its stages have their own parameters"});
  many.kind = pool == "train"  ? scenarios::PoolKind::kTrain
              : pool == "eval" ? scenarios::PoolKind::kEval
                               : scenarios::PoolKind::kCurriculum;
  return make_many(name, many, path);
}

}  // namespace
}  // namespace comrad

int main(int argc, char** argv) {
  comrad::prepare_process();
  return comrad::run(argc, argv);
}
