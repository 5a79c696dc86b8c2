// What a sweep's file may say, and the runs that it makes.
#include "deploy/sweep/sweep_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "deploy/sweep/local_backend.h"
#include "deploy/sweep/slurm_backend.h"
#include "deploy/sweep/sweep_element.h"
#include "deploy/sweep/sweep_estimate.h"
#include "deploy/sweep/sweep_plan.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace sweep_file_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr const char* kSmall = R"(
name = "study"
[axes]
scenario = ["field", "pit"]
algo = ["IPPO", "qmix"]
seed = [42, 68]
[settings]
preset = "small"
train_for_env_frames = 1e6
)";

Expected<ScenarioDescription> describe(const RunConfig& config) {
  const std::string& name = config.run.scenario;
  const int64_t num_agents = config.environment.num_agents;
  if (name != "field" && name != "pit")
    return Error{ErrorCode::kBadInput, "unknown scenario '" + name + "'; did you mean 'field'?"};
  if (num_agents > 2)
    return Error{ErrorCode::kBadInput,
                 "--num_agents=" + std::to_string(num_agents) + ": supports 1, 2 agents"};
  ScenarioDescription scenario;
  scenario.name = name;
  scenario.supported_agents = {1, 2};
  scenario.env.num_agents = num_agents == 0 ? 2 : static_cast<int32_t>(num_agents);
  scenario.env.head_count = 1;
  scenario.env.head_sizes[0] = 3;
  return scenario;
}

std::string refusal(const std::string& text) {
  const Expected<SweepFile> file = parse_sweep_file(text, "s.toml");
  return file ? "accepted" : file.error().message;
}

std::string plan_refusal(const std::string& text) {
  const Expected<SweepFile> file = parse_sweep_file(text, "s.toml");
  if (!file) return file.error().message;
  const Expected<SweepPlan> plan = plan_sweep(*file, describe, 4);
  if (!plan) return plan.error().message;
  const Status starts = check_starts(*plan, describe, [](const RunConfig&, const EnvShape&) {
    return Expected<NetworkSize>(NetworkSize{.weights_bytes = 1 << 20, .recurrent_state_count = 512});
  });
  return starts ? "accepted" : starts.error().message;
}

SweepPlan plan_of(const std::string& text, int cores = 4) {
  const Expected<SweepFile> file = parse_sweep_file(text, "s.toml");
  EXPECT_TRUE(file) << file.error().message;
  Expected<SweepPlan> plan = plan_sweep(*file, describe, cores);
  EXPECT_TRUE(plan) << plan.error().message;
  return *std::move(plan);
}

std::vector<std::string> names_of(const SweepPlan& plan) {
  std::vector<std::string> names;
  for (const SweepRun& run : plan.runs) names.push_back(run.name);
  return names;
}

TEST(SweepFile, KeepsTheOrderOfTheFile) {
  const Expected<SweepFile> file = parse_sweep_file(kSmall, "s.toml");
  ASSERT_TRUE(file) << file.error().message;
  ASSERT_EQ(file->axes.size(), 3u);
  EXPECT_EQ(file->axes[0].setting, "scenario");
  EXPECT_THAT(file->axes[1].values, ElementsAre("ippo", "qmix"));
  EXPECT_EQ(file->axes[2].line, 6);
}

TEST(SweepFile, RefusesUnknownWordsWithLineAndNearest) {
  const std::string base = kSmall;
  EXPECT_EQ(refusal("name = \"a\"\nbackent = \"slurm\"\n"),
            "s.toml:2: unknown key 'backent'; did you mean 'backend'?");
  EXPECT_EQ(refusal(base + "sead = 3\n"), "s.toml:10: unknown setting 'sead'; did you mean 'seed'?");
  EXPECT_EQ(refusal(base + "[slurm]\npartitoin = \"gpu\"\n"),
            "s.toml:11: unknown key 'partitoin' in [slurm]; did you mean 'partition'?");
  EXPECT_THAT(refusal(base + "[local]\nat_onec = 2\n"),
              StartsWith("s.toml:11: unknown key 'at_onec' in [local]"));
  EXPECT_THAT(refusal("name = \"a\"\nbackend = \"slrm\"\n[axes]\nseed = [1]\n"),
              HasSubstr("s.toml:2: unknown backend 'slrm'; did you mean 'slurm'?"));
  EXPECT_THAT(refusal("name = \"a\"\n[axes]\nalgo = [\"ippo\",\n \"mapo\"]\n"),
              AllOf(HasSubstr("s.toml:4"), HasSubstr("did you mean 'mappo'?")));
}

