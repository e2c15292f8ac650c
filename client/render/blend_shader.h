#pragma once
// The GLSL of the Grid-Lumigraph (Okamoto 2011, section 3.2): shadow-masked projective texturing, all images in one
// pass.
#include <string>

namespace client {

inline constexpr int kMaxSamples = 32;  ///< that one frame blends
inline constexpr int kMaxArrays = 3;    ///< different image sizes at a time: faces, and exact frames of two sizes
inline constexpr int kSampleVec4s = 8;  ///< of one sample in the uniform block

std::string blendVertexSource();
/// With lod::draw::shadingSource() inside.
std::string blendFragmentSource();
std::string depthVertexSource();
std::string depthFragmentSource();

}  // namespace client
