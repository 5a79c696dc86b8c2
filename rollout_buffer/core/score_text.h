// A score J in words: the same digits in tables, progress lines and videos. Stage: messages.
#pragma once

#include <string>

namespace comrad {

/// Four digits: 412.34 -> "412.3", 0.0085 -> "0.0085", 12'345.6 -> "12346"; "-" where it is not finite.
std::string score_text(double score);

}  // namespace comrad
