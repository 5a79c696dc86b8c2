#include "deploy/watch/watch_flags.h"

#include <algorithm>
#include <cmath>

#include "deploy/evaluation/video_request.h"
#include "deploy/settings/output_check.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

constexpr std::size_t kTokenLengthMin = 16, kTokenLengthMax = 128;

bool is_token(const std::string& text) {
  return std::ranges::all_of(text, [](char letter) {
    return (letter >= '0' && letter <= '9') || (letter >= 'a' && letter <= 'z') ||
           (letter >= 'A' && letter <= 'Z') || letter == '-' || letter == '_';
  });
}

}  // namespace

void PageFlags::add_to(CommandLine& line) {
  line.add_option("size", size, "WxH",
                  "of one agent's view (default 640x360); the network still sees 128x72");
  line.add_option("port", port, "N", "of the page (default: any that is free)");
  line.add_option(
      "interface", interface, "ADDRESS",
      "IPv4 address to listen on (default 127.0.0.1); another one needs --token, and what it carries "
      "is not encrypted");
  line.add_option("token", token, "WORD", "that the page's address holds (default: a new one each time)");
  line.add_switch("no_browser", no_browser, "print the address and open nothing");
}

Status PageFlags::check(LivePageOptions& options) const {
  COMRAD_TRY(check_view_size(size));
  if (!(port >= 0 && port <= 65535) || port != std::floor(port))
    return bad_value("port", real_text(port), "write a port from 1 to 65535, or 0 for any that is free");
  if (!token.empty() &&
      (token.size() < kTokenLengthMin || token.size() > kTokenLengthMax || !is_token(token)))
    return bad_value("token", token, "write 16 to 128 letters, digits, - and _");
  if (interface != "127.0.0.1" && token.empty())
    return bad_value(
        "interface", interface,
        "others can reach the page there; add --token WORD that they cannot guess, or stay on this "
        "machine and use ssh -L");
  options.address = interface;
  options.port = static_cast<int>(port);
  options.token = token;
  options.opens_browser = !no_browser;
  return {};
}

std::vector<std::string> settings_arguments(const CommandLine& line) {
  std::vector<std::string> arguments;
  for (const auto& [name, value] : line.typed().values) arguments.push_back("--" + name + "=" + value);
  if (!line.config_file().empty()) arguments.push_back("--config=" + line.config_file());
  return arguments;
}

}  // namespace comrad::deploy
