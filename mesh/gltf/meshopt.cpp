#include "mesh/gltf/meshopt.h"

#include <meshoptimizer.h>

#include "mesh/mesh_stream.h"

namespace mesh::gltf {
namespace {

// The codec of vertices takes 4 bytes at least for each byte of 256 vertices, that of indices more. A small hostile
// file must not claim the memory.
constexpr std::uint64_t kMaxRatio = 64;
// A vertex stream begins with this in the upper half of its first byte and its version in the lower half.
constexpr std::uint8_t kVertexHeader = 0xA0;

base::Error brokenIn(const std::string& here) {
  return invalidInput(here + " is compressed by meshoptimizer and broken");
}

base::Result<void> applyFilter(const std::string& filter, std::uint64_t count, std::uint64_t stride, base::Bytes& out,
                               const std::string& here) {
  if (filter.empty() || filter == "NONE") return {};
  if (filter == "OCTAHEDRAL" && (stride == 4 || stride == 8))
    meshopt_decodeFilterOct(out.data(), count, stride);
  else if (filter == "QUATERNION" && stride == 8)
    meshopt_decodeFilterQuat(out.data(), count, stride);
  else if (filter == "EXPONENTIAL" && stride % 4 == 0)
    meshopt_decodeFilterExp(out.data(), count, stride);
  else
    return unsupported(here + " is compressed by meshoptimizer with the filter " + inQuotes(filter) + " of " +
                       std::to_string(stride) + " bytes, which is not read");
  return {};
}

}  // namespace

const json& meshoptOf(const json& view) {
  const json& ratified = extension(view, "KHR_meshopt_compression");
  return ratified.is_object() ? ratified : extension(view, "EXT_meshopt_compression");
}

base::Result<base::Bytes> decodeMeshopt(const json& compression, base::ByteView compressed, const std::string& here) {
  const std::uint64_t count = integer(member(compression, "count"), 0);
  const std::uint64_t stride = integer(member(compression, "byteStride"), 0);
  const std::string mode = text(member(compression, "mode"));
  const bool vertices = mode == "ATTRIBUTES";
  if (!vertices && mode != "TRIANGLES" && mode != "INDICES")
    return unsupported(here + " is compressed by meshoptimizer in the mode " + inQuotes(mode) + ", which is not read");
  const bool fits = vertices ? stride > 0 && stride <= 256 && stride % 4 == 0 : stride == 2 || stride == 4;
  if (!fits || count == 0 || (mode == "TRIANGLES" && count % 3 != 0)) return brokenIn(here);
  if (count / kMaxRatio > compressed.size() || count * stride / kMaxRatio > compressed.size()) return brokenIn(here);
  if (vertices && !compressed.empty() && (compressed[0] & 0xF0) == kVertexHeader && compressed[0] > kVertexHeader)
    return unsupported(here +
                       " is compressed by a later version of meshoptimizer, which is not read; write the file "
                       "with EXT_meshopt_compression");

  base::Bytes out(static_cast<std::size_t>(count * stride));
  const int failed = vertices
                         ? meshopt_decodeVertexBuffer(out.data(), count, stride, compressed.data(), compressed.size())
                     : mode == "TRIANGLES"
                         ? meshopt_decodeIndexBuffer(out.data(), count, stride, compressed.data(), compressed.size())
                         : meshopt_decodeIndexSequence(out.data(), count, stride, compressed.data(), compressed.size());
  if (failed != 0) return brokenIn(here);
  if (vertices) LUMIGRID_TRY(applyFilter(text(member(compression, "filter")), count, stride, out, here));
  return out;
}

}  // namespace mesh::gltf
