#include "lod/qsplat/builder/file_build.h"

#include <algorithm>
#include <cstdio>
#include <mutex>

#include "base/fields.h"
#include "base/parallel.h"
#include "lod/ingest/spool.h"
#include "lod/qsplat/builder/code_file.h"
#include "lod/qsplat/builder/lone_leaves.h"
#include "lod/qsplat/builder/strays.h"
#include "lod/qsplat/builder/tree_writer.h"

namespace lod::qsplat::builder {
namespace {

using base::Error;
using base::ErrorCode;

struct Record {
  std::uint32_t tile = 0;
  StoredSubtree subtree;
};

// Reads a record whose payload lies at `offset`; false where it is none.
bool readRecord(std::uint64_t offset, base::ByteView payload, Record& record) {
  base::ByteReader in(payload);
  base::readFields(in, std::tie(record.tile, record.subtree.root, record.subtree.added_leaves));
  const std::uint32_t levels = in.u32();
  if (!in.ok() || levels > in.remaining() / 4) return false;
  for (std::uint32_t l = 0; l < levels; ++l) record.subtree.nodes += in.u32();
  record.subtree.offset = offset + in.offset();
  if (record.subtree.nodes * sizeof(TreeNode) != in.remaining()) return false;
  if (record.subtree.nodes > 0) record.subtree.root_node = in.read<TreeNode>();
  return true;
}

// The root of a tile's tree.
struct TileRoot {
  Splat splat;
  TreeNode node;
  std::uint64_t nodes = 0;  // of the tree

  // The means stay: strays are small.
  void setNode(const TreeNode& root) {
    node = root;
    splat.sphere = root.sphere;
    splat.direction = Node{root.bits, 0}.normalCode();
    splat.least_cosine = cosineOfCone(root);
  }
};

class FileBuilder {
 public:
  FileBuilder(const SubtreeStore& subtrees, const FileBuildOptions& options)
      : subtrees_(subtrees),
        options_(options),
        strays_(subtrees.tiles(), [this](std::uint32_t tile) { return subtrees_.nodes(tile); }) {}

  base::Result<WrittenTree> run(const std::string& path) {
    LUMIGRID_TRY(moveStrays());
    makeTop();
    encodeTop();
    LUMIGRID_TRY(encodeTiles());
    LUMIGRID_ASSIGN_OR_RETURN(const auto header, writeEither(path));
    return WrittenTree{header, repeated_leaves_};
  }

 private:
  base::Result<void> moveStrays() {
    LUMIGRID_TRY(strays_.plan(options_.threads));
    roots_.resize(subtrees_.tiles());
    return base::tryParallelFor(roots_.size(), options_.threads, [this](std::size_t i) -> base::Result<void> {
      const auto t = static_cast<std::uint32_t>(i);
      roots_[t] = {subtrees_[t].root, subtrees_[t].root_node, subtrees_[t].nodes};
      if (!options_.points && !strays_.changes(t)) return {};
      bool widened = false;
      LUMIGRID_ASSIGN_OR_RETURN(const auto nodes, nodesOf(t, &widened));
      if (!strays_.changes(t) && !widened) return {};
      roots_[t].nodes = nodes.size();
      if (!nodes.empty()) roots_[t].setNode(nodes[0]);
      return {};
    });
  }

  // A tile's nodes with strays moved, and room for leaves that are far from others.
  base::Result<std::vector<TreeNode>> nodesOf(std::uint32_t tile, bool* widened = nullptr) const {
    LUMIGRID_ASSIGN_OR_RETURN(auto nodes, strays_.nodes(tile));
    const bool any = options_.points && widenAroundLone(nodes);
    if (widened != nullptr) *widened = any;
    return nodes;
  }

  void makeTop() {
    std::vector<Splat> roots;
    for (std::uint32_t t = 0; t < roots_.size(); ++t) {
      if (roots_[t].nodes == 0) continue;
      tiles_.push_back(t);
      roots.push_back(roots_[t].splat);
    }
    top_ = makeTree(roots);
  }

  base::Result<Header> writeEither(const std::string& path) {
    if (options_.plain_path.empty()) return writePlain(path);
    if (const auto plain = writePlain(options_.plain_path); !plain) return plain.error();
    return writeCoded(path);
  }

  base::Result<Header> writePlain(const std::string& path) {
    auto header = write(path, options_.wide_pointers);
    if (!header && header.error().code == ErrorCode::kUnsupported && !options_.wide_pointers)
      header = write(path, true);
    return header;
  }

  // Reads the plain file, and removes it in the end.
  base::Result<Header> writeCoded(const std::string& path) const {
    LUMIGRID_ASSIGN_OR_RETURN(const auto plain, ingest::SpoolFile::open(options_.plain_path));
    LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));
    const auto read = [&](std::uint64_t offset, std::span<std::uint8_t> out) { return plain.readAt(offset, out); };
    const auto write = [&](base::ByteView bytes) { return file.write(bytes); };
    const auto progress = [this](double done) { return !options_.progress || options_.progress("code", done); };
    LUMIGRID_ASSIGN_OR_RETURN(const auto header, codeFile(read, write, options_.threads, progress));
    LUMIGRID_TRY(file.commit());
    std::remove(options_.plain_path.c_str());
    return header;
  }

