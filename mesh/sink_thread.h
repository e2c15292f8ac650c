#pragma once
// Lets a reader go on while the sink still works on the blocks that came before.
#include "base/parallel.h"
#include "mesh/stream_mesh.h"

namespace mesh {

/// Copies blocks and passes them on to another sink in their order, in a thread of its own. An error of that sink is
/// returned by a later call, or by finish().
class SinkThread : public MeshSink {
 public:
  /// `inner` must outlive it.
  explicit SinkThread(MeshSink& inner) : inner_(inner), thread_(1, kMaxWaiting) {}

  base::Result<void> vertices(const VertexBlock& block) override;
  base::Result<void> triangles(const TriangleBlock& block) override;
  base::Result<void> restart() override;
  /// Waits until all blocks have been passed on. Returns the first error, after which no block is passed on.
  base::Result<void> finish();

 private:
  static constexpr std::size_t kMaxWaiting = 2;  // blocks, of some megabytes each
  base::Result<void> status();
  base::Result<void> submit(std::function<base::Result<void>()> deliver);

  MeshSink& inner_;
  std::mutex mutex_;
  base::Result<void> status_;
  base::ThreadPool thread_;  // the last member, so that it ends before the others are destroyed
};

}  // namespace mesh
