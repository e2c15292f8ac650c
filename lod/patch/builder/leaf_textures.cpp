#include "lod/patch/builder/leaf_textures.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

#include "base/fields.h"
#include "base/parallel.h"
#include "lod/ingest/morton.h"
#include "lod/patch/codec.h"
#include "lod/texture/picture_cutter.h"
#include "mesh/texture.h"

namespace lod::patch::builder {
namespace {

// A triangle's texels are compared with its vertices' colours at so many points an edge at most, 10 in all, and fewer,
// or in some of the triangles alone, where a leaf would have more points than its one number takes: a choice, with
// which chance moves it by about 3 %. Each point takes as long as decoding a unit of a JPEG.
constexpr int kMaxSamplesPerEdge = 4;
constexpr std::size_t kMaxSamplesPerLeaf = 1000;
constexpr double kTexelsPerSample = 3.0;

// A leaf and what its triangles carry.
struct Leaf {
  PatchGeometry geometry;
  std::vector<std::uint64_t> sources;
};

base::Result<Leaf> readLeaf(const WorkStore& store, const WorkPatch& patch) {
  base::Bytes bytes;
  LUMIGRID_TRY(store.readWhole(patch, bytes));
  const base::ByteView encoded = base::ByteView(bytes).first(patch.encoded_bytes);
  Leaf leaf;
  LUMIGRID_ASSIGN_OR_RETURN(leaf.geometry, decodePatch(encoded));
  leaf.sources.resize(patch.carried_bytes / kSourceBytes);
  if (leaf.sources.size() != leaf.geometry.indices.size() / 3)
    return base::Error{base::ErrorCode::kInvalidInput, "the builder's own file: a leaf without its sources"};
  std::memcpy(leaf.sources.data(), bytes.data() + encoded.size(), kSourceBytes * leaf.sources.size());
  return leaf;
}

// The pages of a leaf from one picture.
struct MadePages {
  struct One {
    float texel = 0.0F;
    bool reduced = false;
    base::Bytes bytes;
  };
  std::vector<One> pages;
  double squares = 0.0;  // of the differences of texels from the vertices' colours, times the area they stand for
  double area = 0.0;     // on the surface, square scene units
  double texels = 0.0;   // covered
};

double areaOf(const std::array<glm::vec2, 3>& corners) {
  const glm::dvec2 u(corners[1] - corners[0]), v(corners[2] - corners[0]);
  return 0.5 * std::abs(u.x * v.y - u.y * v.x);
}

// The colour at a place in texels of the picture, which repeats.
glm::dvec3 colorAt(const texture::PictureCutter& picture, const glm::dvec2& place) {
  const auto wrapped = [](double x, int size) {
    return std::clamp(static_cast<int>(x - std::floor(x / size) * size), 0, size - 1);
  };
  return glm::dvec3(picture.colorAt(wrapped(place.x, picture.size().x), wrapped(place.y, picture.size().y)));
}

// The mean square difference, 0..1, of the triangle's texels from the colours that its corners' are interpolated to. At
// about `most` of its points they are compared, at least one, in each triangle from another point on, so that all
// points count alike in a leaf.
double detailOf(const texture::PictureCutter& picture, const texture::PictureTriangle& triangle,
                const std::array<glm::dvec3, 3>& colors, std::size_t most) {
  const std::array<glm::vec2, 3>& corners = triangle.corners;
  const double texels = areaOf(corners);
  const int n = std::clamp(static_cast<int>(std::sqrt(texels / kTexelsPerSample)), 1, kMaxSamplesPerEdge);
  const std::size_t points = static_cast<std::size_t>(n) * static_cast<std::size_t>(n + 1) / 2;
  const std::size_t stride = (points + most - 1) / most;
  double sum = 0.0;
  int count = 0;
  std::size_t point = triangle.triangle % stride;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j + i < n; ++j, ++point) {
      if (point % stride != 0) continue;
      const double s = (i + 1.0 / 3.0) / n, t = (j + 1.0 / 3.0) / n;
      const glm::dvec2 place =
          (1.0 - s - t) * glm::dvec2(corners[0]) + s * glm::dvec2(corners[1]) + t * glm::dvec2(corners[2]);
      const glm::dvec3 color = (1.0 - s - t) * colors[0] + s * colors[1] + t * colors[2];
      const glm::dvec3 off = (colorAt(picture, place) - color) / 255.0;
      sum += glm::dot(off, off) / 3.0;
      ++count;
    }
  return sum / count;
}

// A leaf's triangles in a picture.
base::Result<std::vector<texture::PictureTriangle>> trianglesIn(const LeafTextureSource& source, const Leaf& leaf,
                                                                std::uint32_t number, const glm::ivec2& size) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto places, source.places.read(leaf.sources));
  std::vector<texture::PictureTriangle> triangles;
  for (std::size_t t = 0; t < places.size(); ++t) {
    if (places[t].picture != number) continue;
    texture::PictureTriangle& triangle = triangles.emplace_back();
    triangle.triangle = static_cast<std::uint16_t>(t);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t code = ingest::mortonCode(leaf.geometry.positions[leaf.geometry.indices[3 * t + k]]);
      triangle.corners[k] = places[t].at(code) * glm::vec2(size);
    }
  }
  return triangles;
}

