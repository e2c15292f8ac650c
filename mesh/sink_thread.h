#pragma once
// Lets a reader go on while what it read is still being taken in. Private to lod/build.
#include "base/parallel.h"
#include "mesh/mesh_sink.h"

namespace mesh {

/// Hands blocks to another sink in their order, in a thread of its own; some of them wait. An error of that sink is
/// returned by a later call, or by finish().
class SinkThread : public MeshSink {
 public:
  /// `inner` must outlive it.
  explicit SinkThread(MeshSink& inner) : inner_(inner), thread_(1, kMaxWaiting) {}

  base::Result<void> vertices(const VertexBlock& block) override;
  base::Result<void> triangles(const TriangleBlock& block) override;
  base::Result<void> restart() override;
  /// Waits until all is taken in. The first error: what comes after it in the file is not looked at.
  base::Result<void> finish();

 private:
  static constexpr std::size_t kMaxWaiting = 2;
  base::Result<void> status();
  base::Result<void> submit(std::function<base::Result<void>()> take);

  MeshSink& inner_;
  std::mutex mutex_;
  base::Result<void> status_;
  base::ThreadPool thread_;  // the last member: it ends before the others
};

}  // namespace mesh