  LeafCones leafCones() const { return options_.plain_path.empty() ? LeafCones::kEach : LeafCones::kEveryFourth; }

  // Names an inner node of the top tree by its number, and a tile by TreeShape::kLeaf + its place in tiles_.
  using Ref = std::uint32_t;
  static bool isTile(Ref ref) { return (ref & TreeShape::kLeaf) != 0; }
  const TileRoot& tile(Ref ref) const { return roots_[tiles_[ref & ~TreeShape::kLeaf]]; }
  const base::Sphere& sphereOf(Ref ref) const {
    return isTile(ref) ? tile(ref).splat.sphere : top_.inner[ref].splat.sphere;
  }
  std::span<const Ref> childrenOf(Ref inner) const {
    return std::span(top_.inner[inner].children).first(top_.inner[inner].count);
  }
  bool isLeafNode(Ref ref) const { return isTile(ref) && tile(ref).nodes == 1; }

  bool areLeaves(std::span<const Ref> refs) const {
    return std::all_of(refs.begin(), refs.end(), [this](Ref ref) { return isLeafNode(ref); });
  }

  Node& nodeOf(Ref ref) { return isTile(ref) ? tile_nodes_[ref & ~TreeShape::kLeaf] : top_nodes_[ref]; }

  // Encodes the top tree's nodes and the tiles' roots.
  void encodeTop() {
    top_nodes_.resize(top_.inner.size());
    tile_nodes_.resize(tiles_.size());
    tile_spheres_.resize(tiles_.size());
    encodeAt(top_.root, !isLeafNode(top_.root), kWholeParent, sphereOf(top_.root));
  }
  // `has_pointer` says whether the node's group has one.
  void encodeAt(Ref ref, bool has_pointer, std::uint32_t code, const base::Sphere& decoded) {
    if (isTile(ref)) {
      nodeOf(ref) = tile(ref).node.encoded(code, has_pointer, leafCones());
      tile_spheres_[ref & ~TreeShape::kLeaf] = decoded;
      return;
    }
    const auto children = childrenOf(ref);
    const bool leaves = areLeaves(children);
    nodeOf(ref) = nodeFor(top_.inner[ref].splat, top_.inner[ref].count, leaves).encoded(code, has_pointer, leafCones());
    for (const Ref child : children) {
      const std::uint32_t child_code = encodeSphere(decoded, sphereOf(child));
      encodeAt(child, !leaves, child_code, decodeSphere(decoded, sphereTable()[child_code]));
    }
  }

