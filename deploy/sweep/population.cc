#include "deploy/sweep/population.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "deploy/settings/existing_run.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr std::size_t kHistoryBytesMax = 1 << 26;

/// A value between `low` and `high`, each as likely; on the logarithm's scale where the range is one.
std::string drawn(const SearchedSetting& searched, Rng& rng) {
  const double share = rng.uniform();
  if (!searched.choices.empty())
    return searched.choices[static_cast<std::size_t>(share * static_cast<double>(searched.choices.size()))];
  if (searched.is_log)
    return searched.text(std::exp(std::lerp(std::log(searched.low), std::log(searched.high), share)));
  // Both ends of a range of steps are as likely as what lies between.
  const double step = searched.is_whole ? std::max(searched.step, 1.0) : searched.step;
  if (step > 0) {
    const double count = std::floor((searched.high - searched.low) / step + 1e-6) + 1;
    return searched.text(searched.low + std::floor(share * count) * step);
  }
  return searched.text(std::lerp(searched.low, searched.high, share));
}

const std::string& value_in(const SettingValues& values, const std::string& setting) {
  return std::ranges::find(values, setting, &SettingValues::value_type::first)->second;
}

SettingValues perturbed(const SweepSearch& search, const SettingValues& before, Rng& rng) {
  SettingValues values;
  for (const SearchedSetting& searched : search.space) {
    std::string value = value_in(before, searched.setting);
    const bool is_drawn = rng.uniform() < search.resample_probability;
    const double factor = search.perturb[rng.below(static_cast<uint32_t>(search.perturb.size()))];
    if (is_drawn)
      value = drawn(searched, rng);
    else if (searched.choices.empty())
      value = searched.text(read_real(value).value() * factor);
    values.emplace_back(searched.setting, value);
  }
  return values;
}

std::string member_path(const SweepFolder& folder, const std::string& run) {
  return folder.path() + "/search/" + run + ".json";
}

std::string kept_path(const SweepFolder& folder, const std::string& run, std::size_t generation) {
  return fmt::format("{}/search/{}/{}", folder.path(), run, generation);
}

Expected<Member> read_member(const SweepFolder& folder, const std::string& run) {
  Member member{.name = run, .generations = {}};
  const std::string path = member_path(folder, run);
  std::error_code ignored;
  if (!fs::exists(path, ignored)) return member;
  const Error damaged{ErrorCode::kBadFormat,
                      path +
                          " is damaged; restore it, or remove it and the member's run directory, and it "
                          "begins anew"};
  const Expected<std::string> text = read_short_file(path, kHistoryBytesMax);
  const ordered_json json = ordered_json::parse(text ? *text : "", nullptr, false);
  if (!json.is_object() || !json.contains("generations") || !json["generations"].is_array()) return damaged;
  for (const ordered_json& one : json["generations"]) {
    if (!one.is_object()) return damaged;
    if (!member.generations.empty() && !member.generations.back().is_over()) return damaged;
    Expected<SettingValues> settings = setting_values_from_json(one.value("settings", ordered_json()));
    if (!settings || !check_in_space(folder.search(), *settings, path)) return damaged;
    Generation& generation = member.generations.emplace_back();
    generation.settings = *std::move(settings);
    const auto parent = one.find("parent"), frames = one.find("env_frames"), score = one.find("score");
    if (parent != one.end() && parent->is_string()) generation.parent = parent->get<std::string>();
    if (!generation.parent.empty() && folder.find(generation.parent) == nullptr) return damaged;
    if (frames != one.end() && frames->is_number()) generation.env_frames = frames->get<double>();
    if (score != one.end() && score->is_number()) generation.score = score->get<double>();
  }
  return member;
}

/// Copies the files whose names pass into a new folder `target`, which is there as a whole or not at all. A hard link is a copy
/// that takes no room; checkpoints are never changed.
template <typename Passes>
Status copy_files(const std::string& source, const std::string& target, Passes&& passes) {
  std::error_code failed;
  const std::string half = target + ".new";
  fs::remove_all(half, failed);
  fs::create_directories(half, failed);
  if (failed) return file_error("cannot make " + half, failed.value());
  for (const fs::directory_entry& entry : fs::directory_iterator(source, failed)) {
    const std::string name = entry.path().filename().string();
    if (!passes(name)) continue;
    std::error_code no_link;
    fs::create_hard_link(entry.path(), half + "/" + name, no_link);
    if (no_link) fs::copy_file(entry.path(), half + "/" + name, failed);
    if (failed) break;
  }
  if (!failed) fs::rename(half, target, failed);
  return failed
             ? Status(file_error("cannot copy the checkpoint in " + source + " to " + target, failed.value()))
             : Status();
}

}  // namespace

