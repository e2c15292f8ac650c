#pragma once
// Two GL contexts on one thread: the server's, which draws faces and the truth, beside the client's.
#include <memory>
#include <utility>

#include "base/egl/headless.h"

namespace server {

/// A context that is current only while it is used.
class OwnContext {
 public:
  /// `others` is current before and after each use; both contexts outlive the object.
  OwnContext(base::HeadlessContext& own, base::HeadlessContext& others) : own_(own), others_(others) {}

  /// Calls `draw` with the own context current, and returns its result.
  template <class Draw>
  auto use(Draw&& draw) {
    own_.makeCurrent();
    auto result = std::forward<Draw>(draw)();
    others_.makeCurrent();
    return result;
  }

 private:
  base::HeadlessContext& own_;
  base::HeadlessContext& others_;
};

}  // namespace server