  base::Result<void> encodeTiles() {
    LUMIGRID_ASSIGN_OR_RETURN(runs_, ingest::SpoolFile::create(options_.runs_path));
    extents_.resize(tiles_.size());
    std::mutex mutex;
    std::size_t done = 0;
    const auto encodeOne = [&](std::size_t i) -> base::Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(auto nodes, nodesOf(tiles_[i]));
      std::uint64_t repeated = 0;
      const auto runs = encodeTile(i, std::move(nodes), repeated);
      const std::lock_guard lock(mutex);
      repeated_leaves_ += repeated;
      for (const Run& run : runs) {
        extents_[i].push_back({runs_.size(), run.size()});
        LUMIGRID_TRY(runs_.append(run));
      }
      return report("encode", ++done, tiles_.size()) ? base::Result<void>() : cancelled();
    };
    LUMIGRID_TRY(base::tryParallelFor(tiles_.size(), options_.threads, encodeOne));
    return runs_.flush();
  }

  // `at`: the tile's place in tiles_. `repeated`: how many leaves repeat another.
  std::vector<Run> encodeTile(std::size_t at, std::vector<TreeNode> nodes, std::uint64_t& repeated) {
    std::vector<LargeLeaf> large;
    const float usual = options_.points ? usualRadius(nodes) : 0.0F;
    const auto note = [&](std::uint32_t leaf, float radius, const base::Sphere& parent) {
      if (isTooLarge(radius, nodes[leaf].sphere.radius, usual)) large.push_back({leaf, parent, radius});
    };
    auto runs = encodeSubtree(nodes, tile_spheres_[at], options_.colors, leafCones(),
                              options_.points ? VisitLeaf(note) : VisitLeaf());
    if (large.empty()) return runs;
    const NestedLeaves nested = nestLargeLeaves(std::move(nodes), std::move(large), usual);
    repeated = nested.added_leaves;
    // The root may no longer be above leaves alone. Its group has a pointer, as it has children.
    tile_nodes_[at] = nested.nodes[0].encoded(tile_nodes_[at].sphereCode(), true, leafCones());
    return encodeSubtree(nested.nodes, tile_spheres_[at], options_.colors, leafCones());
  }

  // Groups that lie side by side in a level: one group of the top tree, or a tile's run.
  struct Segment {
    std::vector<Ref> group;  // empty for a tile's run
    std::uint32_t tile = 0;  // its place in tiles_
    std::uint32_t run = 0;
  };

  base::Result<Header> write(const std::string& path, bool wide_pointers) {
    LUMIGRID_ASSIGN_OR_RETURN(auto writer,
                              TreeWriter::create(path, options_.colors, wide_pointers, sphereOf(top_.root)));
    written_ = 0;
    std::vector<Segment> level{{{top_.root}, 0, 0}};
    std::vector<Segment> next;
    while (!level.empty()) {
      next.clear();
      for (const Segment& segment : level)
        LUMIGRID_TRY(segment.group.empty() ? writeRun(segment, writer, next) : writeTop(segment, writer, next));
      std::swap(level, next);
    }
    return writer.finish();
  }

  base::Result<void> writeTop(const Segment& segment, TreeWriter& writer, std::vector<Segment>& next) {
    GroupNodes group;
    group.has_pointer = !areLeaves(segment.group);
    for (const Ref ref : segment.group) {
      group.nodes[group.count++] = nodeOf(ref);
      if (isTile(ref)) {
        addRun(ref & ~TreeShape::kLeaf, 0, next);
        continue;
      }
      const auto children = childrenOf(ref);
      next.push_back({{children.begin(), children.end()}, 0, 0});
    }
    return writer.add(group);
  }

  void addRun(std::uint32_t tile, std::uint32_t run, std::vector<Segment>& next) const {
    if (run < extents_[tile].size()) next.push_back({{}, tile, run});
  }

  base::Result<void> writeRun(const Segment& segment, TreeWriter& writer, std::vector<Segment>& next) {
    const ingest::Extent& extent = extents_[segment.tile][segment.run];
    buffer_.resize(static_cast<std::size_t>(extent.bytes));
    LUMIGRID_TRY(runs_.readAt(extent.offset, buffer_));
    std::size_t at = 0;
    while (true) {
      const GroupNodes group = readGroup(buffer_, at, options_.colors);
      if (group.count == 0) break;
      LUMIGRID_TRY(writer.add(group));
    }
    addRun(segment.tile, segment.run + 1, next);
    written_ += extent.bytes;
    return report("write", written_, runs_.size()) ? base::Result<void>() : cancelled();
  }

  bool report(const std::string& stage, std::uint64_t done, std::uint64_t all) const {
    return !options_.progress || options_.progress(stage, static_cast<double>(done) / static_cast<double>(all));
  }
  static Error cancelled() { return {ErrorCode::kCancelled, "building the splat tree was cancelled"}; }

  const SubtreeStore& subtrees_;
  const FileBuildOptions& options_;
  StrayMoves strays_;
  std::vector<TileRoot> roots_;       // by tile, with strays moved
  std::vector<std::uint32_t> tiles_;  // those with nodes
  TreeShape top_;
  std::vector<Node> top_nodes_;
  std::vector<Node> tile_nodes_;
  std::vector<base::Sphere> tile_spheres_;  // decoded roots
  ingest::SpoolFile runs_;
  std::vector<std::vector<ingest::Extent>> extents_;
  base::Bytes buffer_;
  std::uint64_t written_ = 0;
  std::uint64_t repeated_leaves_ = 0;
};

}  // namespace

base::Result<SubtreeStore> SubtreeStore::open(const std::string& path, bool resume, std::size_t tiles) {
  SubtreeStore store;
  store.tiles_.resize(tiles);
  const auto keep = [&](std::uint64_t offset, base::ByteView payload) {
    Record record;
    if (!readRecord(offset, payload, record) || record.tile >= tiles) return false;
    store.tiles_[record.tile] = std::move(record.subtree);
    return true;
  };
  LUMIGRID_ASSIGN_OR_RETURN(store.log_, ingest::RecordLog::open(path, resume, keep));
  return store;
}

base::Result<void> SubtreeStore::add(std::uint32_t tile, const Subtree& tree) {
  base::ByteWriter out;
  base::writeFields(out, std::tie(tile, tree.root, tree.added_leaves));
  out.u32(static_cast<std::uint32_t>(tree.level_nodes.size()));
  for (const std::uint32_t nodes : tree.level_nodes) out.u32(nodes);
  out.bytes(
      base::ByteView(reinterpret_cast<const std::uint8_t*>(tree.nodes.data()), tree.nodes.size() * sizeof(TreeNode)));
  LUMIGRID_ASSIGN_OR_RETURN(const auto offset, log_.add(out.view()));
  Record record;
  (void)readRecord(offset, out.view(), record);
  tiles_[tile] = std::move(record.subtree);
  return {};
}

base::Result<std::vector<TreeNode>> SubtreeStore::nodes(std::size_t tile) const {
  const StoredSubtree& subtree = (*this)[tile];
  std::vector<TreeNode> nodes(static_cast<std::size_t>(subtree.nodes));
  LUMIGRID_TRY(log_.readAt(subtree.offset,
                           std::span(reinterpret_cast<std::uint8_t*>(nodes.data()), nodes.size() * sizeof(TreeNode))));
  return nodes;
}

base::Result<WrittenTree> writeTree(const SubtreeStore& subtrees, const std::string& path,
                                    const FileBuildOptions& options) {
  return FileBuilder(subtrees, options).run(path);
}

}  // namespace lod::qsplat::builder
