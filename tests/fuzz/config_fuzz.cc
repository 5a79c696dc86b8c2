// A ViZDoom .cfg.
#include "scenarios/spec/vizdoom_config.h"

#include "tests/fuzz/play.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  comrad::fuzz::be_quiet();
  if (size > 1 << 15) return 0;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto config = comrad::scenarios::parse_vizdoom_config(text, "fuzz.cfg");
  if (!config) comrad::fuzz::require(config.error().message.rfind("fuzz.cfg", 0) == 0);
  return 0;
}
