// Errors that the world causes (files, peers, flags) travel as values. A function that can fail returns
// Expected<T>; our own code does not throw. Serves every stage of the flow.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "rollout_buffer/core/check.h"

namespace comrad {

enum class ErrorCode {
  kBadInput,     ///< a flag, setting or argument that cannot be used
  kBadFormat,    ///< bytes of a file or message that break their format
  kNotFound,     ///< a file, lump, key or peer that is not there
  kNoSpace,      ///< memory or disk does not suffice
  kPeerLost,     ///< another process died or left the protocol
  kUnsupported,  ///< valid input that this build or machine cannot serve
  kSystem,       ///< a system call failed
  kTimeout,      ///< a bounded wait ended
  kNotSaved,     ///< the work is done, what it made could not be written
};

/// What went wrong: `message` contains what, where and what to do, in one line.
struct Error {
  ErrorCode code = ErrorCode::kSystem;
  std::string message;
};

/// A value or the Error that kept it from being made.
template <typename T>
class [[nodiscard]] Expected {
 public:
  Expected(T value) : state_(std::in_place_index<0>, std::move(value)) {}      // NOLINT: implicit on purpose
  Expected(Error error) : state_(std::in_place_index<1>, std::move(error)) {}  // NOLINT

  bool has_value() const { return state_.index() == 0; }
  explicit operator bool() const { return has_value(); }

  T& value() & {
    COMRAD_CHECK(has_value(), error_message());
    return std::get<0>(state_);
  }
  const T& value() const& {
    COMRAD_CHECK(has_value(), error_message());
    return std::get<0>(state_);
  }
  T&& value() && {
    COMRAD_CHECK(has_value(), error_message());
    return std::get<0>(std::move(state_));
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const { return std::get<1>(state_); }

 private:
  std::string error_message() const { return has_value() ? std::string() : std::get<1>(state_).message; }
  std::variant<T, Error> state_;
};

/// Success without a value, or an Error: `Expected<void>() ` means success.
template <>
class [[nodiscard]] Expected<void> {
 public:
  Expected() = default;
  Expected(Error error) : error_(std::move(error)) {}  // NOLINT: implicit on purpose
  bool has_value() const { return !error_.has_value(); }
  explicit operator bool() const { return has_value(); }
  const Error& error() const { return *error_; }

 private:
  std::optional<Error> error_;
};

using Status = Expected<void>;

}  // namespace comrad

#define COMRAD_CONCAT_INNER(a, b) a##b
#define COMRAD_CONCAT(a, b) COMRAD_CONCAT_INNER(a, b)

/// Returns the error of `expression` from the calling function, if it has one.
#define COMRAD_TRY(expression)                                           \
  do {                                                                   \
    auto comrad_try_result = (expression);                               \
    if (!comrad_try_result) return std::move(comrad_try_result).error(); \
  } while (false)

/// Declares or assigns `target` from the value of `expression`, or returns its error from the caller.
#define COMRAD_TRY_ASSIGN(target, expression) \
  COMRAD_TRY_ASSIGN_INNER(COMRAD_CONCAT(comrad_try_, __LINE__), target, expression)
#define COMRAD_TRY_ASSIGN_INNER(temporary, target, expression) \
  auto temporary = (expression);                               \
  if (!temporary) return temporary.error();                    \
  target = std::move(temporary).value()