TEST(SweepFile, ReportsWhereResultsAreKept) {
  const std::string base = kSmall;
  const Expected<SweepFile> file =
      parse_sweep_file(base + "[results]\nfolder = \"kept\"\nepisodes = 7\ngreedy = true\n", "s.toml");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->results.folder, "kept");
  EXPECT_EQ(file->results.episodes, 7);
  EXPECT_EQ(file->results.seed, 5000);
  EXPECT_TRUE(file->results.greedy);
  EXPECT_EQ(refusal(base + "[results]\nepisodes = 7\n"),
            "s.toml:10: [results] names no folder; add a line: folder = \"results\"");
  EXPECT_EQ(refusal(base + "[results]\nfolder = \"k\"\ngreedy = 1\n"),
            "s.toml:12: greedy must be true or false");
  EXPECT_THAT(refusal(base + "[results]\nfolder = \"k\"\nepisodes = 1\n"),
              StartsWith("s.toml:12: episodes must be a whole number between 2"));
}

TEST(SweepFile, RefusesValuesThatCannotBe) {
  const auto axes = [](const std::string& lines) { return refusal("name = \"a\"\n[axes]\n" + lines); };
  EXPECT_THAT(axes("seed = 42\n"), StartsWith("s.toml:3: seed must be a list"));
  EXPECT_THAT(axes("seed = []\n"), StartsWith("s.toml:3: seed has no values"));
  EXPECT_THAT(axes("seed = [1, 2,\n1]\n"), StartsWith("s.toml:4: seed has the value 1 twice"));
  EXPECT_THAT(axes("seed = [-1]\n"), AllOf(StartsWith("s.toml:3: "), HasSubstr("at least 0")));
  EXPECT_THAT(axes("seed = [{a = 1}]\n"), StartsWith("s.toml:3: seed is neither"));
  EXPECT_THAT(axes("seed = [1]\nexperiment = [\"x\"]\n"),
              StartsWith("s.toml:4: experiment is what the sweep gives"));
  EXPECT_THAT(axes("seed = [1]\n[settings]\nseed = 3\n"),
              StartsWith("s.toml:5: seed is set in line 3 already"));
  EXPECT_THAT(axes("lr = [1e-3]\nlearning_rate = [1e-4]\n"), HasSubstr("already"));  // by its old name
  EXPECT_THAT(axes("seed = [1]\nseed = [2]\n"), StartsWith("s.toml:4: "));
  EXPECT_THAT(refusal("[axes]\nseed = [1]\n"), HasSubstr("no name"));
  EXPECT_THAT(refusal("name = \"a/b\"\n[axes]\nseed = [1]\n"), StartsWith("s.toml:1: the name 'a/b' cannot"));
  EXPECT_THAT(refusal("name = \"a\"\n"), HasSubstr("nothing to sweep"));
  EXPECT_THAT(axes("seed = [1]\n[slurm]\nsignal_before_s = 1\n"), HasSubstr("between 15 and 65535"));
  EXPECT_THAT(axes("seed = [1]\n[slurm]\nsetup = [\"a\\nb\"]\n"), HasSubstr("of one line"));
  EXPECT_THAT(axes("seed = [1]\n[resources]\nmemory_gb = -1\n"), HasSubstr("above 0"));
  EXPECT_THAT(axes("seed = [1]\n[[exclude]]\nalgo = \"ippo\"\n"), HasSubstr("algo is not in [axes]"));
  EXPECT_THAT(axes("seed = [41]\n[[exclude]]\nseed = 42\n"),
              StartsWith("s.toml:5: seed 42 is not in [axes]"));
  EXPECT_THAT(axes("seed = [41]\n[[exclude]]\n"), HasSubstr("names no setting"));
  EXPECT_THAT(axes("seed = [41]\n[[override]]\nseed = 42\ngamma = 0.9\n"),
              StartsWith("s.toml:5: seed 42 is not in [axes]"));
  EXPECT_THAT(axes("seed = [41]\n[[override]]\nseed = 41\n"), HasSubstr("a setting that it changes"));
  EXPECT_THAT(axes("seed = [41]\n[[override]]\ngamma = 0.9\n"), HasSubstr("that chooses runs"));
  EXPECT_THAT(axes("seed = [41]\n[[override]]\nseed = 41\ngama = 0.9\n"), HasSubstr("gamma"));
}

