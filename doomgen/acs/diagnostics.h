// Places in sources and what is to be said about them. Used by every stage of the compiler.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::acs_compiler {

/// A place in a source: file by index, line and column from 1, the column in bytes.
struct Place {
  uint32_t file = 0, line = 1, column = 1;
};

/// Errors and warnings of one compilation.
class Diagnostics {
 public:
  explicit Diagnostics(std::size_t errors_max) : errors_max_(errors_max == 0 ? 1 : errors_max) {}

  uint32_t add_file(std::string path) {
    paths_.push_back(std::move(path));
    return static_cast<uint32_t>(paths_.size() - 1);
  }
  const std::string& path(uint32_t file) const { return paths_[file]; }

  /// `found` states what is there, `expected` what was wanted instead; empty where found suffices.
  void error(Place place, std::string_view found, std::string_view expected = {});
  void warn(Place place, std::string_view text);

  bool failed() const { return !errors_.empty(); }
  bool full() const { return errors_.size() >= errors_max_; }  ///< time to give up
  Error to_error() const;                                      ///< all errors in the order of their places
  std::vector<std::string> take_warnings() { return std::move(warnings_); }
  std::string where(Place place) const;  ///< file:line:column

 private:
  std::size_t errors_max_;
  std::vector<std::string> paths_, warnings_;
  std::vector<std::pair<Place, std::string>> errors_;
};

/// Text from a source for a message: printable, cut short.
std::string in_quotes(std::string_view text);

}  // namespace comrad::acs_compiler
