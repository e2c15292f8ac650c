#pragma once
// Reads elements and entities from the small XML documents that S3 stores answer with. It is a bounded scan and no XML
// parser.
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace repository {

/// The text of the first element `name` with its entities resolved; nothing when there is no such element, it is not
/// closed, or it holds an unknown entity.
std::optional<std::string> xmlText(std::string_view xml, const std::string& name);

/// One page of ListObjectsV2.
struct S3Page {
  std::vector<std::string> keys;
  std::string next_token;  ///< "" at the end
};
/// Errors: kNetwork when `xml` is no such page.
base::Result<S3Page> parseS3Page(std::string_view xml);

}  // namespace repository
