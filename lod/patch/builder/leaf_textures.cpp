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
#include "lod/texture/picture_charts.h"
#include "mesh/texture.h"

namespace lod::patch::builder {
namespace {

// A triangle's texels are compared with its vertices' colours at so many points an edge at most: with 64 points a
// triangle the mean over a leaf is known well enough.
constexpr int kMaxSamplesPerEdge = 8;
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

// The texel at a place in texels of the picture, which repeats.
const std::uint8_t* texelAt(const base::Image& picture, const glm::dvec2& place) {
  const auto wrapped = [](double x, int size) {
    return std::clamp(static_cast<int>(x - std::floor(x / size) * size), 0, size - 1);
  };
  return picture.at(wrapped(place.x, picture.width), wrapped(place.y, picture.height));
}

// The mean square difference, 0..1, of the triangle's texels from the colours that its corners' are interpolated to.
double detailOf(const base::Image& picture, const std::array<glm::vec2, 3>& corners,
                const std::array<glm::dvec3, 3>& colors) {
  const double texels = areaOf(corners);
  const int n = std::clamp(static_cast<int>(std::sqrt(texels / kTexelsPerSample)), 1, kMaxSamplesPerEdge);
  double sum = 0.0;
  int count = 0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j + i < n; ++j, ++count) {
      const double s = (i + 1.0 / 3.0) / n, t = (j + 1.0 / 3.0) / n;
      const glm::dvec2 place =
          (1.0 - s - t) * glm::dvec2(corners[0]) + s * glm::dvec2(corners[1]) + t * glm::dvec2(corners[2]);
      const glm::dvec3 color = (1.0 - s - t) * colors[0] + s * colors[1] + t * colors[2];
      const std::uint8_t* texel = texelAt(picture, place);
      const glm::dvec3 off = (glm::dvec3(texel[0], texel[1], texel[2]) - color) / 255.0;
      sum += glm::dot(off, off) / 3.0;
    }
  return sum / count;
}

// A leaf's triangle in a picture.
base::Result<std::optional<texture::PictureTriangle>> triangleIn(const LeafTextureSource& source, const Leaf& leaf,
                                                                 std::size_t t, std::uint32_t number,
                                                                 const base::Image& picture) {
  if (leaf.sources[t] == ingest::kNoSource) return std::optional<texture::PictureTriangle>();
  LUMIGRID_ASSIGN_OR_RETURN(const auto place, source.places[leaf.sources[t]]);
  if (place.picture != number) return std::optional<texture::PictureTriangle>();
  texture::PictureTriangle triangle;
  triangle.triangle = static_cast<std::uint16_t>(t);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint64_t code = ingest::mortonCode(leaf.geometry.positions[leaf.geometry.indices[3 * t + k]]);
    triangle.corners[k] = place.at(code) * glm::vec2(picture.width, picture.height);
  }
  return std::optional(triangle);
}

// Notes what the leaf covers of the picture.
base::Result<void> addCharts(const LeafTextureSource& source, const WorkPatch& patch, std::uint32_t number,
                             const base::Image& picture, texture::PictureCharts& charts) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto leaf, readLeaf(source.store, patch));
  for (std::size_t t = 0; t < leaf.sources.size(); ++t) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto triangle, triangleIn(source, leaf, t, number, picture));
    if (triangle) charts.add(*triangle);
  }
  return {};
}

base::Result<MadePages> makeLeafPages(const LeafTextureSource& source, const WorkPatch& patch, std::uint32_t number,
                                      const base::Image& picture) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto leaf, readLeaf(source.store, patch));
  const PatchGeometry& geometry = leaf.geometry;
  MadePages made;
  std::vector<texture::PictureTriangle> triangles;
  std::vector<double> areas(leaf.sources.size(), 0.0), texels(leaf.sources.size(), 0.0);
  for (std::size_t t = 0; t < leaf.sources.size(); ++t) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto found, triangleIn(source, leaf, t, number, picture));
    if (!found) continue;
    const texture::PictureTriangle& triangle = *found;
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
    made.squares += areas[t] * detailOf(picture, triangle.corners, colors);
    triangles.push_back(triangle);
  }
  for (const texture::Page& page : texture::makePages(picture, triangles)) {
    double area = 0.0, covered = 0.0;
    for (const texture::PageTriangle& t : page.triangles) area += areas[t.triangle], covered += texels[t.triangle];
    covered *= static_cast<double>(page.scale) * static_cast<double>(page.scale);
    const double texel = std::sqrt(area / std::max(covered, 1e-6));
    LUMIGRID_ASSIGN_OR_RETURN(auto bytes, texture::encodePage(page));
    made.pages.push_back({std::max(static_cast<float>(texel), 1e-30F), page.scale < 1.0F, std::move(bytes)});
  }
  return made;
}

}  // namespace

// Makes the pages, picture by picture.
class LeafTextures::Maker {
 public:
  Maker(const LeafTextureSource& source, std::span<const WorkPatch> leaves, unsigned threads)
      : source_(source), leaves_(leaves), threads_(threads), squares_(leaves.size()), areas_(leaves.size()) {}

