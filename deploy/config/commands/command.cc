#include "deploy/config/commands/command.h"

#include <cstdio>

namespace comrad::deploy {

int report_error(const std::string& command, const Error& error) {
  std::fprintf(stderr, "comrad %s: error: %s\n", command.c_str(), error.message.c_str());
  switch (error.code) {
    case ErrorCode::kBadInput:
    case ErrorCode::kBadFormat:
    case ErrorCode::kNotFound:
    case ErrorCode::kUnsupported:
      return kExitBadInput;
    case ErrorCode::kNoSpace:
    case ErrorCode::kPeerLost:
    case ErrorCode::kSystem:
    case ErrorCode::kTimeout:
      return kExitFailed;
  }
  return kExitFailed;
}

}  // namespace comrad::deploy