TEST(SweepPlan, IsTheProductOfTheAxesWithNamesThatSayWhatRunsAre) {
  const SweepPlan plan = plan_of(kSmall);
  EXPECT_THAT(names_of(plan),
              ElementsAre("field_ippo_seed42", "field_ippo_seed68", "field_qmix_seed42", "field_qmix_seed68",
                          "pit_ippo_seed42", "pit_ippo_seed68", "pit_qmix_seed42", "pit_qmix_seed68"));
  EXPECT_EQ(plan.runs[0].goal_env_frames, 1e6);
  EXPECT_EQ(plan.cores, 4);
  const std::vector<std::string> words = plan.runs[2].command("comrad", "/tmp/study");
  EXPECT_THAT(words,
              testing::IsSupersetOf({"train", "/tmp/study", "field_qmix_seed42", "--algo=qmix", "--seed=42",
                                     "--preset=small", "--num_workers=4", "--replay_gb=2.0"}));
  EXPECT_EQ(std::ranges::count(plan.runs[0].command("comrad", "/tmp"), "--replay_gb=2.0"),
            0);  // ippo has none
}

TEST(SweepPlan, LeavesOutWhatIsExcluded) {
  const SweepPlan plan = plan_of(std::string(kSmall) +
                                 "[[exclude]]\nscenario = \"pit\"\nalgo = \"qmix\"\n"
                                 "[[exclude]]\nscenario = \"field\"\nseed = [42, 68]\nalgo = \"Qmix\"\n");
  EXPECT_THAT(names_of(plan),
              ElementsAre("field_ippo_seed42", "field_ippo_seed68", "pit_ippo_seed42", "pit_ippo_seed68"));
  EXPECT_THAT(
      plan_refusal(
          "name = \"a\"\n[axes]\nseed = [1]\n[settings]\nscenario = \"field\"\n[[exclude]]\nseed = 1\n"),
      HasSubstr("leaves no run"));
}

TEST(SweepPlan, OverridesSettingsOfSomeRunsAndTheLastOneWins) {
  const SweepPlan plan =
      plan_of(std::string(kSmall) +
              "[[override]]\nalgo = [\"qmix\"]\ntrain_for_env_frames = 2e6\n"
              "[[override]]\nalgo = \"qmix\"\nscenario = \"pit\"\ntrain_for_env_frames = 3e6\n");
  std::vector<double> goals;
  for (const SweepRun& run : plan.runs) goals.push_back(run.goal_env_frames);
  EXPECT_THAT(goals, ElementsAre(1e6, 1e6, 2e6, 2e6, 1e6, 1e6, 3e6, 3e6));
}

TEST(SweepPlan, RefusesPairsThatCannotRunWithTheirLine) {
  EXPECT_THAT(plan_refusal("name = \"a\"\n[axes]\nscenario = [\"field\",\n\"feild\"]\n"),
              StartsWith("s.toml:4: unknown scenario 'feild'; did you mean 'field'?"));
  // qmix mixes the values of two agents: the pair is refused, and how many more there are.
  const std::string alone =
      "name = \"a\"\n[axes]\nscenario = [\"field\"]\nalgo = [\"ippo\", \"qmix\"]\nseed = [1, 2]\n"
      "[settings]\nnum_agents = 1\n";
  EXPECT_THAT(plan_refusal(alone), AllOf(StartsWith("s.toml:7: field_qmix_seed1 cannot run: num_agents is 1"),
                                         HasSubstr("and 1 more runs")));
  EXPECT_EQ(plan_refusal(alone + "[[exclude]]\nalgo = \"qmix\"\n"), "accepted");
  EXPECT_THAT(plan_refusal("name = \"a\"\n[axes]\nscenario = [\"field\"]\nnum_agents = [2, 7]\n"),
              AllOf(StartsWith("s.toml:4: "), HasSubstr("supports 1, 2 agents")));
  EXPECT_THAT(
      plan_refusal("name = \"a\"\n[axes]\nwad = [\"/no/such.wad\"]\n[settings]\nscenario = \"field\"\n"),
      HasSubstr("/no/such.wad"));
  EXPECT_THAT(plan_refusal("name = \"a\"\nbackend = \"slurm\"\n[axes]\nscenario = [\"field\"]\n"),
              HasSubstr("[resources] cores"));
}

