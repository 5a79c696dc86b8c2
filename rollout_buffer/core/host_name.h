// What this host calls itself. Stage: beside the flow.
#pragma once

#include <unistd.h>

#include <string>

namespace comrad {

/// Empty where the kernel does not report it.
inline std::string host_name() {
  char name[256] = {};
  gethostname(name, sizeof name - 1);
  return name;
}

/// Without its domain.
inline std::string short_host_name() {
  const std::string whole = host_name();
  return whole.substr(0, whole.find('.'));
}

}  // namespace comrad
