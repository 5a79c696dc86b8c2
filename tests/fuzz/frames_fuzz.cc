// What a peer of the link between hosts may send besides trajectories and weights: batches of frames and of actions, episodes,
// questions at the join endpoint and its offer. The first byte selects which.
#include <cmath>
#include <string>
#include <vector>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/link/frames/frame_stream.h"
#include "rollout_buffer/link/join/endpoint.h"
#include "rollout_buffer/link/session/serving_end.h"
#include "tests/fuzz/input.h"

namespace {

using namespace comrad;
using namespace comrad::fuzz;

constexpr uint32_t kEnvs = 4;

/// Requests whose numbers come from the input, cut off where the input selects it.
void feed_frames(Input& input, const SlabOffsets& offsets, std::vector<std::byte>& memory) {
  const SlabView slab(offsets, memory.data());
  std::vector<std::byte> batch;
  const uint8_t count = input.number<uint8_t>() % 8;
  for (uint8_t index = 0; index < count; ++index) {
    link::FrameRequest request;
    request.env_index = input.number<uint8_t>() % (kEnvs + 1);
    request.kind = input.number<uint8_t>() % 5;
    request.step = input.number<uint8_t>() % 7;
    request.final_row = input.number<uint8_t>() % 4;
    const std::size_t begin = batch.size();
    batch.resize(begin + link::bytes_of(request, offsets));
    std::memcpy(batch.data() + begin, &request, sizeof request);
    const std::span<const std::byte> body = input.bytes(input.number<uint8_t>());
    std::memcpy(batch.data() + begin + sizeof request, body.data(),
                std::min(body.size(), batch.size() - begin - sizeof request));
  }
  const std::span<const std::byte> tail = input.bytes(input.number<uint8_t>());
  batch.insert(batch.end(), tail.begin(), tail.end());
  // Its own block size: one byte beyond it and the address sanitizer speaks.
  const std::vector<std::byte> sent(
      batch.begin(), batch.end() - std::min<std::ptrdiff_t>(input.number<uint8_t>(), std::ssize(batch)));
  link::FrameUnpacker frames(offsets, kEnvs, sent);
  while (true) {
    const Expected<std::optional<link::FrameRequest>> request = frames.next();
    if (!request) return require(!request.error().message.empty());
    if (!*request) return;
    require((*request)->env_index < kEnvs && (*request)->step <= 4 && (*request)->kind <= link::kSealedKind);
    if ((*request)->kind == link::kSealedKind) continue;
    frames.copy_to(slab);
    if ((*request)->step == 0) continue;
    const int last = static_cast<int>((*request)->step) - 1;
    require(slab.final_index(last) >= -1 && slab.final_index(last) < offsets.shape.final_capacity &&
            std::isfinite(slab.reward(last, 0)));
  }
}

void feed_actions(Input& input, const EnvShape& shape) {
  const std::span<const std::byte> rest = input.rest();
  const std::vector<std::byte> sent(rest.begin(), rest.end());
  std::span<const std::byte> left = sent;
  std::vector<int32_t> choices(static_cast<std::size_t>(shape.num_agents * shape.head_count));
  while (true) {
    const Expected<std::optional<link::FrameAnswer>> answer = link::take_answer(left, shape, choices);
    if (!answer) return require(!answer.error().message.empty());
    if (!*answer) return;
    require(choices[0] >= 0 && choices[0] < shape.head_sizes[0]);
  }
}

void feed_episode(Input& input) {
  EpisodeRecord sent{.env_index = input.number<uint32_t>(),
                     .agent_count = input.number<uint8_t>() % 12u,
                     .score = input.number<float>(),
                     .ceiling = input.number<float>()};
  for (auto* list : {&sent.agent_return, &sent.agent_score})
    for (float& value : *list) value = input.number<float>();
  if (const auto record = link::own_episode(sent, input.number<int8_t>(), 2))
    require(std::isfinite(record->score) && std::isfinite(record->agent_return[0]));
}

void feed_door(Input& input) {
  static const link::JoinEndpoint kDoor(link::Offer{
      .scenario = "room", .files = {{.name = "layouts/map.wad", .path = "/dev/null", .bytes = 0}}});
  const std::span<const std::byte> rest = input.rest();
  const std::string text(reinterpret_cast<const char*>(rest.data()), rest.size());
  const dds::JoinAnswer answer = kDoor.answer({.peer_id = 1, .question_id = 1, .text = text});
  require(!answer.text.empty() || !answer.payload.empty());
}

void feed_offer(Input& input) {
  const std::span<const std::byte> rest = input.rest();
  const Expected<link::Offer> offer =
      link::parse_offer(std::string(reinterpret_cast<const char*>(rest.data()), rest.size()));
  if (!offer) return require(!offer.error().message.empty());
  for (const link::OfferedFile& file : offer->files)
    require(!file.name.empty() && file.name[0] != '/' && file.name[0] != '.' &&
            file.name.find("/.") == std::string::npos);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  static const SlabOffsets kOffsets(small_shape());
  static std::vector<std::byte> memory(static_cast<std::size_t>(kOffsets.slab_bytes));
  if (size == 0 || size > 1 << 14) return 0;
  Input input(data, size);
  switch (input.number<uint8_t>() % 5) {
    case 0:
      feed_frames(input, kOffsets, memory);
      break;
    case 1:
      feed_actions(input, kOffsets.shape.env);
      break;
    case 2:
      feed_episode(input);
      break;
    case 3:
      feed_door(input);
      break;
    default:
      feed_offer(input);
  }
  return 0;
}