TEST(SweepPlan, TwoRunsOfOneNameAreRefused) {
  EXPECT_EQ(sweep_run_name({{.setting = "scenario", .values = {}, .lines = {}},
                            {.setting = "replay_file", .values = {}, .lines = {}}},
                           {"/my/field", "a/b"}),
            "field_replay_filea-b");
  EXPECT_THAT(
      plan_refusal(
          "name = \"a\"\n[axes]\nreplay_file = [\"a/b\", \"a-b\"]\n[settings]\nscenario = \"field\"\n"),
      HasSubstr("two runs would be called"));
}

constexpr const char* kSearch = R"(
name = "study"
[settings]
scenario = "field"
train_for_env_frames = 1e6
[search]
method = "tpe"
trials = 3
seed = 7
[search.space]
learning_rate = {low = 1e-5, high = 1e-3, log = true}
rollout = {low = 16, high = 64, step = 16}
exploration_loss = ["entropy", "symmetric_kl"]
)";

/// kSearch with the first `part` replaced.
std::string search_with(const std::string& part, const std::string& by) {
  std::string text = kSearch;
  return text.replace(text.find(part), part.size(), by);
}

/// A population with `lines` in its [search] and `space` in its [search.space].
std::string population(const std::string& lines, const std::string& space) {
  return "name = \"a\"\n[settings]\nscenario = \"field\"\ntrain_for_env_frames = 1e5\n[search]\nmethod = "
         "\"pbt\"\n" +
         lines + "\n[search.space]\n" + space + "\n";
}

TEST(SweepSearch, IsReadWithItsSpaceInTheOrderOfTheFile) {
  const Expected<SweepFile> file = parse_sweep_file(kSearch, "s.toml");
  ASSERT_TRUE(file) << file.error().message;
  const SweepSearch& search = file->search;
  EXPECT_EQ(search.method, SearchMethod::kTpe);
  EXPECT_EQ(search.runs, 3);
  ASSERT_EQ(search.space.size(), 3u);
  EXPECT_EQ(search.space[0].words(), "1e-05 to 0.001 (log)");
  EXPECT_EQ(search.space[1].words(), "16 to 64 in steps of 16");
  EXPECT_EQ(search.space[2].words(), "entropy or symmetric_kl");
  const Expected<SweepSearch> again = search_from_json(to_json(search));
  ASSERT_TRUE(again);
  EXPECT_EQ(to_json(*again), to_json(search));
  EXPECT_EQ(search.space[1].text(39), "32");
  EXPECT_EQ(search.space[1].text(1e9), "64");
  EXPECT_TRUE(search.space[1].holds("48"));
  for (const char* value : {"65", "16.5", "", "nan", "inf", "x", "16x"})
    EXPECT_FALSE(search.space[1].holds(value)) << value;
  EXPECT_FALSE(search.space[2].holds("none"));
}

