#include "policy_workers/worker/seat_networks.h"

#include <spdlog/fmt/fmt.h>

#include <cstring>
#include <utility>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::policy {

Expected<SeatNetworks> SeatNetworks::create(const std::string& run_dir, const shm::Arena& arena,
                                            torch::Device device) {
  const TrajectoryShape& shape = arena.shape().trajectory;
  COMRAD_TRY_ASSIGN(SeatPlan plan, read_seat_plan(run_dir, shape.env.num_agents));
  SeatNetworks networks(std::move(plan), shape.env);
  int64_t bytes = 0;
  for (std::size_t index = 0; index < networks.plan_.networks.size(); ++index) {
    COMRAD_TRY_ASSIGN(const RunConfig config, load_run_config(networks.plan_.networks[index].settings));
    const NetworkOptions options = NetworkOptions::from(config, shape.env);
    if (options.recurrent_state_count() > shape.recurrent_state_count)
      return Error{ErrorCode::kBadInput,
                   fmt::format("{}: the network has {} floats of recurrent state, the arena was made for {}",
                               networks.plan_.networks[index].settings, options.recurrent_state_count(),
                               shape.recurrent_state_count)};
    COMRAD_TRY(check_encoder(options.encoder, options.env));
    Player player{.net = ActorCritic::create_for_loading(options, device),
                  .agents = networks.plan_.seats_of_network(static_cast<int>(index)),
                  .rule = {}};
    if (config.run.algo->learns_q_values()) {
      player.rule.choice = SeatRule::Choice::kByQValues;
      player.rule.exploration =
          config.q_learning.epsilon_per_head ? Exploration::kPerHead : Exploration::kAllHeads;
    }
    bytes += static_cast<int64_t>(sizeof(float)) + player.net.weights_bytes();
    networks.players_.push_back(std::move(player));
  }
  if (bytes > arena.shape().weights_bytes)
    return Error{ErrorCode::kBadInput,
                 fmt::format("the weights of all seats need {} bytes, the arena holds {}", bytes,
                             arena.shape().weights_bytes)};
  return networks;
}

Status SeatNetworks::read_weights(std::span<const std::byte> bytes) {
  for (std::size_t index = 0; index < players_.size(); ++index) {
    Player& player = players_[index];
    const auto size = static_cast<std::size_t>(player.net.weights_bytes());
    if (bytes.size() < sizeof(float) + size)
      return Error{ErrorCode::kBadFormat,
                   fmt::format("the weights end within network {} of the seats", index)};
    std::memcpy(&player.rule.epsilon, bytes.data(), sizeof(float));
    COMRAD_TRY(player.net.read_weights(bytes.subspan(sizeof(float), size)));
    bytes = bytes.subspan(sizeof(float) + size);
  }
  if (!bytes.empty())
    return Error{ErrorCode::kBadFormat, fmt::format("{} bytes of weights belong to no seat", bytes.size())};
  return {};
}

PolicyOutput SeatNetworks::step(const Batch& batch) const {
  const int64_t rows = batch.row_count(), agents = env_.num_agents;
  PolicyOutput output{.logits = torch::zeros({rows, env_.logit_count()}),
                      .value = torch::zeros({rows}),
                      .recurrent_state = torch::zeros_like(batch.recurrent_state)};
  std::vector<const uint8_t*> frames;
  std::vector<int64_t> places;
  for (const Player& player : players_) {
    frames.clear();
    places.clear();
    for (int64_t world = 0; world < rows / agents; ++world)
      for (const int agent : player.agents) {
        places.push_back(world * agents + agent);
        frames.push_back(batch.frames[static_cast<std::size_t>(places.back())]);
      }
    const Tensor index = torch::tensor(places, torch::kInt64);
    const int64_t state_count = player.net.options().recurrent_state_count();
    const Tensor state = batch.recurrent_state.slice(1, 0, state_count).index_select(0, index);
    const PolicyOutput of_player = player.net.step_agents(
        frames, batch.measurement.defined() ? batch.measurement.index_select(0, index) : Tensor(), state,
        player.agents);
    output.logits.index_copy_(0, index, of_player.logits.to(torch::kCPU, torch::kFloat32));
    if (state_count > 0)
      output.recurrent_state.slice(1, 0, state_count)
          .index_copy_(0, index, of_player.recurrent_state.to(torch::kCPU, torch::kFloat32));
  }
  return output;
}

std::vector<SeatRule> SeatNetworks::rules() const {
  std::vector<SeatRule> rules;
  for (const Seat& seat : plan_.seats) {
    if (seat.player == SeatPlayer::kNetwork)
      rules.push_back(players_[static_cast<std::size_t>(seat.network)].rule);
    else
      rules.push_back({.choice = seat.player == SeatPlayer::kRandom ? SeatRule::Choice::kDrawn
                                                                    : SeatRule::Choice::kNothing});
  }
  return rules;
}

}  // namespace comrad::policy
