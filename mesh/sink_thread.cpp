#include "mesh/sink_thread.h"

#include <utility>

namespace mesh {
namespace {

template <class T>
std::vector<T> copyOf(std::span<const T> values) {
  return {values.begin(), values.end()};
}

}  // namespace

base::Result<void> SinkThread::vertices(const VertexBlock& block) {
  return submit(
      [this, positions = copyOf(block.positions), normals = copyOf(block.normals), colors = copyOf(block.colors)] {
        return inner_.vertices({positions, normals, colors});
      });
}

base::Result<void> SinkThread::triangles(const TriangleBlock& block) {
  return submit([this, corners = copyOf(block.corners), colors = copyOf(block.colors), normals = copyOf(block.normals),
                 uv = copyOf(block.uv), pictures = copyOf(block.pictures)] {
    return inner_.triangles({corners, colors, normals, uv, pictures});
  });
}

base::Result<void> SinkThread::restart() {
  LUMIGRID_TRY(finish());
  return inner_.restart();
}

base::Result<void> SinkThread::finish() {
  thread_.drain();
  return status();
}

base::Result<void> SinkThread::status() {
  const std::lock_guard lock(mutex_);
  return status_;
}

base::Result<void> SinkThread::submit(std::function<base::Result<void>()> deliver) {
  LUMIGRID_TRY(status());
  thread_.submit([this, deliver = std::move(deliver)] {
    if (!status()) return;
    const auto delivered = deliver();
    const std::lock_guard lock(mutex_);
    status_ = delivered;
  });
  return {};
}

}  // namespace mesh