TEST(SweepSearch, RefusesWhatCannotBeWithItsLine) {
  EXPECT_THAT(refusal(search_with("\"tpe\"", "\"tpf\"")),
              StartsWith("s.toml:6: unknown method of [search] 'tpf'; did you mean 'tpe'?"));
  EXPECT_THAT(refusal(search_with("trials = 3", "members = 3")),
              StartsWith("s.toml:8: unknown key 'members' in [search]"));
  EXPECT_THAT(refusal(search_with("trials = 3", "")),
              HasSubstr("lacks the number of runs; add a line: trials = 20"));
  EXPECT_THAT(refusal(search_with("trials = 3", "trials = 0")),
              StartsWith("s.toml:8: trials must be a whole number between 1"));
  EXPECT_THAT(refusal(search_with("seed = 7", "seed = -1")), StartsWith("s.toml:9: seed must be"));
  const auto range = [](const std::string& text) {
    return refusal(search_with("{low = 16, high = 64, step = 16}", text));
  };
  EXPECT_EQ(range("{low = 16, hihg = 64}"),
            "s.toml:12: unknown key 'hihg' in [search.space.rollout]; did you mean 'high'?");
  EXPECT_EQ(range("{low = 16}"), "s.toml:12: rollout needs two numbers: {low = ..., high = ...}");
  EXPECT_EQ(range("{low = 64, high = 16}"), "s.toml:12: rollout: low must be below high");
  EXPECT_THAT(range("{low = 0, high = 16}"), StartsWith("s.toml:12: rollout is 0; it must be"));
  EXPECT_THAT(range("{low = 1, high = 1e18}"), StartsWith("s.toml:12: "));
  EXPECT_THAT(range("{low = 1.5, high = 16}"), StartsWith("s.toml:12: "));
  EXPECT_THAT(range("{low = 16, high = 64, step = 0}"), HasSubstr("step must be a number above 0"));
  EXPECT_THAT(range("{low = 16, high = 64, step = 7.5}"), HasSubstr("so must its step be"));
  EXPECT_THAT(range("{low = 16, high = 64, step = 17}"), HasSubstr("low and a whole number of steps"));
  EXPECT_THAT(range("{low = 16, high = 64, step = 16, log = true}"), HasSubstr("both log and step"));
  EXPECT_THAT(range("{low = nan, high = 64}"), StartsWith("s.toml:12: "));
  EXPECT_THAT(range("3"), StartsWith("s.toml:12: rollout must be a range"));
  EXPECT_THAT(range("[32]"), StartsWith("s.toml:12: rollout has one value; put it in [settings]"));
  EXPECT_THAT(range("[32, 32]"), HasSubstr("twice"));
  EXPECT_THAT(refusal(search_with("[\"entropy\", \"symmetric_kl\"]", "{low = 1, high = 2}")),
              StartsWith("s.toml:13: exploration_loss is no number; give it a list"));
  EXPECT_THAT(refusal(search_with("symmetric_kl", "symetric_kl")), HasSubstr("s.toml:13: "));
  EXPECT_THAT(refusal(search_with("rollout =", "rolout =")), HasSubstr("did you mean 'rollout'?"));
  EXPECT_THAT(refusal(search_with("rollout =", "train_for_env_frames =")), HasSubstr("already"));
  EXPECT_THAT(refusal(search_with("rollout =", "seed =")), StartsWith("s.toml:12: seed is not searched"));
  EXPECT_THAT(refusal(search_with("[search.space]", "[search.spice]")), HasSubstr("did you mean 'space'?"));
  EXPECT_THAT(refusal("name = \"a\"\n[search]\nmethod = \"random\"\ntrials = 2\n"),
              HasSubstr("nothing to search"));
  EXPECT_THAT(refusal(std::string(kSearch) + "[results]\nfolder = \"k\"\n"),
              HasSubstr("[results] cannot be had with [search]"));
  const std::string every = "members = 4\nevery_env_frames = 1e4\n";
  EXPECT_EQ(refusal(population(every, "gamma = [0.9, 0.99]")), "accepted");
  EXPECT_THAT(refusal(population(every, "rnn_size = [64, 128]")),
              StartsWith("s.toml:11: rnn_size cannot change in a run"));
  EXPECT_THAT(refusal(population(every, "rollout = [16, 32]")), HasSubstr("cannot change in a run"));
  EXPECT_THAT(refusal(population("members = 4", "gamma = [0.9, 0.99]")), HasSubstr("needs every_env_frames"));
  EXPECT_THAT(refusal(population("members = 1\nevery_env_frames = 1e4", "gamma = [0.9, 0.99]")),
              HasSubstr("between 2 and"));
  EXPECT_THAT(refusal(population(every + "quantile = 0.6", "gamma = [0.9, 0.99]")), HasSubstr("at most 0.5"));
  for (const char* factors : {"[]", "[0]", "[1.2, \"a\"]", "1.2", "[1e9]"})
    EXPECT_THAT(refusal(population(every + "perturb = " + factors, "gamma = [0.9, 0.99]")),
                HasSubstr("a list of 1 to 16 factors"))
        << factors;
  EXPECT_THAT(refusal(population(every + "resample_probability = 2", "gamma = [0.9, 0.99]")),
              HasSubstr("between 0.0 and 1.0"));
}