// Makes the pages of a leaf from a picture, to which it was added as `added`.
base::Result<MadePages> makeLeafPages(const LeafTextureSource& source, const WorkPatch& patch, std::uint32_t number,
                                      texture::PictureCutter& picture, std::uint32_t added) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto leaf, readLeaf(source.store, patch));
  LUMIGRID_ASSIGN_OR_RETURN(const auto triangles, trianglesIn(source, leaf, number, picture.size()));
  const PatchGeometry& geometry = leaf.geometry;
  MadePages made;
  const std::size_t count = std::max<std::size_t>(1, triangles.size());
  const std::size_t most_points = std::max<std::size_t>(1, kMaxSamplesPerLeaf / count);
  const std::size_t every = (count + kMaxSamplesPerLeaf - 1) / kMaxSamplesPerLeaf;
  double squares = 0.0, compared = 0.0;
  std::vector<double> areas(leaf.sources.size(), 0.0), texels(leaf.sources.size(), 0.0);
  for (const texture::PictureTriangle& triangle : triangles) {
    const std::size_t t = triangle.triangle;
    std::array<glm::dvec3, 3> points, colors;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t v = geometry.indices[3 * t + k];
      points[k] = source.lattice.step * glm::dvec3(geometry.positions[v]);
      colors[k] = geometry.colors.empty() ? glm::dvec3(255.0) : glm::dvec3(glm::u8vec3(geometry.colors[v]));
    }
    areas[t] = 0.5 * glm::length(glm::cross(points[1] - points[0], points[2] - points[0]));
    texels[t] = areaOf(triangle.corners);
    made.area += areas[t];
    made.texels += texels[t];
    if (static_cast<std::size_t>(&triangle - triangles.data()) % every != 0) continue;
    compared += areas[t];
    squares += areas[t] * detailOf(picture, triangle, colors, most_points);
  }
  // The others stand for as much of their surface.
  if (compared > 0.0) made.squares = squares / compared * made.area;
  LUMIGRID_ASSIGN_OR_RETURN(auto pages, picture.cut(triangles, added));
  for (texture::EncodedPage& page : pages) {
    double area = 0.0, covered = 0.0;
    for (const texture::PageTriangle& t : page.triangles) area += areas[t.triangle], covered += texels[t.triangle];
    covered *= static_cast<double>(page.scale) * static_cast<double>(page.scale);
    const double texel = std::sqrt(area / std::max(covered, 1e-6));
    made.pages.push_back({std::max(static_cast<float>(texel), 1e-30F), page.scale < 1.0F, std::move(page.bytes)});
  }
  return made;
}

