#include "repository/faces/frame_image.h"

#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"

namespace repository {

base::Result<base::Image> decodeFrameImage(base::ByteView value, std::int64_t max_pixels) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto face, decodeFaceValue(value));
  if (face.empty || !isWebp(face.picture)) return decodeFaceImage(value, 0);
  return decodeWebpImage(face, max_pixels);
}

}  // namespace repository
