#include "base/error.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

namespace base {
namespace {

// LUMIGRID_TRY refuses by these traits, at compile time, whatever holds a value.
static_assert(kHoldsNoValue<Result<void>>);
static_assert(!kHoldsNoValue<Result<bool>>);
static_assert(!kHoldsNoValue<Result<int*>>);
static_assert(!kHoldsNoValue<Result<std::unique_ptr<int>>>);
static_assert(!kHoldsNoValue<bool>);

Result<void> failIf(bool fails) {
  if (fails) return Error{ErrorCode::kIo, "the disk"};
  return {};
}

Result<std::unique_ptr<int>> makeUnless(bool fails, int value) {
  LUMIGRID_TRY(failIf(fails));
  return std::make_unique<int>(value);
}

Result<int> readUnless(bool fails, int value) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto made, makeUnless(fails, value));
  return *made;
}

TEST(Error, tryReturnsTheErrorAndElseGoesOn) {
  const auto failed = makeUnless(true, 3);
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().code, ErrorCode::kIo);
  EXPECT_EQ(failed.error().message, "the disk");
  const auto made = makeUnless(false, 3);
  ASSERT_TRUE(made);
  EXPECT_EQ(**made, 3);
}

TEST(Error, assignOrReturnMovesTheValueOrReturnsTheError) {
  EXPECT_EQ(readUnless(false, 7).value(), 7);
  EXPECT_EQ(readUnless(true, 7).error().message, "the disk");
}

TEST(Error, withinNamesThePlaceAndKeepsTheCode) {
  const Error error = within("a.ply", {ErrorCode::kNotFound, "is not there"});
  EXPECT_EQ(error.code, ErrorCode::kNotFound);
  EXPECT_EQ(error.message, "a.ply: is not there");
}

}  // namespace
}  // namespace base