// The memory for a texel of a picture that is cut up: blocks of three planes without subsampling and those of a page,
// which may be as large (6 bytes each), and what is covered.
constexpr std::uint64_t kBytesPerTexel = 13;
base::Result<texture::PictureCutter> openPicture(const mesh::SourcePicture& source, base::ByteView units) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, mesh::PictureBytes::open(source));
  return texture::PictureCutter::open(bytes.view(), units, [source] { return mesh::readPicture(source); });
}

// Bytes of a record's numbers: before its leaves, before a leaf's pages, and before a page.
constexpr std::size_t kRecordHead = 8, kLeafHead = 32, kPageHead = 9;

}  // namespace

// Makes the pages, picture by picture.
class LeafTextures::Maker {
 public:
  Maker(const LeafTextureSource& source, std::span<const WorkPatch> leaves, Resources resources)
      : source_(source), leaves_(leaves), resources_(resources), squares_(leaves.size()), areas_(leaves.size()) {}

  base::Result<LeafTextures> run(const std::string& directory, bool resume, const std::function<bool(double)>& report) {
    LUMIGRID_TRY(findLeaves());
    const auto keep = [this](std::uint64_t offset, base::ByteView payload) { return read(offset, payload); };
    LUMIGRID_ASSIGN_OR_RETURN(out_.log_, ingest::RecordLog::open(directory + "/pages", resume, keep));
    // Pictures that an earlier run finished are the first ones.
    std::size_t done = 0, all = 0;
    for (std::size_t p = 0; p < leaves_of_.size(); ++p) (p < finished_ ? done : all) += leaves_of_[p].size();
    all += done;
    const std::uint32_t first = finished_;
    LUMIGRID_ASSIGN_OR_RETURN(const std::uint64_t largest, largestPicture(first));
    const auto left =
        std::count_if(leaves_of_.begin() + first, leaves_of_.end(), [](const auto& l) { return !l.empty(); });
    const auto most = std::clamp<std::uint64_t>(static_cast<std::uint64_t>(left), 1, resources_.threads);
    const auto at_once =
        static_cast<unsigned>(std::clamp<std::uint64_t>(resources_.memory / (kBytesPerTexel * largest), 1, most));
    // Twice as many records wait for their turn as are made, so that nobody waits for the disk.
    std::vector<base::Bytes> made(std::size_t{2} * at_once);
    const auto make = [&](std::size_t i, std::size_t slot) -> base::Result<void> {
      const unsigned threads = (resources_.threads + at_once - 1) / at_once;
      LUMIGRID_ASSIGN_OR_RETURN(made[slot], makePicture(first + static_cast<std::uint32_t>(i), threads));
      return {};
    };
    const auto keepMade = [&](std::size_t i, std::size_t slot) -> base::Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(const auto offset, out_.log_.add(made[slot]));
      (void)read(offset, made[slot]);
      made[slot] = {};
      done += leaves_of_[first + i].size();
      if (report(static_cast<double>(done) / static_cast<double>(std::max<std::size_t>(1, all)))) return {};
      return base::Error{base::ErrorCode::kCancelled, "cutting up the textures was cancelled"};
    };
    LUMIGRID_TRY(base::parallelInOrder(leaves_of_.size() - first, at_once, made.size(), make, keepMade));
    summarize();
    return std::move(out_);
  }

 private:
  // Finds the leaves that show each picture.
  base::Result<void> findLeaves() {
    std::vector<std::vector<std::uint32_t>> shown(leaves_.size());
    LUMIGRID_TRY(base::tryParallelFor(leaves_.size(), resources_.threads, [&](std::size_t i) -> base::Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(const auto leaf, readLeaf(source_.store, leaves_[i]));
      LUMIGRID_ASSIGN_OR_RETURN(const auto places, source_.places.read(leaf.sources));
      for (const ingest::TexturePlace& place : places) {
        if (place.picture < source_.pictures.size() && (shown[i].empty() || shown[i].back() != place.picture))
          shown[i].push_back(place.picture);
      }
      std::sort(shown[i].begin(), shown[i].end());
      shown[i].erase(std::unique(shown[i].begin(), shown[i].end()), shown[i].end());
      return {};
    }));
    leaves_of_.resize(source_.pictures.size());
    for (std::uint32_t i = 0; i < shown.size(); ++i)
      for (const std::uint32_t picture : shown[i]) leaves_of_[picture].push_back(i);
    return {};
  }

  // The texels of the largest picture from `first` on that some leaf shows; at least 1.
  base::Result<std::uint64_t> largestPicture(std::uint32_t first) const {
    std::uint64_t largest = 1;
    for (std::size_t p = first; p < leaves_of_.size(); ++p) {
      if (leaves_of_[p].empty()) continue;
      LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, mesh::PictureBytes::open(source_.pictures[p]));
      const auto size = mesh::pictureSize(bytes.view());
      if (!size) return base::within(source_.pictures[p].path, size.error());
      largest = std::max(largest, std::uint64_t(size->x) * std::uint64_t(size->y));
    }
    return largest;
  }

  // Returns the record of a picture.
  base::Result<base::Bytes> makePicture(std::uint32_t number, unsigned threads) const {
    const std::vector<std::uint32_t>& leaves = leaves_of_[number];
    std::vector<MadePages> made(leaves.size());
    if (!leaves.empty()) {
      const mesh::SourcePicture& file = source_.pictures[number];
      LUMIGRID_ASSIGN_OR_RETURN(auto picture, openPicture(file, source_.units.of(file)));
      std::vector<std::uint32_t> added(leaves.size());
      LUMIGRID_TRY(base::tryParallelFor(leaves.size(), threads, [&](std::size_t i) -> base::Result<void> {
        LUMIGRID_ASSIGN_OR_RETURN(const auto leaf, readLeaf(source_.store, leaves_[leaves[i]]));
        LUMIGRID_ASSIGN_OR_RETURN(const auto triangles, trianglesIn(source_, leaf, number, picture.size()));
        added[i] = picture.add(triangles);
        return {};
      }));
      picture.finish();
      LUMIGRID_TRY(base::tryParallelFor(leaves.size(), threads, [&](std::size_t i) -> base::Result<void> {
        LUMIGRID_ASSIGN_OR_RETURN(made[i], makeLeafPages(source_, leaves_[leaves[i]], number, picture, added[i]));
        return {};
      }));
    }
    // Numbers and pages by turns, in one piece of memory from the beginning.
    base::ByteWriter numbers;
    base::Bytes out;
    std::size_t bytes = kRecordHead;
    for (const MadePages& m : made) {
      bytes += kLeafHead;
      for (const MadePages::One& page : m.pages) bytes += kPageHead + page.bytes.size();
    }
    out.reserve(bytes);
    const auto append = [&out](base::ByteView view) { out.insert(out.end(), view.begin(), view.end()); };
    numbers.u32(number);
    numbers.u32(static_cast<std::uint32_t>(leaves.size()));
    for (std::size_t i = 0; i < leaves.size(); ++i) {
      const MadePages& m = made[i];
      base::writeFields(numbers, std::tie(leaves[i], m.squares, m.area, m.texels));
      numbers.u32(static_cast<std::uint32_t>(m.pages.size()));
      for (const MadePages::One& page : m.pages) {
        numbers.f32(page.texel);
        numbers.u8(page.reduced ? 1 : 0);
        numbers.u32(static_cast<std::uint32_t>(page.bytes.size()));
        append(numbers.takeBytes());
        numbers = {};
        append(page.bytes);
      }
      made[i] = {};
    }
    append(numbers.view());
    return out;
  }

  // Notes what lies in a record of the log.
  bool read(std::uint64_t offset, base::ByteView payload) {
    base::ByteReader in(payload);
    if (in.u32() != finished_) return false;
    for (std::uint32_t left = in.u32(); left > 0; --left) {
      std::uint32_t leaf = 0;
      double squares = 0.0, area = 0.0, texels = 0.0;
      base::readFields(in, std::tie(leaf, squares, area, texels));
      if (!in.ok() || leaf >= leaves_.size()) return false;
      squares_[leaf] += squares, areas_[leaf] += area, texels_ += texels;
      for (std::uint32_t pages = in.u32(); pages > 0 && in.ok(); --pages) {
        Kept kept;
        kept.leaf = leaf;
        kept.record.texel = in.f32();
        out_.summary_.reduced_pages += in.u8();
        const std::uint32_t bytes = in.u32();
        const std::uint64_t begin = offset + in.offset();
        if (!texture::describePage(in.bytes(bytes), kept.record)) return false;
        kept.record.offset = begin;
        out_.pages_.push_back(kept);
      }
    }
    if (!in.atEnd()) return false;
    ++finished_;
    return true;
  }

  void summarize() {
    double squares = 0.0, area = 0.0;
    out_.detail_.resize(leaves_.size());
    for (std::size_t i = 0; i < leaves_.size(); ++i) {
      squares += squares_[i], area += areas_[i];
      const double detail = areas_[i] > 0.0 ? std::sqrt(squares_[i] / areas_[i]) : 0.0;
      out_.detail_[i] = static_cast<std::uint16_t>(std::lround(65535.0 * std::min(1.0, detail)));
    }
    out_.summary_.pictures = static_cast<std::uint32_t>(source_.pictures.size());
    out_.summary_.texels = static_cast<std::uint64_t>(texels_);
    out_.summary_.typical_error = area > 0.0 ? static_cast<float>(std::sqrt(squares / area)) : 0.0F;
  }

  const LeafTextureSource& source_;
  std::span<const WorkPatch> leaves_;
  Resources resources_;
  std::vector<std::vector<std::uint32_t>> leaves_of_;  // by picture
  std::uint32_t finished_ = 0;                         // pictures
  std::vector<double> squares_, areas_;                // by leaf
  double texels_ = 0.0;
  LeafTextures out_;
};