  base::Result<LeafTextures> run(const std::string& directory, bool resume, const std::function<bool(double)>& report) {
    LUMIGRID_TRY(findLeaves());
    const auto keep = [this](std::uint64_t offset, base::ByteView payload) { return read(offset, payload); };
    LUMIGRID_ASSIGN_OR_RETURN(out_.log_, ingest::RecordLog::open(directory + "/pages", resume, keep));
    // Pictures that an earlier run finished are the first ones.
    std::size_t done = 0, all = 0;
    for (std::size_t p = 0; p < leaves_of_.size(); ++p) all += leaves_of_[p].size();
    for (std::uint32_t p = 0; p < leaves_of_.size(); ++p) {
      if (p >= finished_) LUMIGRID_TRY(makePicture(p));
      done += leaves_of_[p].size();
      if (!report(static_cast<double>(done) / static_cast<double>(std::max<std::size_t>(1, all))))
        return base::Error{base::ErrorCode::kCancelled, "cutting up the textures was cancelled"};
    }
    summarize();
    return std::move(out_);
  }

 private:
  // Finds the leaves that show each picture.
  base::Result<void> findLeaves() {
    std::vector<std::vector<std::uint32_t>> shown(leaves_.size());
    LUMIGRID_TRY(base::tryParallelFor(leaves_.size(), threads_, [&](std::size_t i) -> base::Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(const auto leaf, readLeaf(source_.store, leaves_[i]));
      for (const std::uint64_t s : leaf.sources) {
        if (s == ingest::kNoSource) continue;
        LUMIGRID_ASSIGN_OR_RETURN(const auto place, source_.places[s]);
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

  base::Result<void> makePicture(std::uint32_t number) {
    const std::vector<std::uint32_t>& leaves = leaves_of_[number];
    std::vector<MadePages> made(leaves.size());
    if (!leaves.empty()) {
      LUMIGRID_ASSIGN_OR_RETURN(auto picture, mesh::readPicture(source_.pictures[number]));
      texture::PictureCharts charts(picture.width, picture.height);
      LUMIGRID_TRY(base::tryParallelFor(leaves.size(), threads_, [&](std::size_t i) {
        return addCharts(source_, leaves_[leaves[i]], number, picture, charts);
      }));
      charts.growInto(picture);
      LUMIGRID_TRY(base::tryParallelFor(leaves.size(), threads_, [&](std::size_t i) -> base::Result<void> {
        LUMIGRID_ASSIGN_OR_RETURN(made[i], makeLeafPages(source_, leaves_[leaves[i]], number, picture));
        return {};
      }));
    }
    base::ByteWriter out;
    out.u32(number);
    out.u32(static_cast<std::uint32_t>(leaves.size()));
    for (std::size_t i = 0; i < leaves.size(); ++i) {
      const MadePages& m = made[i];
      base::writeFields(out, std::tie(leaves[i], m.squares, m.area, m.texels));
      out.u32(static_cast<std::uint32_t>(m.pages.size()));
      for (const MadePages::One& page : m.pages) {
        out.f32(page.texel);
        out.u8(page.reduced ? 1 : 0);
        out.u32(static_cast<std::uint32_t>(page.bytes.size()));
        out.bytes(page.bytes);
      }
    }
    const base::Bytes payload = out.takeBytes();
    LUMIGRID_ASSIGN_OR_RETURN(const auto offset, out_.log_.add(payload));
    (void)read(offset, payload);
    return {};
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
        kept.texel = in.f32();
        out_.summary_.reduced_pages += in.u8();
        kept.bytes = in.u32();
        kept.offset = offset + in.offset();
        (void)in.bytes(kept.bytes);
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
  unsigned threads_;
  std::vector<std::vector<std::uint32_t>> leaves_of_;  // by picture
  std::uint32_t finished_ = 0;                         // pictures
  std::vector<double> squares_, areas_;                // by leaf
  double texels_ = 0.0;
  LeafTextures out_;
};

base::Result<LeafTextures> LeafTextures::make(const LeafTextureSource& source, std::span<const WorkPatch> leaves,
                                              const std::string& directory, bool resume, unsigned threads,
                                              const std::function<bool(double)>& report) {
  return Maker(source, leaves, threads).run(directory, resume, report);
}

base::Result<texture::TextureSummary> LeafTextures::write(const std::string& path,
                                                          std::span<const std::uint32_t> patch_of,
                                                          std::uint32_t patches) const {
  std::vector<Kept> sorted = pages_;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](const Kept& a, const Kept& b) { return patch_of[a.leaf] < patch_of[b.leaf]; });
  std::vector<texture::PageRecord> records;
  for (const Kept& kept : sorted) {
    texture::PageRecord record;
    record.patch = patch_of[kept.leaf];
    record.texel = kept.texel;
    records.push_back(record);
  }
  texture::TextureSummary summary = summary_;
  summary.patches = patches;
  const auto bytesOf = [&](std::size_t page) -> base::Result<base::Bytes> {
    base::Bytes bytes(sorted[page].bytes);
    LUMIGRID_TRY(log_.readAt(sorted[page].offset, bytes));
    return bytes;
  };
  LUMIGRID_TRY(texture::writeTextureFile(path, summary, records, bytesOf));
  LUMIGRID_ASSIGN_OR_RETURN(const auto written, texture::TextureFile::open(path));
  return written.summary();
}

}  // namespace lod::patch::builder
