#pragma once
// Makes the query with which a viewer asks a server for a picture to save (docs/formats/http.md, /render).
#include <string>

#include "base/camera.h"
#include "client/app/view_state.h"

namespace client {

/// Returns the query of /render for the present view, without size and background, which the caller adds.
/// `tolerance_px` is the viewer's patch tolerance: a picture tinted by resolution shows the viewer's patches, any other
/// the full resolution.
std::string pictureQuery(const base::ViewCamera& camera, const ViewState& view, double tolerance_px);

}  // namespace client