base::Result<LeafTextures> LeafTextures::make(const LeafTextureSource& source, std::span<const WorkPatch> leaves,
                                              const std::string& directory, bool resume, Resources resources,
                                              const std::function<bool(double)>& report) {
  return Maker(source, leaves, resources).run(directory, resume, report);
}

base::Result<texture::TextureSummary> LeafTextures::write(const std::string& path,
                                                          std::span<const std::uint32_t> patch_of,
                                                          std::uint32_t patches,
                                                          const std::function<void(base::Bytes)>& on_bytes) const {
  std::vector<Kept> sorted = pages_;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](const Kept& a, const Kept& b) { return patch_of[a.leaf] < patch_of[b.leaf]; });
  std::vector<texture::PageRecord> records;
  for (const Kept& kept : sorted) {
    records.push_back(kept.record);
    records.back().patch = patch_of[kept.leaf];
  }
  texture::TextureSummary summary = summary_;
  summary.patches = patches;
  const auto bytesOf = [&](std::size_t page) -> base::Result<base::Bytes> {
    const texture::PageRecord& record = sorted[page].record;
    base::Bytes bytes(record.bytes);
    LUMIGRID_TRY(log_.readAt(record.offset, bytes));
    log_.forget(record.offset, bytes.size());
    return bytes;
  };
  LUMIGRID_TRY(texture::writeTextureFile(path, summary, records, bytesOf, on_bytes));
  LUMIGRID_ASSIGN_OR_RETURN(const auto written, texture::TextureFile::open(path));
  return written.summary();
}

}  // namespace lod::patch::builder
