#pragma once
// What a viewer asks a server for when it saves a picture (docs/formats/http.md, /render).
#include <string>

#include "base/camera.h"
#include "client/app/view_state.h"

namespace client {

/// The query of /render for what is looked at: all but size and background, which whoever saves it chooses.
/// `tolerance_px`: of the viewer's patches; a picture tinted by resolution is of those, any other of the full
/// resolution.
std::string pictureQuery(const base::ViewCamera& camera, const ViewState& view, double tolerance_px);

}  // namespace client
