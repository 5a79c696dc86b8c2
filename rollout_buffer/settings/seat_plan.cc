#include "rollout_buffer/settings/seat_plan.h"

#include <spdlog/fmt/fmt.h>

#include <toml++/toml.h>

#include <algorithm>
#include <optional>
#include <sstream>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/toml_text.h"

namespace comrad {
namespace {

template <typename Matches>
std::vector<int> seats_where(const SeatPlan& plan, Matches&& matches) {
  std::vector<int> found;
  for (std::size_t seat = 0; seat < plan.seats.size(); ++seat)
    if (matches(plan.seats[seat])) found.push_back(static_cast<int>(seat));
  return found;
}

}  // namespace

std::vector<int> SeatPlan::seats_of(SeatPlayer player) const {
  return seats_where(*this, [player](const Seat& seat) { return seat.player == player; });
}

std::vector<int> SeatPlan::seats_of_network(int network) const {
  return seats_where(*this, [network](const Seat& seat) { return seat.network == network; });
}

std::string seat_plan_text(const SeatPlan& plan) {
  toml::array networks, seats;
  for (const SeatNetwork& network : plan.networks)
    networks.push_back(toml::table{{"settings", network.settings}, {"checkpoint", network.checkpoint}});
  for (const Seat& seat : plan.seats) {
    toml::table one{{"player", word_of(seat.player)}};
    if (seat.player == SeatPlayer::kNetwork) one.insert("network", seat.network);
    seats.push_back(std::move(one));
  }
  std::ostringstream text;
  text << toml::table{{"network", std::move(networks)}, {"seat", std::move(seats)}} << "\n";
  return std::move(text).str();
}

Expected<SeatPlan> parse_seat_plan(std::string_view text, const std::string& label) {
  const auto bad = [&](const std::string& what) { return Error{ErrorCode::kBadFormat, label + ": " + what}; };
  COMRAD_TRY(check_toml_text(text, label));
  SeatPlan plan;
  try {
    const toml::table document = toml::parse(text, label);
    if (const toml::array* networks = document["network"].as_array())
      for (const toml::node& node : *networks) {
        const toml::table* one = node.as_table();
        const auto settings = one == nullptr ? std::nullopt : (*one)["settings"].value<std::string>();
        const auto checkpoint = one == nullptr ? std::nullopt : (*one)["checkpoint"].value<std::string>();
        if (!settings || !checkpoint)
          return bad(
              fmt::format("network {} needs the texts 'settings' and 'checkpoint'", plan.networks.size()));
        plan.networks.push_back({*settings, *checkpoint});
      }
    const toml::array* seats = document["seat"].as_array();
    if (seats == nullptr || seats->empty()) return bad("lists no seats");
    for (const toml::node& node : *seats) {
      const std::string where = fmt::format("seat {}", plan.seats.size());
      const toml::table* one = node.as_table();
      const auto player = one == nullptr ? std::nullopt : (*one)["player"].value<std::string>();
      if (!player) return bad(where + " needs the text 'player'");
      const auto& words = Words<SeatPlayer>::words;
      const auto word = std::find(words.begin(), words.end(), *player);
      if (word == words.end()) return bad(where + ": there is no player '" + *player + "'");
      Seat seat{static_cast<SeatPlayer>(word - words.begin()), -1};
      if (seat.player == SeatPlayer::kNetwork) {
        seat.network = (*one)["network"].value_or(-1);
        if (seat.network < 0 || seat.network >= static_cast<int>(plan.networks.size()))
          return bad(fmt::format("{}: it has no network of the {} listed", where, plan.networks.size()));
      }
      plan.seats.push_back(seat);
    }
  } catch (const toml::parse_error& failure) {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: {}", label, failure.source().begin.line,
                                                    failure.source().begin.column, failure.description())};
  }
  return plan;
}

Expected<SeatPlan> read_seat_plan(const std::string& run_dir, int num_agents) {
  const std::string path = run_dir + "/" + kSeatPlanFile;
  const std::optional<std::string> text = read_file(path);
  if (!text)
    return Error{ErrorCode::kNotFound, path + ": cannot be read; `comrad eval` writes it for its workers"};
  COMRAD_TRY_ASSIGN(SeatPlan plan, parse_seat_plan(*text, path));
  if (plan.seats.size() != static_cast<std::size_t>(num_agents))
    return Error{ErrorCode::kBadFormat, fmt::format("{}: lists {} seats, the team has {} agents", path,
                                                    plan.seats.size(), num_agents)};
  return plan;
}

}  // namespace comrad
