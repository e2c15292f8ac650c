#include "repository/faces/frame_image.h"

#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"
#include "repository/faces/webp.h"

namespace repository {

base::Result<base::Image> decodeFrameImage(base::ByteView value, std::int64_t max_pixels) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto face, decodeFaceValue(value));
  if (face.empty || !isWebp(face.picture)) return decodeFaceImage(value, 0);
  if (!face.coverage.empty())
    return base::Error{base::ErrorCode::kInvalidInput, "WebP: a mask comes with it, though it holds alpha itself"};
  return decodeWebp(face.picture, max_pixels);
}

}  // namespace repository