Generation next_generation(const SweepSearch& search, const std::vector<Member>& members, std::size_t index) {
  const std::vector<Generation>& own = members[index].generations;
  // By name, so that each population of a sweep draws its own numbers.
  Rng rng(RngKey(static_cast<uint64_t>(search.seed)).split(members[index].name).split(own.size()));
  if (own.empty()) {
    Generation first;
    for (const SearchedSetting& searched : search.space)
      first.settings.emplace_back(searched.setting, drawn(searched, rng));
    return first;
  }
  const std::size_t last = own.size() - 1;
  std::vector<std::size_t> ranked;
  for (std::size_t i = 0; i < members.size(); ++i)
    if (members[i].generations.size() > last && members[i].generations[last].is_over()) ranked.push_back(i);
  const auto score_of = [&](std::size_t member) {
    const double score = members[member].generations[last].score;
    return std::isnan(score) ? -std::numeric_limits<double>::infinity() : score;
  };
  std::ranges::stable_sort(ranked, std::greater(), score_of);
  const std::size_t tail =
      std::min(static_cast<std::size_t>(std::ceil(search.quantile * static_cast<double>(ranked.size()))),
               ranked.size() / 2);
  const auto place = static_cast<std::size_t>(std::ranges::find(ranked, index) - ranked.begin());
  Generation next{.settings = own[last].settings};
  if (tail == 0 || place < ranked.size() - tail) return next;
  const std::size_t parent = ranked[rng.below(static_cast<uint32_t>(tail))];
  if (!(score_of(parent) > score_of(index))) return next;
  next.parent = members[parent].name;
  next.settings = perturbed(search, members[parent].generations[last].settings, rng);
  return next;
}

Expected<std::vector<Member>> read_members(const SweepFolder& folder, const SweepRun& run) {
  std::vector<Member> members;
  for (const SweepRun& other : folder.runs()) {
    if (other.study != run.study) continue;
    Expected<Member> member = read_member(folder, other.name);
    if (!member && other.name == run.name) return member.error();
    members.push_back(member ? *std::move(member) : Member{.name = other.name, .generations = {}});
  }
  return members;
}

Status write_member(const SweepFolder& folder, const Member& member) {
  ordered_json json = {{"generations", ordered_json::array()}};
  for (const Generation& one : member.generations) {
    ordered_json& entry = json["generations"].emplace_back();
    entry = {{"settings", to_json(one.settings)}, {"parent", one.parent}};
    if (!one.is_over()) continue;
    entry["env_frames"] = one.env_frames;
    entry["score"] = std::isfinite(one.score) ? ordered_json(one.score) : ordered_json(nullptr);
  }
  return write_file_atomically(member_path(folder, member.name), json.dump(2) + "\n", /*durable=*/true);
}

Status keep_checkpoint(const SweepFolder& folder, const SweepRun& run, std::size_t number) {
  const std::string target = kept_path(folder, run.name, number);
  std::error_code ignored;
  fs::remove_all(target, ignored);  // of an element that was killed right after
  COMRAD_TRY_ASSIGN(const std::string path, find_checkpoint(folder.run_dir(run), CheckpointKind::kLatest));
  const std::string name = fs::path(path).filename().string();
  // Its replay, one file for each learner: replay_<version>_<env frames>.bin, .1.bin.
  const std::string replay = "replay_" + name.substr(name.find('_') + 1, name.rfind('.') - name.find('_'));
  return copy_files(fs::path(path).parent_path().string(), target,
                    [&](const std::string& file) { return file == name || file.starts_with(replay); });
}

Status take_checkpoint(const SweepFolder& folder, const SweepRun& run, std::size_t number,
                       const std::string& parent) {
  const std::string own = folder.run_dir(run) + "/checkpoint", before = fmt::format("{}_{}", own, number),
                    next = own + "_next";
  std::error_code failed;
  if (!fs::exists(before, failed)) {
    fs::remove_all(next, failed);
    COMRAD_TRY(
        copy_files(kept_path(folder, parent, number - 1), next, [](const std::string&) { return true; }));
    fs::rename(own, before, failed);
    if (failed) return file_error("cannot rename " + own, failed.value());
  }
  if (fs::exists(next, failed)) fs::rename(next, own, failed);
  return failed ? Status(file_error("cannot rename " + next, failed.value())) : Status();
}

}  // namespace comrad::deploy
