#pragma once
// Errors as values. Library code never prints, exits or throws. It returns a Result, whose error is one line that names
// the file or peer, the place, and what to do next.
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

#include "base/check.h"

namespace base {

enum class ErrorCode {
  kInvalidInput,  ///< bytes, a file or a value from outside are wrong
  kNotFound,      ///< a file or key is not there
  kExists,        ///< output is there already and may not be replaced
  kNoSpace,       ///< disk, map or memory budget is full
  kIo,            ///< the system refused a read or write
  kNetwork,       ///< a peer is gone, or a port is taken
  kVersion,       ///< another format or protocol version
  kBusy,          ///< somebody else holds it
  kUnsupported,   ///< valid, but not something we do
  kCancelled,     ///< stopped on request
};

struct Error {
  ErrorCode code = ErrorCode::kInvalidInput;
  std::string message;
};

/// The same error with "place: " before its message.
inline Error within(const std::string& place, Error error) {
  error.message = place + ": " + error.message;
  return error;
}

/// A value or an error. Reading the absent one is a caller's mistake and stops the program.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}      // NOLINT: implicit by design
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}  // NOLINT: implicit by design

  explicit operator bool() const { return state_.index() == 0; }
  T& value() & { return require(0), *std::get_if<0>(&state_); }
  const T& value() const& { return require(0), *std::get_if<0>(&state_); }
  T&& value() && { return require(0), std::move(*std::get_if<0>(&state_)); }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }
  const Error& error() const { return require(1), *std::get_if<1>(&state_); }

 private:
  void require(std::size_t index) const {
    if (state_.index() == index) return;
    failCheck(__FILE__, __LINE__, "Result read the wrong way",
              index == 0 ? ": " + std::get_if<1>(&state_)->message : "");
  }
  std::variant<T, Error> state_;
};

template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_(std::move(error)) {}  // NOLINT: implicit by design

  explicit operator bool() const { return !error_; }
  const Error& error() const {
    LUMIGRID_CHECK(error_.has_value());
    return *error_;
  }

 private:
  std::optional<Error> error_;
};

/// True for the one type that LUMIGRID_TRY accepts. A Result of a value would lose the value, and with it a lock or a
/// context that the value owns.
template <class T>
inline constexpr bool kHoldsNoValue = std::is_same_v<T, Result<void>>;

}  // namespace base

/// Returns the error of a Result<void> expression from the enclosing function, if it has one.
#define LUMIGRID_TRY(...)                                                                             \
  do {                                                                                                \
    if (auto try_result = (__VA_ARGS__); !try_result) {                                               \
      static_assert(::base::kHoldsNoValue<decltype(try_result)>,                                      \
                    "LUMIGRID_TRY would drop this Result's value: use LUMIGRID_ASSIGN_OR_RETURN, or " \
                    "if (auto x = f(); !x) return x.error();");                                       \
      return try_result.error();                                                                      \
    }                                                                                                 \
  } while (false)

/// Declares a variable with the value of a Result<T> expression, or returns its error from the enclosing function:
/// LUMIGRID_ASSIGN_OR_RETURN(const auto scene, readScene(path)); with auto&& nothing is moved.
#define LUMIGRID_ASSIGN_OR_RETURN(declaration, ...) \
  LUMIGRID_ASSIGN_OR_RETURN_AS(LUMIGRID_JOIN(result_of_line_, __LINE__), declaration, __VA_ARGS__)
#define LUMIGRID_ASSIGN_OR_RETURN_AS(result, declaration, ...) \
  auto result = (__VA_ARGS__);                                 \
  if (!result) return result.error();                          \
  declaration = std::move(result).value()
#define LUMIGRID_JOIN(a, b) LUMIGRID_JOIN_EXPANDED(a, b)
#define LUMIGRID_JOIN_EXPANDED(a, b) a##b
