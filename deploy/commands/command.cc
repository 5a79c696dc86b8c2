#include "deploy/commands/command.h"

#include <cstdio>

namespace comrad::deploy {

int report_error(const std::string& command, const Error& error) {
  std::fprintf(stderr, "comrad %s: error: %s\n", command.c_str(), error.message.c_str());
  return exit_code(error);
}

}  // namespace comrad::deploy