TEST(SweepSearch, MakesItsTrialsOfEachCombination) {
  const SweepPlan plan = plan_of(std::string(kSearch) + "[axes]\nseed = [1, 2]\n");
  EXPECT_THAT(names_of(plan), ElementsAre("seed1_trial_001", "seed1_trial_002", "seed1_trial_003",
                                          "seed2_trial_001", "seed2_trial_002", "seed2_trial_003"));
  EXPECT_EQ(plan.runs[4].study, "seed2");
  EXPECT_EQ(plan.runs[4].number, 2);
  EXPECT_THAT(plan.runs[4].command("comrad", "/tmp", {{"seed", "9"}, {"gamma", "0.9"}}),
              testing::AllOf(testing::IsSupersetOf({"seed2_trial_002", "--seed=9", "--gamma=0.9"}),
                             Not(testing::Contains("--seed=2"))));
  const SweepPlan alone = plan_of(kSearch);
  EXPECT_THAT(names_of(alone), ElementsAre("trial_001", "trial_002", "trial_003"));
  EXPECT_EQ(alone.runs[0].study, "study");
  EXPECT_EQ(alone.extremes.size(), 2u + 2 + 2);
  const SweepPlan members = plan_of(population("members = 3\nevery_env_frames = 1e4", "gamma = [0.9, 0.99]"));
  EXPECT_THAT(names_of(members), ElementsAre("member_1", "member_2", "member_3"));
  EXPECT_THAT(members.runs[2].command("comrad", "/tmp"),
              testing::Contains("--seed=44"));  // its own weights
}

TEST(SweepSearch, RefusesWhatAnyOfItsRunsCouldNotDo) {
  EXPECT_EQ(plan_refusal(kSearch), "accepted");
  EXPECT_THAT(plan_refusal(search_with("exploration_loss = [\"entropy\", \"symmetric_kl\"]",
                                       "td_lambda = {low = 0.1, high = 0.9}")),
              AllOf(StartsWith("s.toml:13: "), HasSubstr("td_lambda has no effect")));
  EXPECT_THAT(
      plan_refusal(search_with("exploration_loss = [\"entropy\", \"symmetric_kl\"]", "num_agents = [2, 7]")),
      AllOf(StartsWith("s.toml:13: "), HasSubstr("with num_agents=7"), HasSubstr("supports 1, 2 agents")));
  const std::string every = "members = 4\nevery_env_frames = ";
  EXPECT_THAT(plan_refusal(population(every + "1e5", "gamma = [0.9, 0.99]")),
              AllOf(StartsWith("s.toml:4: "), HasSubstr("pbt decides first at 1e+05")));
  EXPECT_THAT(plan_refusal(population(every + "1e4", "lr_schedule = [\"constant\", \"linear_decay\"]")),
              HasSubstr("lr_schedule is linear_decay, which would reach 0"));
  EXPECT_THAT(plan_refusal(population(every + "1e4",
                                      "learning_rate = {low = 1e-5, high = 1e-3}\nlr_schedule = "
                                      "[\"constant\", \"kl_adaptive_epoch\"]")),
              AllOf(StartsWith("s.toml:11: "), HasSubstr("continues at the rate of its checkpoint")));
  EXPECT_THAT(plan_refusal(search_with("trials = 3", "trials = 10000") + "[axes]\nseed = [1, 2]\n"),
              HasSubstr("more than 10000"));
}

