#pragma once
// Writes and reads a view as a short text for a URL's hash (docs/formats/permalink.md).
#include <string>
#include <string_view>

#include "base/error.h"
#include "client/app/view_state.h"

namespace client {

inline constexpr std::size_t kMaxPermalink = 512;  ///< bytes; longer links are refused unread

/// Writes a link without '#'. Positions are rounded to a hundred-millionth of the pivot's distance and directions to
/// 10^-8; a thousandth of a pixel of a picture 10 000 pixels high is more. A link that was read is written as the same
/// text again. `view.pivot_distance`: above 0.
std::string formatPermalink(const ViewState& view);

/// Reads "HEADING,HEIGHT", in degrees, of a light of the viewer's own.
base::Result<OwnLight> parseLight(std::string_view text);

/// Reads a link with or without '#'. Errors say in one line what is wrong.
base::Result<ViewState> parsePermalink(std::string_view text);

}  // namespace client
