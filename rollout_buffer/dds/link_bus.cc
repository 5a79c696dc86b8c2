#include "rollout_buffer/dds/link_bus.h"

#include <spdlog/fmt/fmt.h>

#include "rollout_buffer/dds/cyclone_carrier.h"

namespace comrad::dds {
namespace {

/// `head` is the id of the question and the text.
template <typename Message>
Status write_join(LinkCarrier& carrier, Topic topic, const Message& message, std::string_view payload) {
  if (message.text.size() > kQuestionBytes)
    return Error{ErrorCode::kBadInput, fmt::format("a question's or answer's text of {} bytes; at most {}",
                                                   message.text.size(), kQuestionBytes)};
  std::vector<std::byte> head(sizeof message.question_id + message.text.size());
  std::memcpy(head.data(), &message.question_id, sizeof message.question_id);
  std::ranges::copy(std::as_bytes(std::span(message.text)), head.begin() + sizeof message.question_id);
  return carrier.write(topic, message.peer_id, head, std::as_bytes(std::span(payload)));
}

std::string text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

template <typename Message>
Message join_message(uint64_t key, std::span<const std::byte> head) {
  Message message{.peer_id = key};
  if (head.size() < sizeof message.question_id) return message;
  std::memcpy(&message.question_id, head.data(), sizeof message.question_id);
  message.text = text_of(head.subspan(sizeof message.question_id));
  return message;
}

}  // namespace

std::size_t whole_characters(std::string_view text, std::size_t most) {
  if (text.size() <= most) return text.size();
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xC0) == 0x80) --most;
  return most;
}

Expected<LinkBus> LinkBus::open(const BusConfig& config, uint32_t version) {
  COMRAD_TRY_ASSIGN(std::unique_ptr<LinkCarrier> carrier, open_cyclone_carrier(config, version));
  return LinkBus(std::move(carrier));
}

Status LinkBus::write(const JoinQuestion& question) {
  return write_join(*carrier_, Topic::kQuestion, question, "");
}
Status LinkBus::write(const JoinAnswer& answer) {
  return write_join(*carrier_, Topic::kAnswer, answer, answer.payload);
}

void LinkBus::take_questions(const std::function<void(const JoinQuestion&)>& visit) {
  carrier_->take(Topic::kQuestion,
                 [&](uint64_t key, std::span<const std::byte> head, std::span<const std::byte>) {
                   visit(join_message<JoinQuestion>(key, head));
                 });
}
void LinkBus::take_answers(const std::function<void(const JoinAnswer&)>& visit) {
  carrier_->take(Topic::kAnswer,
                 [&](uint64_t key, std::span<const std::byte> head, std::span<const std::byte> payload) {
                   auto answer = join_message<JoinAnswer>(key, head);
                   answer.payload = text_of(payload);
                   visit(answer);
                 });
}

}  // namespace comrad::dds
