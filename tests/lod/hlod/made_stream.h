#pragma once
// A file to stream, views of it, and how its nodes lie above one another.
#include <functional>
#include <memory>
#include <vector>

#include "lod/file_bytes.h"
#include "lod/hlod/stream.h"
#include "tests/support/made_hlod.h"
#include "tests/support/stream_host.h"

namespace lod::hlod {

using Host = support::StreamHost<Stream>;
using Numbers = std::vector<std::uint32_t>;

inline const support::MadeHlod& made() {
  static const support::MadeHlod file = support::madeHlod(4, 16);
  return file;
}

inline std::shared_ptr<const FileBytes> local(base::ByteView bytes = made().file) {
  return std::make_shared<MemoryBytes>(bytes);
}

inline TraverseRequest viewFrom(double distance, int size = 600) {
  base::ViewCamera view;
  view.position = glm::dvec3(0.2, 0.3, distance);
  view.width = view.height = size;
  TraverseRequest request;
  request.camera = base::cameraForScene(view, glm::dvec3(0.0), made().header.bounds);
  return request;
}

inline Numbers cutOf(const TraverseRequest& request) {
  return chooseCut(made().nodes, request);
}

inline std::vector<DrawnNode> fetchAll(Stream& stream, Host& host, const TraverseRequest& request, double& now,
                                       const std::function<void(const std::vector<DrawnNode>&)>& each = {}) {
  return support::fetchView<DrawnNode>(stream, host, request, now, each);
}

inline std::uint32_t parentOf(std::uint32_t node) {
  std::uint32_t parent = 0;
  while (node >= made().nodes[parent].first_child + made().nodes[parent].children) ++parent;
  return parent;
}
/// Whether both are one node, or the first is above the second.
inline bool isAbove(std::uint32_t upper, std::uint32_t node) {
  while (node > upper) node = parentOf(node);
  return node == upper;
}

}  // namespace lod::hlod
