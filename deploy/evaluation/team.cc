#include "deploy/evaluation/team.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <set>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

Error bad(const std::string& message) { return Error{ErrorCode::kBadInput, message}; }

/// Agent index -> player's name.
Expected<std::map<int, std::string>> read_seats(const std::vector<std::string>& typed) {
  std::map<int, std::string> seats;
  for (const std::string& text : typed) {
    const std::size_t equals = text.find('=');
    int seat = -1;
    const char* const end = text.data() + std::min(equals, text.size());
    const auto number = std::from_chars(text.data(), end, seat);
    if (equals == std::string::npos || equals + 1 == text.size() || number.ec != std::errc() ||
        number.ptr != end || seat < 0)
      return bad("--seat=" + text + ": write AGENT=PLAYER, the agent counted from 0, as 1=oracle");
    if (!seats.emplace(seat, text.substr(equals + 1)).second)
      return bad(fmt::format("--seat={}: seat {} was named before", text, seat));
  }
  return seats;
}

Team make_team(std::vector<std::string> players) {
  Team team{.name = "", .players = std::move(players)};
  if (team.is_uniform()) {
    team.name = team.players.front();
    return team;
  }
  for (std::size_t seat = 0; seat < team.players.size(); ++seat)
    team.name += fmt::format("{}{}={}", (seat == 0 ? "" : ","), seat, team.players[seat]);
  return team;
}

}  // namespace

bool Team::is_uniform() const {
  return std::ranges::all_of(players,
                             [this](const std::string& player) { return player == players.front(); });
}

Status check_teams(const EvaluationRequest& request) {
  if (!request.cross_play.empty()) {
    if (!request.policies.empty() || !request.seats.empty())
      return bad("--cross_play names all players itself; leave --policy and --seat out");
    if (request.cross_play.size() < 2)
      return bad("--cross_play=" + request.cross_play.front() +
                 ": at least two players meet, as --cross_play RUN_A,RUN_B");
    const std::set<std::string> distinct(request.cross_play.begin(), request.cross_play.end());
    if (distinct.size() < request.cross_play.size())
      return bad("--cross_play=" + joined(request.cross_play, ",") + ": a player is named twice");
  } else if (request.policies.empty() && request.seats.empty()) {
    return bad("--policy is missing; give --policy random, oracle, noop or RUN");
  }
  const Expected<std::map<int, std::string>> seats = read_seats(request.seats);
  if (!seats) return seats.error();
  if (!request.checkpoint.empty() && request.policies.size() != 1)
    return bad(
        "--checkpoint is that of one --policy; where there are several players, name each by the path of its "
        "file, "
        "as RUN/checkpoint/best_12.5.pt");
  return {};
}

std::vector<std::string> player_names(const EvaluationRequest& request) {
  std::vector<std::string> names;
  const auto add = [&names](const std::string& name) {
    if (std::ranges::find(names, name) == names.end()) names.push_back(name);
  };
  for (const std::string& name : request.policies) add(name);
  for (const std::string& seat : request.seats) add(seat.substr(seat.find('=') + 1));
  for (const std::string& name : request.cross_play) add(name);
  return names;
}

Expected<std::vector<Team>> make_teams(const EvaluationRequest& request, int num_agents) {
  const auto agents = static_cast<std::size_t>(num_agents);
  std::vector<Team> teams;
  if (!request.cross_play.empty()) {
    if (agents < 2)
      return bad("--cross_play: this team has one agent, so there is no partner to cross-play with");
    for (const std::string& row : request.cross_play)
      for (const std::string& column : request.cross_play) {
        std::vector<std::string> players(agents, column);
        players.front() = row;
        teams.push_back(make_team(std::move(players)));
      }
    return teams;
  }
  COMRAD_TRY_ASSIGN(const auto seats, read_seats(request.seats));
  for (const auto& [seat, player] : seats)
    if (seat >= num_agents)
      return bad(fmt::format("--seat={}={}: the team has {} agents, 0 to {}", seat, player, num_agents,
                             num_agents - 1));
  // comrad play names a player for the remaining agents, whether or not there are any.
  if (seats.size() == agents && !request.policies.empty() && request.page.empty())
    return bad("--seat names a player for every agent, so --policy has none to play; leave it out");
  const std::vector<std::string> others =
      request.policies.empty() ? std::vector<std::string>{""} : request.policies;
  for (const std::string& other : others) {
    std::vector<std::string> players;
    for (int seat = 0; seat < num_agents; ++seat) {
      const auto named = seats.find(seat);
      players.push_back(named == seats.end() ? other : named->second);
      if (players.back().empty())
        return bad(
            fmt::format("seat {} of {} has no player; add --seat {}=PLAYER, or --policy PLAYER for all seats "
                        "that are not named",
                        seat, num_agents, seat));
    }
    teams.push_back(make_team(std::move(players)));
  }
  return teams;
}

}  // namespace comrad::deploy