TEST(LocalSlots, GiveEveryRunSeparateCoresAndCheckTheSums) {
  SweepPlan plan =
      plan_of(std::string(kSmall) + "[resources]\ncores = 2\nmemory_gb = 3\n[local]\nat_once = 2\n");
  const std::vector<int> cpus = {1, 3, 5, 7, 9};
  const auto slots = local_slots(plan, 8, cpus, 5, 10'000'000'000, {});
  ASSERT_TRUE(slots) << slots.error().message;
  ASSERT_EQ(slots->size(), 2u);
  EXPECT_THAT((*slots)[0].cpus, ElementsAre(1, 3));
  EXPECT_THAT((*slots)[1].cpus, ElementsAre(5, 7));
  EXPECT_EQ(local_slots(plan, 1, cpus, 5, 10'000'000'000, {})->size(), 1u);  // one run is left to make
  EXPECT_THAT(
      local_slots(plan, 8, cpus, 3, 10'000'000'000, {}).error().message,
      HasSubstr("2 runs at once of 2 cores need 4, this process may use 3"));  // the control group's quota
  EXPECT_THAT(local_slots(plan, 8, cpus, 5, 5'000'000'000, {}).error().message,
              HasSubstr("2 runs at once of 3.0 GB need 6.0 GB, 5.0 GB is free"));
  plan.file.resources.gpus = 1;
  EXPECT_THAT(local_slots(plan, 8, cpus, 5, 10'000'000'000, {"0"}).error().message, HasSubstr("GPUs need 2"));
  EXPECT_EQ((*local_slots(plan, 8, cpus, 5, 10'000'000'000, {"4", "6"}))[1].gpus, "6");
}

TEST(SweepElement, ReportsWhatAnAttemptCameTo) {
  RunRecord begun;
  begun.env_frames_at_start = 1000;
  const auto state = [&](ExitStatus how, bool was_stopped, const char* status, double frames, bool slurm) {
    return judge_attempt(begun, how, was_stopped, status, frames, "why", slurm).state;
  };
  EXPECT_EQ(state({.code = 0}, false, "finished", 5000, false), RunState::kFinished);
  EXPECT_EQ(state({.code = 0}, true, "paused", 5000, false), RunState::kInterrupted);
  EXPECT_EQ(state({.code = 2}, false, "failed", 5000, true), RunState::kFailed);
  EXPECT_EQ(state({.signal = 9}, false, "running", 5000, false), RunState::kFailed);
  EXPECT_EQ(state({.signal = 9}, false, "running", 5000, true), RunState::kInterrupted);
  EXPECT_EQ(state({.signal = 9}, false, "running", 1000, true),
            RunState::kFailed);  // it would go round for ever
  EXPECT_EQ(quoted_error({"a", "comrad train: error: no room", "b"}), "no room");
  EXPECT_EQ(quoted_error({"a", "b"}), "b");
}

TEST(SlurmQueue, IsReadByJobNameAndElement) {
  const QueuedElements queued = parse_queue(
      "s.1.ab|0|RUNNING\ns.1.ab|1|PENDING\nother|0|RUNNING\ns.2.ab|0|COMPLETING\ns.2.ab|7|PENDING\nrubbish\n",
      {{"s.1.ab", {"x", "y"}}, {"s.2.ab", {"z"}}});
  EXPECT_THAT(queued.running_runs, ElementsAre("x"));
  EXPECT_THAT(queued.pending_runs, ElementsAre("y"));
}

TEST(SweepEstimate, GroupsRunsThatDifferInSeedAndScenarioAlone) {
  const SweepPlan plan = plan_of(std::string(kSmall) + "[local]\nat_once = 2\n");
  std::vector<EstimateGroup> groups = estimate_groups(plan);
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[1].label, "qmix");
  EXPECT_EQ(groups[1].run_count, 4u);
  groups[0].env_frames_per_s = 1000, groups[1].env_frames_per_s = 500;
  const std::string text = estimate_text(groups, plan);  // 4 M frames each: 4000 s and 8000 s
  EXPECT_THAT(text, AllOf(HasSubstr("3.3 hours one after the other"), HasSubstr("1.7 with 2 at once")));
}

TEST(BenchmarkSweep, IsThePapersMatrix) {
  const std::string path = std::string(COMRAD_SOURCE_DIR) + "/deploy/sweeps/benchmark.toml";
  const Expected<SweepFile> file = read_sweep_file(path);
  ASSERT_TRUE(file) << file.error().message;
  const auto any = [](RunConfig config) {
    config.run.scenario = "field";
    return describe(config);
  };
  const Expected<SweepPlan> plan = plan_sweep(*file, any, 16);
  ASSERT_TRUE(plan) << plan.error().message;
  EXPECT_EQ(plan->runs.size(), 13u * 8 * 5);
  for (const std::string& scenario : file->axes[0].values)
    EXPECT_TRUE(
        std::filesystem::exists(std::string(COMRAD_SOURCE_DIR) + "/scenarios/" + scenario + "/scenario.toml"))
        << scenario;
  for (const SweepRun& run : plan->runs) EXPECT_EQ(run.goal_env_frames, 1e8) << run.name;
}

}  // namespace sweep_file_test
}  // namespace comrad::deploy
