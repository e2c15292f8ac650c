#pragma once
// The host of a pmr.lgm.
#include "lod/pmr/stream.h"
#include "tests/support/stream_host.h"

namespace lod::pmr {

using Host = support::StreamHost<Stream>;

inline std::vector<DrawnLeaf> fetchAll(Stream& stream, Host& host, const TraverseRequest& request, double& now,
                                       const std::function<void(const std::vector<DrawnLeaf>&)>& each = {}) {
  return support::fetchView<DrawnLeaf>(stream, host, request, now, each);
}

}  // namespace lod::pmr
