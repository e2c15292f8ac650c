#pragma once
// The little XML that S3 stores answer with: elements and entities. A bounded scan, not a parser: what it does not find
// is not there.
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace repository {

/// The text of the first element `name`, its entities resolved; nothing when there is none, or it is not closed, or an
/// entity is unknown.
std::optional<std::string> xmlText(std::string_view xml, const std::string& name);

/// One page of ListObjectsV2.
struct S3Page {
  std::vector<std::string> keys;
  std::string next_token;  ///< "" at the end
};
/// Errors: kNetwork when this is no such page.
base::Result<S3Page> parseS3Page(std::string_view xml);

}  // namespace repository
